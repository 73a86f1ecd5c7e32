"""How objects show: made images whose outlines and solid angles are counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.graphs.annotated import visible_objects
from salframe.graphs.boxes import box_solid_angle
from salframe.graphs.visibility import hidden_shares, object_visibility
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama

HEIGHT = 64


def image(shift=0):
    """A square of 12 x 12 pixels 4 m away; the right half of it lies behind one of 2 m that begins in its middle, also
    12 x 12; walls at 5 m."""
    ids, range_m = np.zeros((HEIGHT, 2 * HEIGHT), np.int32), np.full((HEIGHT, 2 * HEIGHT), 5, np.float32)
    for number, column, distance in ((1, 40, 4), (2, 46, 2)):
        ids[30:42, column : column + 12], range_m[30:42, column : column + 12] = number, distance
    return np.roll(ids, shift, 1), np.roll(range_m, shift, 1)


@pytest.mark.parametrize("shift", [0, 30, -46, 81])
def test_hidden_is_the_share_of_the_outline_that_something_nearer_borders(shift):
    """What is left of the first is 6 x 12 pixels: 36 edges, of which the 12 on the right are the second's; turned, the
    image's seam cuts one of them."""
    background, first, second = hidden_shares(*image(shift))
    assert first == pytest.approx(12 / 36)
    assert second == 0
    assert background == 1  # 30 edges at the first, 36 at the second, and all of them nearer


def test_what_borders_at_about_the_same_range_hides_nothing():
    ids, range_m = image()
    range_m[42:] = 4 * 0.96  # the floor before the feet
    assert hidden_shares(ids, range_m)[1] == pytest.approx(12 / 36)
    range_m[42:] = 4 * 0.94
    assert hidden_shares(ids, range_m)[1] == pytest.approx((12 + 6) / 36)


def test_nothing_borders_what_fills_the_sphere():
    assert np.isnan(hidden_shares(np.ones((4, 8), np.int32), np.ones((4, 8), np.float32))[1])


def test_sightings_of_an_image():
    ids, range_m = image()
    panorama = Panorama("x", range_m=range_m, annotations=Annotations(ids, {1: "near", 2: "far"}))
    shown = object_visibility(panorama, visible_objects(panorama))
    assert shown.labels == ("near", "far")
    low, high = np.sin(np.pi / 2 - np.pi * np.array([42, 30]) / HEIGHT)
    np.testing.assert_allclose(shown.solid_angle_sr, np.array([6, 12]) * np.pi / HEIGHT * (high - low), rtol=1e-9)
    np.testing.assert_allclose(shown.hidden_share, [1 / 3, 0])
    np.testing.assert_allclose(shown.range_m, [4, 2], rtol=0.03)  # the centroid of a patch of a sphere lies within it
    blind = Panorama("x", annotations=Annotations(ids, {1: "near", 2: "far"}))
    unranged = object_visibility(blind, visible_objects(blind))
    np.testing.assert_array_equal(unranged.solid_angle_sr, shown.solid_angle_sr)
    assert np.isnan([unranged.range_m, unranged.hidden_share]).all()


def test_the_mean_shadow_of_a_box_is_a_quarter_of_its_surface():
    """A cube of 2 m has 24 m2 of surface; a box seen from 20,000 random sides shows the sum of its faces' shadows."""
    assert box_solid_angle(np.array([2, 2, 2]), 10) == pytest.approx(24 / 4 / 100)
    size = np.array([1.0, 0.5, 2.0])
    sides = np.random.default_rng(0).standard_normal((20_000, 3))
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    faces = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    assert box_solid_angle(size, 3) == pytest.approx((np.abs(sides) @ faces).mean() / 9, rel=0.01)


def test_sightings_of_a_list_have_boxes_and_nothing_hides_them_that_is_known():
    boxes = ObjectBoxes(("bed",), ("k",), np.array([[3.0, 4.0, 0.0]]), np.array([[2.0, 1.5, 0.6]]), np.zeros(1))
    panorama = Panorama("x", annotations=Annotations(objects=boxes))
    shown = object_visibility(panorama, visible_objects(panorama))
    assert shown.range_m == pytest.approx(5, abs=1e-5)
    assert shown.solid_angle_sr == pytest.approx((3.0 + 0.9 + 1.2) / 2 / 25, abs=1e-5)
    assert np.isnan(shown.hidden_share).all()
