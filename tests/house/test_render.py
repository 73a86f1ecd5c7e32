"""The renderer against closed forms: ray-box distances, energy of a lamp, and what light must and must not do in a
room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from room import ROOM_M, TABLE, SceneBuilder, box_room, furnished_room
from salframe_house.bounce import Bounce, gather_directions
from salframe_house.lighting import CONDITIONS, INTERLEAVED, Lights, is_hollow, lights_on
from salframe_house.render import HouseRenderer
from salframe_house.scene import Light, Material
from salframe_house.textures import MAX_PATTERN, TEXTURES, TILE, TextureKind, texture_tile
from salframe_house.tracing import Tracer

from salframe.framework.errors import DataError
from salframe.panoramas.geometry import equirectangular_rays, pose_2d, rays_to_pixels

HEIGHT = 128
POSE = pose_2d(1.8, 3.3, 0.3, 1.5)


@pytest.fixture(scope="module")
def furnished() -> HouseRenderer:
    return HouseRenderer(furnished_room(), "evening", HEIGHT)


def look_up(image: np.ndarray, point_m, pose: np.ndarray = POSE) -> np.ndarray:
    """The pixel of a panorama at `pose` on which a world point falls."""
    column, row = rays_to_pixels((np.asarray(point_m) - pose[:3, 3]) @ pose[:3, :3], image.shape[0])
    return image[int(row), int(column)]


def test_range_in_a_box_is_the_analytic_distance() -> None:
    range_m, instance_id = HouseRenderer(box_room(), "day", HEIGHT).geometry(POSE)
    rays = equirectangular_rays(HEIGHT).astype(np.float64) @ POSE[:3, :3].T
    with np.errstate(divide="ignore"):
        expected = np.min(
            np.where(rays > 0, ROOM_M - POSE[:3, 3], -POSE[:3, 3]) / rays, axis=-1, where=rays != 0, initial=np.inf
        )
    np.testing.assert_allclose(range_m, expected, atol=1e-4)
    assert range_m.dtype == np.float32
    assert instance_id.dtype == np.int32
    assert not instance_id.any()


def test_range_and_instance_of_a_box_in_the_open() -> None:
    build = SceneBuilder()
    build.box((2, -0.5, -0.5), (3, 0.5, 0.5), Material("wood", (0.4, 0.3, 0.2)), 7)
    range_m, instance_id = HouseRenderer(build.scene(), "day", HEIGHT).geometry(np.eye(4))
    rays = equirectangular_rays(HEIGHT).astype(np.float64)
    front = np.abs(rays[..., 1:]).max(axis=-1) * 2 < 0.5 * rays[..., 0]
    np.testing.assert_array_equal(instance_id, np.where(front, 7, 0))
    np.testing.assert_allclose(range_m[front], 2 / rays[front][:, 0], rtol=1e-5)
    assert np.isnan(range_m[~front]).all()


def test_turning_by_whole_columns_rolls_range_and_instances(furnished: HouseRenderer) -> None:
    columns = 37
    range_m, instance_id = furnished.geometry(POSE)
    turned_range_m, turned_instance_id = furnished.geometry(pose_2d(1.8, 3.3, 0.3 + columns * np.pi / HEIGHT, 1.5))
    # Content moves to the right when the camera turns to the left. A few pixel centres lie on an edge to within
    # rounding.
    same = np.roll(instance_id, columns, axis=1) == turned_instance_id
    assert same.mean() > 0.9995
    close = np.isclose(np.roll(range_m, columns, axis=1), turned_range_m, atol=1e-4)
    assert close.mean() > 0.9995


def test_same_pose_same_bytes_and_lightings_share_geometry(furnished: HouseRenderer) -> None:
    dim = furnished.relit("dim")
    first, second = dim.render(POSE), HouseRenderer(furnished_room(), "dim", HEIGHT).render(POSE)
    np.testing.assert_array_equal(first.rgb, second.rgb)
    evening = furnished.render(POSE)
    np.testing.assert_array_equal(first.range_m, evening.range_m)
    np.testing.assert_array_equal(evening.instance_id, furnished.geometry(POSE)[1])
    assert np.abs(first.rgb.astype(int) - evening.rgb).mean() > 5


@pytest.mark.parametrize("lighting", list(CONDITIONS))
def test_pictures_are_exposed(furnished: HouseRenderer, lighting: str) -> None:
    rgb = furnished.relit(lighting).render(POSE).rgb
    assert rgb.shape == (HEIGHT, 2 * HEIGHT, 3)
    assert rgb.dtype == np.uint8
    assert (rgb.min(axis=-1) >= 250).mean() < 0.03  # the window and the lamp, no more
    assert (rgb.max(axis=-1) <= 5).mean() < 0.01
    low, high = {"day": (100, 160), "evening": (85, 145), "dim": (55, 110)}[lighting]
    assert low < rgb.mean() < high


def test_shadow_under_the_table(furnished: HouseRenderer) -> None:
    rendering = furnished.render(POSE)
    under, beside = (3.0, 2.25, 0.012), (3.0, 3.15, 0.012)
    assert look_up(rendering.instance_id, (3.0, 2.45, 0.74)) == TABLE
    pose = pose_2d(1.8, 2.4, 0.3, 0.4)  # looks under the table
    rgb = furnished.render(pose).rgb
    assert look_up(rgb, under, pose).mean() < 0.75 * look_up(rgb, beside, pose).mean()


def test_a_corner_without_direct_light_is_lit_indirectly() -> None:
    build = SceneBuilder()
    grey = Material("concrete", (0.5, 0.5, 0.5))
    build.box((0, 0, 0), ROOM_M, grey)
    build.box((4.0, 0, 0), (4.1, 3.5, 2.7), grey)  # a wall that hides the lamp from the corner behind it
    build.lights.append(Light((1.0, 1.0, 2.6), (0.6, 0, 0), (0, 0.6, 0), "lamp", "room"))
    scene = build.scene()
    corner = np.array([[5.5, 0.5, 0.0]], np.float32)
    tracer = Tracer(scene, is_hollow(scene))
    lights = Lights(scene, CONDITIONS["evening"], tracer)
    assert not lights.direct(corner, np.array([[0, 0, 1]], np.float32), np.zeros(1, int), 8).any()
    rgb = HouseRenderer(scene, "evening", HEIGHT).render(pose_2d(5.0, 4.5, 0.0, 1.5)).rgb
    assert look_up(rgb, corner[0], pose_2d(5.0, 4.5, 0.0, 1.5)).min() > 8


def test_direct_light_is_that_of_a_disc_on_its_axis() -> None:
    """Irradiance below the middle of a disc of radiance L: pi L r^2 / (r^2 + d^2)."""
    scene, condition = box_room(), CONDITIONS["evening"]
    lights = Lights(scene, condition, Tracer(scene, is_hollow(scene)))
    received = lights.direct(
        np.array([[3.0, 2.5, 0.0]], np.float32), np.array([[0, 0, 1]], np.float32), np.zeros(1, int), 4
    )
    radius_sq = 0.36 / np.pi
    np.testing.assert_allclose(
        received[0],
        np.pi * condition.lamp * radius_sq / (radius_sq + 2.65**2) * np.array(condition.lamp_rgb),
        rtol=1e-4,
    )


def test_half_a_hidden_lamp_gives_half_the_light() -> None:
    build = SceneBuilder()
    grey = Material("concrete", (0.5, 0.5, 0.5))
    build.box((0, 0, 0), (6, 6, 3), grey)
    build.lights.append(Light((3, 3, 2.9), (0.6, 0, 0), (0, 0.6, 0), "lamp", "room"))
    open_scene = build.scene()
    build.box((3.0, 0, 1.4), (6, 6, 1.45), grey)  # seen from the middle of the floor, its edge halves the lamp
    shaded_scene = build.scene()
    points, up = (
        np.tile(np.array([[3, 3, 0]], np.float32), (INTERLEAVED, 1)),
        np.tile(np.array([[0, 0, 1]], np.float32), (INTERLEAVED, 1)),
    )
    means = []
    for scene in (open_scene, shaded_scene):
        lights = Lights(scene, CONDITIONS["evening"], Tracer(scene, is_hollow(scene)))
        means.append(lights.direct(points, up, np.arange(INTERLEAVED), 3).mean())
    assert means[1] / means[0] == pytest.approx(0.5, abs=0.05)


def test_a_lamp_does_not_shade_itself() -> None:
    build = SceneBuilder()
    build.box((0, 0, 0), (6, 6, 3), Material("concrete", (0.5, 0.5, 0.5)))
    build.lights.append(Light((3, 3, 2.7), (0.4, 0, 0), (0, 0.4, 0), "lamp", "room", 5))
    bare = build.scene()
    build.box((2.7, 2.7, 2.6), (3.3, 3.3, 2.95), Material("metal", (0.5, 0.5, 0.5)), 5)
    housed = build.scene()
    floor = np.random.default_rng(0).uniform((0.1, 0.1, 0), (5.9, 5.9, 1e-9), (200, 3)).astype(np.float32)
    up = np.tile(np.array([[0, 0, 1]], np.float32), (200, 1))
    bare_light, housed_light = (
        Lights(scene, CONDITIONS["day"], Tracer(scene, is_hollow(scene))).direct(floor, up, np.zeros(200, int), 4)
        for scene in (bare, housed)
    )
    np.testing.assert_array_equal(bare_light, housed_light)
    assert (bare_light > 0).all()


def test_gathered_directions_are_cosine_distributed() -> None:
    """Over a hemisphere weighted by its cosine, the mean of the cosine is 2/3 and that of the direction lies on the
    normal."""
    normal = np.array([[0, 0, 1], [0, 0, -1], [0.6, 0, 0.8], [-0.48, 0.6, -0.64]], np.float32)
    for n in normal:
        directions = gather_directions(np.tile(n, (INTERLEAVED, 1)), np.arange(INTERLEAVED), 16).reshape(-1, 3)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-5)
        assert (directions @ n > 0).all()
        np.testing.assert_allclose(directions.mean(axis=0), n * 2 / 3, atol=0.01)


def test_indirect_light_conserves_energy() -> None:
    """In a closed room of albedo a that a lamp lights with flux F, the mean irradiance of the surfaces is F / (area (1
    - a))."""
    build, albedo = SceneBuilder(), 0.5
    build.box((0, 0, 0), ROOM_M, Material("concrete", (albedo, albedo, albedo)))
    build.lights.append(Light((3.0, 2.5, 2.6), (0.6, 0, 0), (0, 0.6, 0), "lamp", "room"))
    scene, condition = build.scene(), CONDITIONS["day"]
    points, normals = [], []
    for axis in range(3):
        u, v = (a for a in range(3) if a != axis)
        for side in (0, 1):
            grid = np.stack(np.meshgrid(*((np.arange(24) + 0.5) / 24 for _ in range(2))), -1).reshape(-1, 2)
            point, normal = np.zeros((len(grid), 3)), np.zeros((len(grid), 3))
            point[:, [u, v]], point[:, axis] = grid * ROOM_M[[u, v]], side * ROOM_M[axis]
            normal[:, axis] = 1 - 2 * side
            points.append(point)
            normals.append(normal)
    area_m2 = np.repeat([ROOM_M[1] * ROOM_M[2], ROOM_M[0] * ROOM_M[2], ROOM_M[0] * ROOM_M[1]], 2)
    point_m, normal = (np.concatenate(parts).astype(np.float32) for parts in (points, normals))
    sample_set = np.arange(len(point_m)) % INTERLEAVED
    tracer = Tracer(scene, is_hollow(scene))
    lights = Lights(scene, condition, tracer)
    direct = lights.direct(point_m, normal, sample_set, 4)
    bounce = Bounce(tracer, lights, np.full((len(scene.triangles), 3), albedo, np.float32), ROOM_M / 2)
    total = direct + bounce.irradiance(point_m, normal, sample_set, 16)
    mean = np.average(total.reshape(6, -1, 3).mean(axis=(1, 2)), weights=area_m2)
    flux = np.pi * condition.lamp * 0.36 * np.mean(condition.lamp_rgb)
    assert mean == pytest.approx(flux / (area_m2.sum() * (1 - albedo)), rel=0.06)


def test_no_specks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bare room without a pattern has no pixel far from the median of its neighbours."""
    monkeypatch.setitem(TEXTURES, "plain", TextureKind(lambda rng: np.ones((TILE, TILE, 3)), (1.0, 1.0)))
    build = SceneBuilder()
    build.box((0, 0, 0), ROOM_M, Material("plain", (0.6, 0.6, 0.6)))
    build.box((2.7, 2.2, 2.60), (3.3, 2.8, 2.69), Material("plain", (0.7, 0.69, 0.66)), 15)
    build.lights.append(Light((3.0, 2.5, 2.65), (0.6, 0, 0), (0, 0.6, 0), "lamp", "room", 15))
    rendering = HouseRenderer(build.scene(), "evening", HEIGHT).render(POSE)
    grey = rendering.rgb.astype(float).mean(axis=-1)
    window = np.lib.stride_tricks.sliding_window_view(grey, (3, 3)).reshape(HEIGHT - 2, 2 * HEIGHT - 2, 9)
    speck = np.abs(grey[1:-1, 1:-1] - np.median(window, axis=-1))
    assert speck[rendering.instance_id[1:-1, 1:-1] == 0].max() < 12


def test_dim_keeps_a_lamp_in_every_room() -> None:
    rng = np.random.default_rng(3)
    lights = [
        Light(tuple(rng.uniform(0, 20, 3)), (0.6, 0, 0), (0, 0.6, 0), "lamp", f"room-{i // 4}") for i in range(80)
    ]
    on = lights_on(tuple(lights), CONDITIONS["dim"])
    assert {light.room for light, shines in zip(lights, on, strict=True) if shines} == {light.room for light in lights}
    assert 0.4 < on.mean() < 0.75
    assert lights_on(tuple(lights), CONDITIONS["day"]).all()


@pytest.mark.parametrize("name", list(TEXTURES))
def test_textures_have_mean_one_and_no_seam(name: str) -> None:
    tile = texture_tile(name, 1)
    np.testing.assert_allclose(tile.mean(axis=(0, 1)), 1, atol=0.12)  # less where the brightest texels were clipped
    assert tile.min() >= 0
    assert tile.max() <= MAX_PATTERN
    np.testing.assert_array_equal(tile, texture_tile(name, 1))


def test_wrong_input_is_one_clear_line() -> None:
    with pytest.raises(DataError, match="unknown lighting 'noon'; expected one of day, evening, dim"):
        HouseRenderer(box_room(), "noon", HEIGHT)
    with pytest.raises(DataError, match="height is 130"):
        HouseRenderer(box_room(), "day", 130)
    scene = box_room()
    with pytest.raises(DataError, match="unknown texture 'velvet'; expected one of books, carpet"):
        HouseRenderer(
            replace(scene, materials=(replace(scene.materials[0], texture="velvet"), *scene.materials[1:])),
            "day",
            HEIGHT,
        )
