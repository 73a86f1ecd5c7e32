import numpy as np
from salframe_height_bands import HeightBands

from salframe.panoramas.geometry import row_elevation
from salframe.panoramas.panorama import Panorama
from salframe.testing import check_component


def test_it_keeps_the_rules_of_its_role():
    check_component(HeightBands)


def test_a_cupboard_across_the_seam_is_one_tall_object():
    """A round hall of radius 4 m, 2.6 m high, seen from 1.5 m above the floor; in it, 1 m behind the camera, a front 2
    m high."""
    elevation_rad = row_elevation(128)[:, None] * np.ones((1, 256))
    hall_m = np.minimum(4 / np.cos(elevation_rad), np.where(elevation_rad > 0, 1.1, -1.5) / np.sin(elevation_rad))
    behind = np.abs(np.arange(256) - 127.5) > 120
    front = behind & (np.abs(np.tan(elevation_rad) + 0.5) < 1)  # from 1.5 m below the camera to 0.5 m above it
    range_m = np.where(front, 1 / np.cos(elevation_rad), hall_m).astype(np.float32)
    found = HeightBands().detect(Panorama("hall", range_m=range_m))
    assert found.labels == ("tall object",)
    np.testing.assert_allclose(found.centroid_m[0, :2], (-1, 0), atol=0.02)
