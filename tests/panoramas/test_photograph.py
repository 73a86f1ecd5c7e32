import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.photograph import Pinhole


def test_a_level_camera_sees_its_field_of_view():
    camera = Pinhole.of_field_of_view(400, 400, np.pi / 2)
    inside, _, _ = camera.sees(180)
    azimuth = np.degrees(np.arctan2(*np.moveaxis(equirectangular_rays(180)[..., :2], -1, 0)[::-1]))
    assert inside[90].sum() == 90  # 1 deg a column, the horizon's row
    assert np.abs(azimuth[90][inside[90]]).max() < 45
    # A quarter of the view's six-fold cube: a square of 90 x 90 deg covers a sixth of the sphere.
    weight = np.hypot(*np.moveaxis(equirectangular_rays(180)[..., :2], -1, 0))
    assert (inside * weight).sum() / weight.sum() == pytest.approx(1 / 6, abs=1e-3)


def test_pitch_looks_up():
    up = Pinhole.of_field_of_view(200, 100, np.radians(60), pitch_rad=np.radians(30))
    axis = up.rotation[:, 2]
    np.testing.assert_allclose(axis, [np.cos(np.radians(30)), 0, 0.5], atol=1e-12)
    np.testing.assert_allclose(up.rotation[:, 0], [0, -1, 0], atol=1e-12)  # its right stays level


def test_a_wall_at_known_depth_has_the_range_of_a_plane():
    camera = Pinhole.of_field_of_view(640, 480, np.radians(70))
    panorama = camera.panorama("wall", np.full((480, 640, 3), 200, np.uint8), np.full((480, 640), 2.0), height=256)
    rays = equirectangular_rays(256)
    expected = 2.0 / rays[..., 0]
    np.testing.assert_allclose(panorama.range_m[panorama.valid], expected[panorama.valid], rtol=4e-3)
    assert np.isnan(panorama.range_m[~panorama.valid]).all()
    assert (panorama.rgb[panorama.valid] == 200).all()
    assert (panorama.rgb[~panorama.valid] == 0).all()


def test_holes_stay_holes_and_labels_come_back():
    camera = Pinhole.of_field_of_view(640, 480, np.radians(70), pitch_rad=-0.3)
    depth = np.full((480, 640), 2.0)
    depth[:, 320:] = np.nan
    panorama = camera.panorama("hole", np.zeros((480, 640, 3), np.uint8), depth)
    azimuth_left = equirectangular_rays(512)[..., 1] > 0.02
    assert np.isfinite(panorama.range_m[panorama.valid & azimuth_left]).all()
    assert np.isnan(panorama.range_m[panorama.valid & (equirectangular_rays(512)[..., 1] < -0.02)]).all()
    labels = np.arange(480)[:, None] // 60 + np.zeros((1, 640), int)
    back = camera.see(camera.lay_on_sphere(labels.astype(np.float32), 1024, smooth=False))
    assert (back == labels).mean() > 0.97  # but for the pixels at the borders of the bands


@pytest.mark.parametrize("hfov_deg", [0, 180, -20])
def test_fields_of_view_that_no_pinhole_has(hfov_deg):
    with pytest.raises(DataError, match="expected 0 to 180"):
        Pinhole.of_field_of_view(640, 480, np.radians(hfov_deg))


def test_images_of_another_size_are_refused():
    camera = Pinhole.of_field_of_view(640, 480, 1.0)
    with pytest.raises(DataError, match="the depth image is 320 x 240, expected 640 x 480"):
        camera.panorama("odd", np.zeros((480, 640, 3), np.uint8), np.ones((240, 320)))


def test_depth_is_checked_as_the_range_of_a_panorama():
    camera, rgb = Pinhole.of_field_of_view(64, 48, np.radians(70)), np.zeros((48, 64, 3), np.uint8)
    depth_m = np.full((48, 64), 2.0)
    depth_m[:, 20:44] = np.inf
    range_m = camera.panorama("wall", rgb, depth_m, height=64).range_m
    assert np.isnan(range_m[32, 64])
    assert np.nanmax(range_m) < 3  # 2 m at most 43 deg off the axis
    with pytest.raises(DataError, match="wall: depth_m has dtype uint16, expected float32 in metres"):
        camera.panorama("wall", rgb, np.full((48, 64), 2000, np.uint16))


def test_a_camera_with_a_mirror_or_degrees_is_refused():
    with pytest.raises(DataError, match="expected a rotation without scale or mirror"):
        Pinhole(64, 48, 40.0, (32.0, 24.0), np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(DataError, match=r"a pitch of 1718.87 deg, expected -90 to 90"):
        Pinhole.of_field_of_view(64, 48, 1.2, pitch_rad=30.0)
