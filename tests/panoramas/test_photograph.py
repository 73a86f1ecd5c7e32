"""Photographs as partial panoramas: what is seen, and at which range."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.photograph import lay_on_sphere, photograph_panorama, see_panorama


@pytest.mark.parametrize("kind", ["z", "ray"])
def test_a_wall_at_known_depth_has_the_range_of_a_plane(kind):
    camera = Camera.of_field_of_view(640, 480, 70)
    depth_m = np.full((480, 640), 2.0)
    if kind == "ray":
        y, x = np.mgrid[:480, :640]
        depth_m *= np.sqrt(1 + ((x - camera.cx) ** 2 + (y - camera.cy) ** 2) / camera.fx**2)
    rgb = np.full((480, 640, 3), 200, np.uint8)
    panorama = photograph_panorama(camera, "wall", rgb, depth_m, kind=kind, height=256)
    expected = 2.0 / equirectangular_rays(256)[..., 0]
    np.testing.assert_allclose(panorama.range_m[panorama.valid], expected[panorama.valid], rtol=2e-3)
    assert np.isnan(panorama.range_m[~panorama.valid]).all()
    assert (panorama.rgb[panorama.valid] == 200).all()
    assert (panorama.rgb[~panorama.valid] == 0).all()


def test_holes_stay_holes_and_labels_come_back():
    camera = Camera.of_field_of_view(640, 480, 70, elevation_deg=-17)
    depth = np.full((480, 640), 2.0)
    depth[:, 320:] = np.nan
    panorama = photograph_panorama(camera, "hole", np.zeros((480, 640, 3), np.uint8), depth, height=512)
    azimuth_left = equirectangular_rays(512)[..., 1] > 0.02
    assert np.isfinite(panorama.range_m[panorama.valid & azimuth_left]).all()
    assert np.isnan(panorama.range_m[panorama.valid & (equirectangular_rays(512)[..., 1] < -0.02)]).all()
    labels = np.arange(480)[:, None] // 60 + np.zeros((1, 640), int)
    back = see_panorama(camera, lay_on_sphere(camera, labels, 1024, smooth=False))
    assert (back == labels).mean() > 0.97  # but for the pixels at the borders of the bands


def test_objects_are_annotated_where_they_are_seen():
    camera = Camera.of_field_of_view(100, 100, 90)
    ids = np.zeros((100, 100), np.int32)
    ids[:, 50:] = 70  # to the right
    rgb = np.zeros((100, 100, 3), np.uint8)
    panorama = photograph_panorama(camera, "bed", rgb, instance_id=ids, labels={70: "bed"}, height=180)
    instance_id = panorama.annotations.instance_id
    assert panorama.annotations.labels == {70: "bed"}
    assert set(np.unique(instance_id)) == {0, 70}
    right = equirectangular_rays(180)[..., 1] < 0
    np.testing.assert_array_equal(instance_id == 70, panorama.valid & right)


def test_images_of_another_size_are_refused():
    camera = Camera.of_field_of_view(640, 480, 57)
    with pytest.raises(DataError, match="the depth image is 320 x 240, expected 640 x 480"):
        photograph_panorama(camera, "odd", np.zeros((480, 640, 3), np.uint8), np.ones((240, 320)))


def test_depth_is_checked_as_the_range_of_a_panorama():
    camera, rgb = Camera.of_field_of_view(64, 48, 70), np.zeros((48, 64, 3), np.uint8)
    depth_m = np.full((48, 64), 2.0)
    depth_m[:, 20:44] = np.inf
    range_m = photograph_panorama(camera, "wall", rgb, depth_m, height=64).range_m
    assert np.isnan(range_m[32, 64])
    assert np.nanmax(range_m) < 3  # 2 m at most 43 deg off the axis
    with pytest.raises(DataError, match="wall: depth_m has dtype uint16, expected floating-point metres"):
        photograph_panorama(camera, "wall", rgb, np.full((48, 64), 2000, np.uint16))


def test_an_image_of_higher_resolution_is_averaged_in_place():
    """The left half is bright: the edge stays at azimuth 0, to a tenth of a pixel of the panorama."""
    camera = Camera.of_field_of_view(4000, 400, 70)
    rgb = np.zeros((400, 4000, 3), np.uint8)
    rgb[:, :2000] = 200
    panorama = photograph_panorama(camera, "edge", rgb)
    assert len(panorama.rgb) == 1024  # an eighth of the photograph's resolution
    row = panorama.rgb[512, :, 0][panorama.valid[512]]
    assert row.sum() / 200 == pytest.approx(len(row) / 2, abs=0.1)
