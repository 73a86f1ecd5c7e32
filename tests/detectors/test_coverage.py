"""Views, the grid under them, and merging, against rotations by scipy and hand-made overlaps."""

import numpy as np
import pytest
from salframe_detectors.coverage import MIN_FOV_DEG, RINGS, Rig
from salframe_detectors.depth import foreground
from salframe_detectors.merging import group, outline
from scipy.spatial.transform import Rotation

from salframe.panoramas.geometry import equirectangular_rays

RIG = Rig(96, 80, np.radians(90))
FOCAL_PX = 40.0  # half of the shorter side, at 45 deg


def rotations():
    """From camera axes (x right, y down, z forward) to the panorama frame: level, raised, then turned."""
    level = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)
    return [
        (Rotation.from_euler("z", 2 * np.pi * i / count) * Rotation.from_euler("y", -elevation_rad)).as_matrix() @ level
        for count, elevation_rad in RINGS
        for i in range(count)
    ]


@pytest.mark.parametrize("fov_deg", [MIN_FOV_DEG, 90, 120])
def test_every_direction_is_in_a_view(fov_deg):
    seen = Rig(96, 96, np.radians(fov_deg)).grid(256).visible
    assert seen.any(0).all()
    if fov_deg == 90:
        assert seen.sum(0).mean() > 2.4  # overlapping: a view holds 1/6 of the sphere


def test_views_show_what_lies_in_their_direction():
    rays = equirectangular_rays(256)
    views = RIG.cut(np.round((rays + 1) * 127).astype(np.uint8))
    assert views.shape == (16, 80, 96, 3)
    for view, rotation in zip(views, rotations(), strict=True):
        for x, y in ((48, 40), (10.5, 8.5), (90.5, 70.5)):
            towards = rotation @ [(x - 48) / FOCAL_PX, (y - 40) / FOCAL_PX, 1]
            shown = view[int(y), int(x)].astype(float) / 127 - 1
            assert shown == pytest.approx(towards / np.linalg.norm(towards), abs=0.025)


def test_a_box_covers_the_directions_inside_it():
    grid = RIG.grid(128)
    box = np.array([20.0, 10.0, 60.0, 44.0])
    for view, rotation in enumerate(rotations()):
        x, y, z = rotation.T @ grid.rays.T
        column, row = 48 + FOCAL_PX * x / z, 40 + FOCAL_PX * y / z
        inside = (z > 0) & (column >= 20) & (column <= 60) & (row >= 10) & (row <= 44)
        assert (grid.footprint(view, box) != inside).mean() < 2e-4  # rounding at the border
        left = np.broadcast_to(np.arange(96) < 40, (80, 96))
        assert (grid.footprint(view, box, left) != (inside & (column < 40))).mean() < 2e-4


def test_the_grid_measures_the_sphere():
    grid = RIG.grid(1024)
    assert (grid.step, grid.shape) == (4, (256, 512))
    assert grid.solid_angle_sr.sum() == pytest.approx(4 * np.pi, rel=1e-3)
    image = np.arange(1024 * 2048).reshape(1024, 2048)
    assert grid.thin(image)[:3].tolist() == [0, 4, 8]


# A sphere of ten pixels; view 0 shows the first six of them, view 1 the last six, view 2 all.
SEEN = np.zeros((3, 10), bool)
SEEN[0, :6] = SEEN[1, 4:] = SEEN[2] = True
AREA = np.ones(10)


def marks(*spans):
    footprint = np.zeros((len(spans), 10), bool)
    for row, (first, last) in zip(footprint, spans, strict=True):
        row[first : last + 1] = True
    return footprint


def groups(footprint, view, cut=None):
    cut = np.zeros(len(view), bool) if cut is None else np.array(cut)
    return [members.tolist() for members in group(footprint, np.array(view), cut, SEEN, AREA)]


def test_parts_that_agree_where_both_views_look_are_one():
    footprint = marks((2, 5), (4, 8))  # cut by the border of view 0, and by that of view 1
    assert groups(footprint, [0, 1]) == [[0, 1]]
    assert outline(footprint, np.array([0, 1]), SEEN).tolist() == marks((2, 8))[0].tolist()


def test_parts_that_do_not_agree_stay_apart():
    assert groups(marks((2, 3), (6, 8)), [0, 1]) == [[0], [1]]  # neither is where the other view looks
    assert groups(marks((4, 4), (5, 8)), [0, 1]) == [[0], [1]]


def test_a_view_shows_an_object_once():
    footprint = marks((0, 2), (2, 5), (0, 5))  # two in view 0, and one in view 2 over both
    assert groups(footprint, [0, 0, 2]) == [[0], [1, 2]]  # the second agrees more


def test_a_sliver_belongs_to_the_object_that_it_lies_in():
    footprint = marks((5, 5), (0, 9))  # they agree on one pixel of the six that both views show
    assert groups(footprint, [0, 2]) == [[0], [1]]
    assert groups(footprint, [0, 2], cut=[True, False]) == [[0, 1]]
    assert groups(footprint, [0, 2], cut=[False, True]) == [[0], [1]]
    footprint = marks((5, 5), (0, 4), (0, 9))
    assert groups(footprint, [0, 0, 2], cut=[True, False, False]) == [[0], [1, 2]]  # view 0 shows the large one already


def test_an_outline_is_where_most_views_put_it():
    footprint = marks((1, 5), (1, 4), (0, 4))
    assert outline(footprint, np.array([0, 2, 2]), SEEN).tolist() == marks((1, 4))[0].tolist()


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
