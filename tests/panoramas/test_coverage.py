"""Views and the grid under them, against rotations by scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from salframe.panoramas.coverage import MIN_FOV_DEG, RINGS, Rig
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
