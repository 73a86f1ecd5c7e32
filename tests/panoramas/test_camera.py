"""Cameras: pixels of OpenCV and of closed forms, and calibrations that are refused."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from salframe.cli import options
from salframe.framework.errors import DataError
from salframe.panoramas import camera as cameras
from salframe.panoramas.camera import LEVEL, Camera
from salframe.panoramas.camera_file import read_camera
from salframe.panoramas.geometry import equirectangular_rays, translation

INTRINSICS = {"width": 640, "height": 480, "fx": 420.0, "fy": 425.0, "cx": 310.0, "cy": 250.0}
K = np.array([[420.0, 0, 310], [0, 425, 250], [0, 0, 1]])
PINHOLES = {
    "none": (),
    "plumb_bob": (-0.28, 0.09, 0.001, -0.002, -0.01),
    "rational_polynomial": (0.5, -2.4, 0.0005, -0.0003, 1.4, 0.4, -2.2, 1.3),
}
FISHEYE = (0.02, -0.01, 0.004, -0.001)
UP_LEFT = np.array(
    [[0.6, -0.64, 0.48, 0.3], [-0.8, -0.48, 0.36, -0.1], [0.0, -0.6, -0.8, 0.9], [0, 0, 0, 1]]
)  # rigid, with columns of 3-4-5 triangles


def random_points(num: int, seed: int = 0) -> np.ndarray:
    """Points ahead of a camera in its optical frame, up to 30 degrees off its axis."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.45, 0.45, (num, 2)), np.ones(num)]) * rng.uniform(0.5, 9, (num, 1))


@pytest.mark.parametrize(("model", "coefficients"), PINHOLES.items())
def test_pixels_of_pinhole_cameras_are_those_of_opencv(model, coefficients):
    camera = Camera(**INTRINSICS, distortion_model=model, distortion=coefficients, T_base_camera=UP_LEFT)
    points = random_points(500)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(coefficients or [0.0] * 4))
    in_base = points @ UP_LEFT[:3, :3].T  # directions from the camera
    np.testing.assert_allclose(camera.project(in_base), expected[:, 0], atol=1e-6)


def test_pixels_of_fisheye_cameras_are_those_of_opencv():
    camera = Camera(**INTRINSICS, distortion_model="fisheye", distortion=FISHEYE)
    points = random_points(500)
    expected, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, np.array(FISHEYE))
    np.testing.assert_allclose(camera.project(points @ LEVEL[:3, :3].T), expected[:, 0], atol=1e-6)
    assert Camera(**INTRINSICS, distortion_model="equidistant", distortion=FISHEYE).distortion_model == "fisheye"


def test_a_fisheye_camera_sees_behind_its_image_plane():
    camera = Camera(800, 800, 200, 200, 399.5, 399.5, "fisheye", (0, 0, 0, 0))  # r = 200 px per radian
    left_back = np.array([np.cos(np.radians(110)), np.sin(np.radians(110)), 0])
    np.testing.assert_allclose(camera.project(left_back), [399.5 - 200 * np.radians(110), 399.5], atol=1e-9)
    shown, _ = camera.sampling(180)
    azimuth = np.degrees(np.arctan2(*np.moveaxis(equirectangular_rays(180)[..., :2], -1, 0)[::-1]))
    assert np.abs(azimuth[90][shown[90]]).max() == pytest.approx(np.degrees(400 / 200), abs=1)


ALL = {**PINHOLES, "fisheye": FISHEYE}


@pytest.mark.parametrize(("model", "coefficients"), ALL.items())
def test_rays_are_the_inverse_of_the_projection(model, coefficients):
    camera = Camera(**INTRINSICS, distortion_model=model, distortion=coefficients, T_base_camera=UP_LEFT)
    rays = camera.rays()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1)
    y, x = np.mgrid[:480, :640]
    np.testing.assert_allclose(camera.project(rays), np.stack([x, y], -1), atol=1e-3)


@pytest.mark.parametrize(("model", "coefficients"), ALL.items())
def test_a_resized_image_shows_the_same_directions(model, coefficients):
    camera = Camera(**INTRINSICS, distortion_model=model, distortion=coefficients)
    directions = random_points(50) @ LEVEL[:3, :3].T
    pixels, small = camera.project(directions), camera.scaled(320, 160).project(directions)
    np.testing.assert_allclose(small + 0.5, (pixels + 0.5) / [2, 3])


def test_a_level_camera_sees_its_field_of_view():
    camera = Camera.of_field_of_view(400, 400, 90)
    inside, _ = camera.sampling(180)
    azimuth = np.degrees(np.arctan2(*np.moveaxis(equirectangular_rays(180)[..., :2], -1, 0)[::-1]))
    assert inside[90].sum() == 90  # 1 deg a column, the horizon's row
    assert np.abs(azimuth[90][inside[90]]).max() < 45
    # A face of a cube: a square of 90 x 90 deg covers a sixth of the sphere.
    weight = np.hypot(*np.moveaxis(equirectangular_rays(180)[..., :2], -1, 0))
    assert (inside * weight).sum() / weight.sum() == pytest.approx(1 / 6, abs=1e-3)


def test_a_positive_elevation_looks_up():
    up = Camera.of_field_of_view(200, 100, 60, elevation_deg=30)
    np.testing.assert_allclose(up.rotation[:, 2], [np.cos(np.radians(30)), 0, 0.5], atol=1e-12)
    np.testing.assert_allclose(up.rotation[:, 0], [0, -1, 0], atol=1e-12)  # its right stays level
    np.testing.assert_allclose(up.project(up.rotation[:, 2]), [99.5, 49.5])


def test_a_pole_of_the_distortion_limits_the_angle():
    """r / (1 - 0.5 r^2) grows without limit towards r = sqrt(2), so that the whole image is seen."""
    camera = Camera(**INTRINSICS, distortion_model="rational_polynomial", distortion=[0, 0, 0, 0, 0, -0.5, 0, 0])
    assert np.tan(camera.max_angle_rad) == pytest.approx(np.sqrt(2))
    assert camera.lost_share == 0
    shown, _ = camera.sampling(128)
    assert equirectangular_rays(128)[..., 0][shown].min() > np.cos(np.arctan(np.sqrt(2)))
    np.testing.assert_allclose(np.linalg.norm(camera.rays(), axis=-1), 1)


def test_a_fold_of_the_distortion_is_not_seen_twice():
    """r (1 - 0.35 r^2) has its maximum at r = 0.976: no direction beyond is shown, and corners beyond are left out."""
    camera = Camera(640, 480, 525, 525, 319.5, 239.5, "plumb_bob", (-0.35, 0, 0, 0, 0))
    fold = np.sqrt(1 / (3 * 0.35))
    assert camera.max_angle_rad == pytest.approx(np.arctan(fold))
    shown, _ = camera.sampling(256)
    forward = equirectangular_rays(256)[..., 0]
    assert forward[shown].min() > np.cos(np.arctan(fold))
    y, x = np.mgrid[:480, :640]
    lost = np.hypot(x - 319.5, y - 239.5) / 525 > fold * (1 - 0.35 * fold**2)
    assert camera.lost_share == pytest.approx(lost.mean(), abs=0.01)
    assert np.isnan(camera.rays()[lost]).all()
    assert "of the pixels are ignored, because the lens distortion is not invertible there" in camera.notes[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": 4.2, "fy": 4.2}, r"field of view of 178.5 deg .*, expected 5 to 170 deg: set fx and fy in pixels"),
        ({"fx": 42000, "fy": 42000}, r"field of view of 0.8\d+ deg .*, expected 5 to 170"),
        ({"fx": 420, "fy": 150}, "fx 420 and fy 150, expected a ratio fx / fy from 0.5 to 2"),
        ({"fx": -420}, "expected finite numbers, with width, height, fx and fy above 0"),
        ({"cx": float("nan")}, "cx nan, .*expected finite numbers"),
        ({"width": "640"}, "width '640', .*expected finite numbers"),
        ({"cx": 960, "cy": 540}, "principal point cx 960, cy 540, expected a point in its image of 640 x 480"),
        (
            {"distortion_model": "ftheta"},
            "distortion_model of the camera is 'ftheta', expected one of none, plumb_bob, .*undistort",
        ),
        ({"distortion_model": ""}, "distortion_model of the camera is '', expected one of"),
        (
            {"distortion_model": "plumb_bob", "distortion": [0.1] * 4},
            r"4 coefficients, expected 5 \(k1, k2, p1, p2, k3",
        ),
        ({"distortion_model": "fisheye", "distortion": [0.1] * 5}, "5 coefficients, expected 4"),
        (
            {"distortion": [0.1]},
            "distortion of the camera has 1 coefficients, expected none for the distortion_model none",
        ),
        ({"distortion_model": "plumb_bob", "distortion": [0.1, np.inf, 0, 0, 0]}, "expected finite"),
        (
            {"distortion_model": "plumb_bob", "distortion": [-0.3, 0.1, -0.2, 0, 0]},
            "p1 -0.2 .*order k1, k2, p1, p2, k3",
        ),
        ({"distortion_model": "plumb_bob", "distortion": [-1.5, 0, 0, 0, 0]}, r"not invertible in \d+% of the image"),
        ({"distortion_model": "fisheye", "distortion": [-1.5, 0, 0, 0]}, "fisheye distortion .* is not invertible"),
        ({"T_base_camera": np.diag([1.0, 1, -1, 1])}, "left-handed"),
        ({"T_base_camera": 2 * LEVEL}, "is not a rigid motion"),
        ({"T_base_camera": LEVEL[:3]}, r"T_base_camera has shape \(3, 4\), expected \(4, 4\)"),
        ({"T_base_camera": translation(np.array([250.0, 0, 1200])) @ LEVEL}, "expected at most 10 m along each axis"),
    ],
)
def test_implausible_calibrations_are_refused(change, message):
    with pytest.raises(DataError, match=message) as error:
        Camera(**{**INTRINSICS, **change})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("fov_deg", [0, 4, 175, 180, -20, float("nan")])
def test_fields_of_view_that_no_pinhole_has(fov_deg):
    with pytest.raises(DataError, match="expected 5 to 170"):
        Camera.of_field_of_view(640, 480, fov_deg)
    with pytest.raises(DataError, match="looks up by 100 deg, expected -90 to 90"):
        Camera.of_field_of_view(640, 480, 60, elevation_deg=100)
    assert (options.MIN_FOV_DEG, options.MAX_FOV_DEG) == (cameras.MIN_FOV_DEG, cameras.MAX_FOV_DEG)


def test_an_unusual_direction_is_reported():
    assert Camera(**INTRINSICS).notes == ()
    assert Camera(**INTRINSICS, T_base_camera=UP_LEFT).notes == ()  # 53 deg down
    no_rotation, inverse = (Camera(**INTRINSICS, T_base_camera=T).notes for T in (np.eye(4), LEVEL.T))
    assert no_rotation[0].startswith(
        "the optical axis of the camera points up by 90 deg; expected T_base_camera to map the optical"
    )
    assert inverse[0].startswith("the image is rolled: its x axis has an elevation of 90 deg")


def written(path, **change):
    path.write_text(json.dumps({**INTRINSICS, "distortion_model": "none", "distortion": [], **change}))
    return path


def test_a_camera_is_read_from_its_file(tmp_path):
    camera = read_camera(written(tmp_path / "a.json"))
    np.testing.assert_array_equal(camera.matrix, K)
    np.testing.assert_array_equal(camera.T_base_camera, LEVEL)
    moved = written(tmp_path / "a.json", T_base_camera=UP_LEFT.tolist())
    np.testing.assert_array_equal(read_camera(moved).position_m, [0.3, -0.1, 0.9])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 640.5}, "a.json: key width: received 640.5, expected an integer"),
        ({"K": [1] * 9}, r"a\.json: unknown key K .*fx"),
        ({"distortion_model": "omni"}, r"a\.json: the distortion_model of the camera is 'omni', expected one of none"),
        ({"T_base_camera": [[1, 0], [0, 1]]}, r"a\.json: .*T_base_camera has shape \(2, 2\), expected \(4, 4\)"),
        ({"T_base_camera": [[1, 0], [0]]}, r"a\.json: .*T_base_camera has the type list, expected an array of numbers"),
        ({"cx": 1e13}, r"a\.json: key cx: received 1e\+13, expected a number from"),
    ],
)
def test_a_malformed_file_is_refused_in_one_line(tmp_path, change, message):
    with pytest.raises(DataError, match=message) as error:
        read_camera(written(tmp_path / "a.json", **change))
    assert "\n" not in str(error.value)
    (tmp_path / "a.json").write_text("[1]")
    with pytest.raises(DataError, match=r"a\.json contains a list, expected a JSON object"):
        read_camera(tmp_path / "a.json")
