"""Outlines compared with the closed forms of balls, boxes and circles."""

import numpy as np
import pytest
from ball_plugin import angular_radius, visible_points

from salframe.drawing.outlines import outline_objects
from salframe.graphs.boxes import detections_from_points
from salframe.graphs.detections import Detections

PIXEL = np.pi / 256


def seen_as(points_m) -> Detections:
    return detections_from_points(["ball"], np.ones(1), [points_m])


def angles(lines, towards) -> np.ndarray:
    rays = np.concatenate(lines)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1)
    return np.arccos(rays @ (np.array(towards) / np.linalg.norm(towards)))


@pytest.mark.parametrize(
    "centre_m",
    [(2.0, 0.0, 0.0), (-2.0, 0.0, 0.1), (0.6, 0.6, 2.0), (0.0, 0.0, -1.5), (0.1, 0.0, 1.2)],
    ids=["ahead", "on the seam", "high", "nadir", "zenith"],
)
def test_a_ball_is_a_circle_of_its_angular_radius_wherever_it_is(centre_m):
    (lines,) = outline_objects(seen_as(visible_points(centre_m, 0.5)))
    assert len(lines) == 1
    off = angles(lines, centre_m) - angular_radius(centre_m, 0.5)
    assert np.abs(off).max() < 1.5 * PIXEL
    assert abs(off.mean()) < 0.5 * PIXEL


def test_an_object_in_two_parts_has_two_lines_and_specks_none():
    left, right = visible_points((2.0, 1.0, 0.0), 0.3), visible_points((2.0, -1.0, 0.0), 0.3)
    speck = visible_points((2.0, 0.0, 1.5), 0.02)
    assert len(speck) > 0
    (lines,) = outline_objects(seen_as(np.concatenate([left, right, speck])))
    assert len(lines) == 2
    sides = sorted(float(line[:, 1].mean()) for line in lines)
    np.testing.assert_allclose(sides, [-1 / np.sqrt(5), 1 / np.sqrt(5)], atol=2 * PIXEL)


def test_a_box_without_points_is_the_hull_of_its_corners():
    """A box 2 m ahead, 1 m deep, 0.8 m wide, 0.6 m high: its front, 1.5 m away, hides the rest."""
    numbers = np.ones(1), np.array([[2.0, 0, 0]]), np.array([[1.0, 0.8, 0.6]]), np.zeros(1)
    ((line,),) = outline_objects(Detections(("box",), *numbers))
    across, up = np.abs(line[:, 1] / line[:, 0]), np.abs(line[:, 2] / line[:, 0])
    assert across.max() == pytest.approx(0.4 / 1.5)
    assert up.max() == pytest.approx(0.3 / 1.5)
    # Edges that are straight in space are straight in any photograph: every point lies on a side of the rectangle.
    assert np.minimum(np.abs(across - 0.4 / 1.5), np.abs(up - 0.3 / 1.5)).max() < 1e-9


def test_a_turned_box_is_turned():
    numbers = np.ones(1), np.array([[3.0, 0, 0]]), np.array([[2.0, 0.1, 0.5]]), np.array([np.pi / 2])
    ((line,),) = outline_objects(Detections(("box",), *numbers))
    assert np.abs(line[:, 1] / line[:, 0]).max() == pytest.approx(1 / 2.95)


def test_a_bearing_and_a_solid_angle_are_a_circle():
    unknown, bearing = np.full((1, 3), np.nan), np.array([[0, 0.6, 0.8]])
    solid_angle_sr = np.array([2 * np.pi * (1 - np.cos(0.2))])
    detections = Detections(("lamp",), np.ones(1), unknown, unknown, np.full(1, np.nan), None, bearing, solid_angle_sr)
    (lines,) = outline_objects(detections)
    np.testing.assert_allclose(angles(lines, bearing[0]), 0.2)


def test_a_mask_without_range_is_outlined_as_it_is():
    away_m = visible_points((2.0, 1.0, 0.5), 0.5)
    rays = (away_m / np.linalg.norm(away_m, axis=1, keepdims=True)).astype(np.float32)
    unknown = np.full((1, 3), np.nan)
    numbers = unknown, unknown, np.full(1, np.nan), None, np.array([[0.0, 0, 1]]), np.array([0.01])
    (lines,) = outline_objects(Detections(("ball",), np.ones(1), *numbers, rays=(rays,)))
    off = angles(lines, (2.0, 1.0, 0.5)) - angular_radius((2.0, 1.0, 0.5), 0.5)
    assert np.abs(off).max() < 1.5 * PIXEL


def test_what_has_no_direction_has_no_outline():
    unknown = np.full((1, 3), np.nan)
    assert outline_objects(Detections(("lamp",), np.ones(1), unknown, unknown, np.full(1, np.nan))) == [[]]
    assert outline_objects(Detections.empty()) == []
