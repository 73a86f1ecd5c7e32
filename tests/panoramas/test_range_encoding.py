"""Encodings of range images, against closed forms: a cube room, and a wall in front of a camera."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas import images
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.range_encoding import RangeEncoding


def test_unit_and_missing_values():
    steps = np.array([[0, 1, 512, 65535], [255, 1024, 2048, 7]])
    range_m = RangeEncoding(1 / 512, (65535, 255)).panorama_range(steps)
    np.testing.assert_array_equal(range_m, np.float32([[np.nan, 1 / 512, 1, np.nan], [np.nan, 2, 4, 7 / 512]]))


def test_depth_of_cube_faces_becomes_range_along_the_ray():
    """Every wall of a cube room of 4 m is 2 m away along the axis of its face: all points lie on the cube."""
    range_m = RangeEncoding(0.01, kind="cube").panorama_range(np.full((64, 128), 200))
    points = equirectangular_rays(64) * range_m[..., None]
    np.testing.assert_allclose(np.abs(points).max(axis=2), 2, atol=1e-5)
    assert range_m.max() == pytest.approx(2 * 3**0.5, rel=0.03)


@pytest.mark.parametrize("encoding", [RangeEncoding(0.00025), RangeEncoding(1 / 512, (65535,), "cube")])
def test_a_written_range_is_read_again(tmp_path, encoding):
    range_m = np.random.default_rng(0).uniform(0.5, 9, (32, 64))
    range_m[3, 4] = np.nan
    images.write_range(tmp_path / "a.png", range_m, encoding)
    np.testing.assert_allclose(images.read_range(tmp_path / "a.png", encoding), range_m, atol=2 * encoding.unit_m)


@pytest.mark.parametrize("kind", ["z", "ray"])
def test_depth_of_a_photograph_keeps_its_kind(kind):
    depth_m = RangeEncoding(0.002, (7,), kind).photograph_depth(np.array([[0, 7, 1500]]))
    np.testing.assert_array_equal(depth_m, np.array([[np.nan, np.nan, 3]], np.float32))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"unit_m": 0.0}, "range_unit_m is 0.0, expected the metres per unit of the range image"),
        ({"missing": (65536,)}, "range_missing has the value 65536, expected integers from 0 to 65535"),
        ({"missing": (1.5,)}, "range_missing has the value 1.5"),
        ({"kind": "depth"}, "range_kind is 'depth', expected one of ray, z, cube"),
    ],
)
def test_invalid_encodings_are_refused(values, message):
    with pytest.raises(DataError, match=message):
        RangeEncoding(**values)


def test_kinds_that_do_not_apply_are_refused():
    steps = np.full((8, 16), 2000)
    with pytest.raises(DataError, match=r"'cube' \(depth along the axis of the cube face"):
        RangeEncoding(kind="z").panorama_range(steps)
    with pytest.raises(DataError, match="range_kind is 'cube' for a photograph, expected 'z'"):
        RangeEncoding(kind="cube").photograph_depth(steps)
    with pytest.raises(DataError, match="the range image is 8 x 8, expected width = 2 x height"):
        RangeEncoding(kind="cube").panorama_range(steps[:, :8])
