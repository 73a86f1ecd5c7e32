from __future__ import annotations

import numpy as np
import pytest
from salframe_panoseg.detector import from_panorama, into_panorama
from salframe_panoseg.objects import MIN_POINTS, group_pixels

H, W = 32, 64


def scene(*blocks: tuple[slice, slice, int, tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Classes and voted centres of an image with blocks of pixels."""
    class_id, centre_m = np.zeros((H, W), np.uint8), np.zeros((H, W, 3))
    for rows, columns, kind, centre in blocks:
        class_id[rows, columns], centre_m[rows, columns] = kind, centre
    return class_id, centre_m


SEEN = np.ones((H, W), bool)
POINTS_M = np.zeros((H, W, 3))
"""Where the surfaces are matters only to how long an object is."""


def test_touching_objects_of_a_class_come_apart_by_their_votes():
    class_id, centre_m = scene(
        (slice(8, 16), slice(10, 20), 3, (1, 0, 0)), (slice(8, 16), slice(20, 30), 3, (1, 0.8, 0))
    )
    objects = group_pixels(class_id, POINTS_M, centre_m, SEEN)
    assert np.unique(objects[8:16, 10:20]).tolist() != np.unique(objects[8:16, 20:30]).tolist()
    assert objects.max() == 2
    assert (objects > 0).sum() == 160


def test_an_object_cut_by_the_seam_or_by_what_stands_before_it_is_one():
    seam = scene((slice(8, 16), slice(0, 5), 3, (1, 0, 0)), (slice(8, 16), slice(58, 64), 3, (1, 0, 0)))
    assert group_pixels(seam[0], POINTS_M, seam[1], SEEN).max() == 1
    cut = scene((slice(8, 16), slice(10, 30), 3, (1, 0, 0)), (slice(8, 16), slice(19, 23), 5, (0.5, 0, 0)))
    objects = group_pixels(cut[0], POINTS_M, cut[1], SEEN)
    assert objects.max() == 2
    assert objects[10, 12] == objects[10, 28] != objects[10, 21]


@pytest.mark.parametrize("turn", [0.0, 0.8])
@pytest.mark.parametrize(("length_m", "count"), [(1.25, 1), (1.15, 2)])
def test_parts_whose_votes_differ_by_less_than_the_larger_is_long_are_one(length_m, count, turn):
    class_id, centre_m = scene(
        (slice(8, 16), slice(10, 20), 3, (1, 0, 0)), (slice(8, 16), slice(20, 26), 3, (1, 1.2, 0))
    )
    points_m = POINTS_M.copy()
    along = (np.arange(10) + 0.5) / 10 * length_m
    points_m[:, 10:20, :2] = along[:, None] * (np.cos(turn), np.sin(turn))
    assert group_pixels(class_id, points_m, centre_m, SEEN).max() == count


def test_two_classes_at_one_place_are_two_objects_and_what_is_unseen_or_tiny_is_none():
    tiny = (slice(0, 1), slice(0, MIN_POINTS - 1), 6, (2, 2, 2))
    class_id, centre_m = scene(
        (slice(8, 16), slice(10, 20), 3, (1, 0, 0)), (slice(8, 16), slice(20, 30), 4, (1, 0, 0)), tiny
    )
    seen = SEEN.copy()
    seen[:, 26:] = False
    objects = group_pixels(class_id, POINTS_M, centre_m, seen)
    assert objects.max() == 2
    assert (objects[:, 26:] == 0).all()
    assert (objects[0] == 0).all()


def test_turning_the_panorama_turns_the_objects():
    rng = np.random.default_rng(0)
    class_id = np.repeat(np.repeat(rng.integers(0, 4, (H // 8, W // 8)), 8, 0), 8, 1)
    centre_m = np.repeat(np.repeat(rng.uniform(-2, 2, (H // 8, W // 8, 3)), 8, 0), 8, 1)
    objects = np.roll(group_pixels(class_id, POINTS_M, centre_m, SEEN), 24, 1)
    turned = group_pixels(np.roll(class_id, 24, 1), POINTS_M, np.roll(centre_m, 24, 1), SEEN)
    pairs = set(zip(objects.ravel().tolist(), turned.ravel().tolist(), strict=True))
    assert len(pairs) == objects.max() + 1  # the same partition, numbered otherwise


def test_votes_point_from_a_pixel_to_its_centre_in_the_panorama_frame():
    offset_m = np.random.default_rng(0).normal(size=(H, W, 3))
    np.testing.assert_allclose(into_panorama(from_panorama(offset_m)), offset_m, atol=1e-12)
    ahead = np.zeros((3, H, W))
    ahead[0] = 2  # two metres on, whichever way the pixel looks
    found = into_panorama(ahead)
    assert found[0, W // 2] == pytest.approx(
        (2, 0, 0), abs=0.11
    )  # the middle column looks along x, give or take half a pixel
    assert found[0, W // 4] == pytest.approx((0, 2, 0), abs=0.11)  # a quarter to the left, along y
