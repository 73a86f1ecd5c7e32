"""Range by depth networks of known answers: closed forms in rooms whose colour holds their range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conformance import conforms
from painted_rooms import FOV_DEG, PLAIN, painted, write_network
from salframe_depth import monocular
from salframe_depth.range_model import OnnxDepth
from salframe_depth.views import DepthRig

from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure
from salframe.framework.errors import ConfigError, WeightsError
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.turning import turned
from salframe.testing.rooms import EYE_M, ROOMS, halved

STEP = 0.0054
"""Of the painted ranges."""


@pytest.fixture
def network(tmp_path):
    return lambda *args, **settings: write_network(tmp_path / "depth.onnx", *args, **settings)


def build(path, **settings) -> OnnxDepth:
    return OnnxDepth(configure("range-model", "onnx-depth", {"model": str(path), **PLAIN, **settings}))


def errors(model: OnnxDepth, panorama: Panorama) -> np.ndarray:
    """Shares by which ranges are off, 1 where they are not known."""
    return np.nan_to_num(np.abs(model.estimate(panorama) / panorama.range_m - 1), nan=1.0)


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
@pytest.mark.parametrize("gives", ["inverse", "z-depth", "range", "points"])
def test_a_metric_network_gives_the_range(network, gives, room):
    off = errors(build(network(gives), gives=gives, metric=True), painted(room))
    assert np.median(off) < STEP
    assert np.quantile(off, 0.95) < 2 * STEP


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
@pytest.mark.parametrize(("gives", "shift"), [("inverse", 0.3), ("z-depth", 0.8), ("range", 0.0), ("points", 0.0)])
def test_each_views_scale_and_shift_are_found_and_the_floor_gives_the_metre(network, gives, shift, room, monkeypatch):
    path = network(gives, times=7.0, spread=2.0, shift=shift)
    model, panorama = build(path, gives=gives, camera_height_m=EYE_M), painted(room)
    off = errors(model, panorama)
    assert np.median(off) < STEP
    assert np.quantile(off, 0.95) < 2 * STEP
    # Without alignment the same network is far off: its views do differ.
    monkeypatch.setattr(monocular, "align", lambda terms: np.eye(1, terms.shape[-1]).repeat(len(terms), 0))
    assert np.median(errors(model, panorama)) > 0.05


def test_views_that_differ_little_are_still_metric_on_the_whole(network):
    off = build(network("z-depth", spread=0.2), gives="z-depth", metric=True).estimate(painted(ROOMS[0]))
    shares = off / painted(ROOMS[0]).range_m
    assert np.ptp(np.quantile(shares, [0.05, 0.95])) < 2 * STEP
    assert np.median(shares) == pytest.approx(1, abs=0.1)


def test_noise_of_each_view_is_borne(network, monkeypatch):
    """Every view's depth is bent and noisy by some percent."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[-1:1:128j, -1:1:128j]
    run_network = OnnxDepth._run_network

    def bent(model, images):
        depth = run_network(model, images)
        noise = [0.03 * (rng.normal() * x + rng.normal() * y + 0.5 * rng.normal(size=x.shape)) for _ in depth]
        return (depth * np.exp(noise)).astype(np.float32)

    model = build(network("z-depth", spread=1.0, shift=0.8), gives="z-depth", camera_height_m=EYE_M)
    monkeypatch.setattr(OnnxDepth, "_run_network", bent)
    off = errors(model, painted(ROOMS[0]))
    assert np.median(off) < 0.04
    assert np.quantile(off, 0.9) < 0.1


def test_a_whole_panorama_at_once(network):
    path = network("range", size_px=(384, 192), times=3.0)
    off = errors(build(path, gives="range", input="equirectangular", camera_height_m=EYE_M), painted(ROOMS[1]))
    assert np.quantile(off, 0.95) < 2 * STEP
    path = network("inverse", size_px=(384, 192))
    off = errors(build(path, gives="inverse", input="equirectangular", metric=True), painted(ROOMS[1]))
    assert np.quantile(off, 0.95) < 2 * STEP


@pytest.mark.parametrize("size_px", [(160, 112), (112, 160)])
@pytest.mark.parametrize("fov_deg", [75.0, 105.0])
def test_views_of_any_shape_and_field_of_view(network, size_px, fov_deg):
    path = network("z-depth", size_px=size_px, fov_deg=fov_deg, layout="none")
    off = errors(build(path, gives="z-depth", metric=True, fov_deg=fov_deg), painted(ROOMS[2]))
    assert np.quantile(off, 0.95) < 2 * STEP


@pytest.mark.parametrize("views", [6, 8])
@pytest.mark.parametrize(("width", "height"), [(100, 100), (160, 90), (90, 160)])
def test_every_direction_is_in_a_view_and_most_are_in_two(views, width, height):
    rig = DepthRig.around(views, width, height, np.radians(FOV_DEG))
    rays = equirectangular_rays(64)
    assert np.allclose(np.linalg.det(rig.rotations), 1)
    counts = sum((rig.project_rays(view, rays).weight > 0).astype(int) for view in range(rig.count))
    assert counts.min() >= 1
    assert (counts >= 2).mean() > 0.9


def test_a_view_looks_where_its_pixels_come_from():
    rig = DepthRig.around(6, 90, 120, np.radians(FOV_DEG))
    pixels = np.array([[0.5, 0.5], [45, 60], [80.5, 20.5]])
    for view in range(rig.count):
        look = rig.project_rays(view, rig.bearings(view, pixels).astype(np.float32))
        assert (look.x + 1) * 45 == pytest.approx(pixels[:, 0], abs=1e-3)
        assert (look.y + 1) * 60 == pytest.approx(pixels[:, 1], abs=1e-3)


def test_turning_the_panorama_turns_its_range(network):
    model, panorama = build(network(spread=1.0, shift=0.3), camera_height_m=EYE_M), painted(ROOMS[0])
    before = model.estimate(panorama)
    for columns in (1, 37, 192):
        assert np.array_equal(model.estimate(turned(panorama, columns)), np.roll(before, columns, 1), equal_nan=True)


@pytest.mark.parametrize("gives", ["inverse", "z-depth", "range"])
@pytest.mark.parametrize("scale", [{"metric": True}, {"camera_height_m": 1.5}])
def test_of_a_network_that_sees_nothing_no_range_is_known(network, gives, scale):
    model = build(network(gives, times=0.0), gives=gives, **scale)
    assert np.isnan(model.estimate(painted(ROOMS[0]))).all()


def test_a_partial_panorama_is_estimated_where_it_was_seen(network):
    half = halved(painted(ROOMS[0]))
    model = build(network("z-depth", spread=1.0, shift=0.8), gives="z-depth", camera_height_m=EYE_M)
    off = errors(model, replace(half, range_m=painted(ROOMS[0]).range_m))[half.valid]
    assert np.quantile(off, 0.9) < 4 * STEP


def test_where_no_floor_is_seen_only_a_metric_network_knows_the_range(network):
    panorama = painted(ROOMS[0])
    above = replace(panorama, valid=np.arange(192)[:, None].repeat(384, 1) < 96)
    path = network("z-depth")
    assert np.isnan(build(path, gives="z-depth", camera_height_m=1.0).estimate(above)).all()
    off = errors(build(path, gives="z-depth", camera_height_m=1.0, metric=True), above)
    assert np.quantile(off[:90], 0.95) < 2 * STEP


@pytest.mark.parametrize("gives", ["inverse", "points"])
def test_it_conforms(network, gives):
    path = network(gives)
    config = configure("range-model", "onnx-depth", {"model": str(path), **PLAIN, "gives": gives, "metric": True})
    assert conforms(OnnxDepth, config)


def test_another_content_of_the_file_is_another_model(network):
    first = identity(build(network(), metric=True).config)
    assert identity(build(network(times=2.0), metric=True).config) != first
    assert identity(build(network(), metric=True).config) == first


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "'onnx-depth' is unknown, expected ranges in metres: set metric=true .* or set camera_height_m"),
        (
            {"metric": True, "size_px": (64, 64)},
            r"has the inputs image float32 \(1, 3, 128, 128\), .*\(\*, 3, 64, 64\)",
        ),
        (
            {"metric": True, "gives": "points"},
            r"returned a first output of shape \(1, 1, 128, 128\), expected \(1, 3, height, width\)",
        ),
        ({"metric": True, "input": "equirectangular"}, "takes images of 128 x 128, expected width = 2 x height"),
        (
            {"metric": True, "input": "equirectangular", "gives": "z-depth"},
            "the range model 'onnx-depth' received gives=z-depth with input=equirectangular",
        ),
    ],
)
def test_settings_that_do_not_fit_are_told_in_one_line(network, settings, message):
    with pytest.raises((ConfigError, WeightsError), match=message) as caught:
        build(network(), **settings)
    assert "\n" not in str(caught.value)


def test_a_model_that_is_not_there_is_told(tmp_path):
    with pytest.raises(
        WeightsError, match="the range model 'onnx-depth' has no network: set `model` to the path of an ONNX file"
    ):
        OnnxDepth(OnnxDepth.Config(metric=True))
    with pytest.raises(WeightsError, match=r"nothing\.onnx, which does not exist; expected the path"):
        build(tmp_path / "nothing.onnx", metric=True)
