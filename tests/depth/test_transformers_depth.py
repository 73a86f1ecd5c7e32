"""The range model `transformers-depth` on each architecture: ranges in closed form in painted panoramas, and outputs
equal to those of the library."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import tiny_depth_models as tiny
from conformance import conforms
from PIL import Image
from salframe_depth.monocular import MonocularDepth
from salframe_depth.transformers_depth import TransformersDepth
from tiny_depth_models import MAX_DEPTH_M, depth_output
from tiny_models import SIDE_PX, edit_config, random_weights

from salframe.framework.components.presets import configure
from salframe.framework.errors import ConfigError, WeightsError
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama

HEIGHT = 128
METRIC = (tiny.metric_depth_anything, tiny.zoedepth, tiny.glpn)
RELATIVE = (tiny.dpt, tiny.depth_anything)


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Return a function that saves a model once and returns its folder."""
    root, saved = tmp_path_factory.mktemp("models"), {}

    def folder(make):
        if make not in saved:
            saved[make] = random_weights(make, root / make.__name__)
        return saved[make]

    return folder


def build(folder, **settings) -> TransformersDepth:
    return TransformersDepth(configure("range-model", "transformers-depth", {"model": str(folder), **settings}))


def painted(reds: dict[float, int], others: int = 120) -> Panorama:
    """A panorama of one red, with squares of 26 degrees of other reds at these azimuths in degrees on the horizon.

    Its middle is the brightest column, so that the range model does not turn it.
    """
    rays = equirectangular_rays(HEIGHT)
    azimuth, elevation = np.degrees(np.arctan2(rays[..., 1], rays[..., 0])), np.degrees(np.arcsin(rays[..., 2]))
    rgb = np.full((HEIGHT, 2 * HEIGHT, 3), (others, 0, 0), np.uint8)
    rgb[:, HEIGHT, 1:] = 255
    for centre, red in reds.items():
        beside = np.abs((azimuth - centre + 180) % 360 - 180) < 13
        rgb[beside & (np.abs(elevation) < 13), 0] = red
    return Panorama("painted", rgb=rgb)


def range_at(range_m: np.ndarray, azimuth_deg: float, elevation_deg: float = 0.0) -> float:
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    direction = [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    rays = equirectangular_rays(HEIGHT)
    return float(np.median(range_m[rays @ np.float32(direction) > np.cos(np.radians(3))]))


def test_a_colour_gives_a_depth_in_metres(models):
    """A square in the middle of a view has the z-depth of its colour, which no other view shows."""
    reds = {60.0: 20, -120.0: 220, -60.0: 160}
    model = build(models(tiny.metric_depth_anything))
    assert (model.quantity, model.metric) == ("z-depth", True)
    range_m = model.estimate(painted(reds))
    for azimuth, red in reds.items():
        assert range_at(range_m, azimuth) == pytest.approx(depth_output(red, metric=True), rel=0.02)
    assert depth_output(220, metric=True) > 1.3 * depth_output(20, metric=True)
    # Between two views whose axes are 30 degrees away, and at the pole, 30 degrees from four axes.
    elsewhere = float(depth_output(120, metric=True))
    assert range_at(range_m, 150) == pytest.approx(elsewhere / np.cos(np.radians(30)), rel=0.03)
    assert range_at(range_m, 0, 90) == pytest.approx(elsewhere / np.cos(np.radians(30)), rel=0.03)


@pytest.mark.parametrize("make", [*RELATIVE, tiny.metric_depth_anything, tiny.glpn])
def test_outputs_are_those_of_the_pipeline(models, make):
    model = build(models(make), camera_height_m=1.5, size_px=(SIDE_PX, SIDE_PX))
    rng = np.random.default_rng(0)
    width, height = model.size_px
    pipeline = tiny.transformers.pipeline("depth-estimation", model=str(models(make)), device="cpu")
    for _ in range(2):
        small = Image.fromarray(rng.integers(0, 255, (8, 8, 3), np.uint8))
        image = np.array(small.resize((width, height)))
        (depth,) = model._run_network(image[None])
        expected = pipeline(Image.fromarray(image))["predicted_depth"].numpy()
        assert depth.shape == expected.shape
        np.testing.assert_allclose(depth, expected, rtol=1e-4, atol=1e-5)


def test_zoedepths_output_is_that_of_its_network_without_padding(models):
    """The pipeline of the library needs torchvision for it."""
    model = build(models(tiny.zoedepth))
    assert (model.quantity, model.metric) == ("z-depth", True)
    image = np.random.default_rng(0).integers(0, 255, (SIDE_PX, SIDE_PX, 3), np.uint8)
    (depth,) = model._run_network(image[None])
    network = tiny.transformers.ZoeDepthForDepthEstimation.from_pretrained(models(tiny.zoedepth)).eval()
    colour = tiny.torch.from_numpy(image).permute(2, 0, 1)[None].float() / 255
    with tiny.torch.inference_mode():
        expected = network((colour - 0.5) / 0.5).predicted_depth[0].numpy()
    np.testing.assert_allclose(depth, expected, rtol=1e-4)


@pytest.mark.parametrize("make", RELATIVE)
def test_a_colour_gives_an_inverse_depth(models, make):
    model = build(models(make), camera_height_m=1.5)
    assert (model.quantity, model.metric) == ("inverse", False)
    reds = np.array([10.0, 100.0, 240.0])
    views = np.stack([np.full((SIDE_PX, SIDE_PX, 3), red, np.uint8) for red in reds])
    linear = tiny.GAIN * (2 * reds / 255 - 1) + tiny.OFFSET
    expected = linear if make is tiny.dpt else depth_output(reds, metric=False)
    for output, value in zip(model._run_network(views), expected, strict=True):
        np.testing.assert_allclose(output[4:-4, 4:-4], value, rtol=1e-4)


@pytest.mark.parametrize("make", RELATIVE)
def test_views_of_a_relative_network_are_merged_as_inverse_depth_of_unknown_scale_and_shift(models, make):
    """Compared with the shared merging of outputs that the library computes from the views."""
    model = build(models(make), camera_height_m=1.5)
    network = getattr(tiny.transformers, model._model.architecture).from_pretrained(models(make)).eval()

    class Direct(MonocularDepth):
        name, version, quantity, metric, size_px = "direct", "1", "inverse", False, (SIDE_PX, SIDE_PX)

        def _run_network(self, images):
            colour = tiny.torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255
            with tiny.torch.inference_mode():
                return network((colour - 0.5) / 0.5).predicted_depth.numpy()

    small = Image.fromarray(np.random.default_rng(0).integers(0, 255, (16, 32, 3), np.uint8))
    panorama = Panorama("random", rgb=np.array(small.resize((2 * HEIGHT, HEIGHT))))
    direct = Direct(model.config)
    direct._scale_to_floor = model._scale_to_floor = lambda range_m: range_m
    ours, expected = model.estimate(panorama), direct.estimate(panorama)
    assert np.isfinite(expected).mean() > 0.1
    np.testing.assert_allclose(ours, expected, rtol=0.01)


def test_a_relative_network_needs_the_height_of_the_camera(models):
    with pytest.raises(
        ConfigError, match="expected ranges in metres: choose a network that outputs metres, or set cam"
    ):
        build(models(tiny.dpt))


def test_conformance(models):
    settings = {"model": str(models(tiny.metric_depth_anything)), "size_px": (32, 32)}
    assert conforms(TransformersDepth, configure("range-model", "transformers-depth", settings))


def test_ranges_are_scaled_to_the_floor(models):
    """The ranges of a metric network are multiplied by the ratio of the heights of the camera."""
    panorama = painted({})
    metric = build(models(tiny.metric_depth_anything)).estimate(panorama)
    scaled = build(models(tiny.metric_depth_anything), camera_height_m=2.0).estimate(panorama)
    ratio = scaled / metric
    assert np.ptp(ratio[np.isfinite(ratio)]) < 1e-3
    assert np.nanmax(metric) < 2 * MAX_DEPTH_M


def test_one_line_says_what_does_not_fit(models, tmp_path):
    def refused(folder, message):
        with pytest.raises(WeightsError, match=message) as caught:
            build(folder, camera_height_m=1.5)
        assert "\n" not in str(caught.value)

    with pytest.raises(
        WeightsError, match="the range model 'transformers-depth' has no network: set the setting `model` to the folder"
    ):
        TransformersDepth(configure("range-model", "transformers-depth", {}))
    refused(
        tmp_path / "gone", r"gone does not exist, expected a folder with config\.json and model\.safetensors, or hf:"
    )
    refused("hf:org/model", "the model hf:org/model is not downloaded; download it with: salframe weights fetch hf:")
    folder = tmp_path / "model"
    shutil.copytree(models(tiny.dpt), folder)
    edit_config(folder, architectures=["DPTForSemanticSegmentation"])
    refused(folder, r"has the architectures \['DPTForSemanticSegmentation'\], expected one of those")
