"""The pixels of a box that show its object, on hand-made ranges."""

import numpy as np

from salframe.graphs.foreground import foreground


def test_the_object_in_a_box_is_what_its_median_lies_on():
    """A chair of 60 % of its box at 2 m, a hand before it, the wall at 4 m and a hole; the box spans 0.4 rad: 1.4 to
    2.4 m belong to it."""
    range_m = np.concatenate([np.linspace(1.8, 2.2, 60), np.full(5, 1.0), np.full(30, 4.0), np.full(5, np.nan)]).astype(
        np.float32
    )
    solid_angle_sr = np.full(100, 0.4**2 / 100)
    kept = foreground(range_m, solid_angle_sr)
    assert kept.tolist() == [True] * 60 + [False] * 40
    assert not foreground(np.full(100, np.nan, np.float32), solid_angle_sr).any()


def test_solid_angle_counts_and_not_pixels():
    """Near the pole of a panorama many pixels are little."""
    range_m = np.concatenate([np.full(80, 5.0), np.full(20, 2.0)]).astype(np.float32)
    kept = foreground(range_m, np.concatenate([np.full(80, 0.0002), np.full(20, 0.002)]))
    assert kept.tolist() == [False] * 80 + [True] * 20
