import numpy as np
import pytest
from salframe_matterport.bearings import bearing, direction

from .conftest import ball_boxes


def angle_deg(a, b):
    return np.degrees(np.arccos(np.clip(np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


@pytest.mark.parametrize(
    ("view", "heading_deg", "elevation_deg"),
    [(12, 0, 0), (15, 90, 0), (18, 180, 0), (21, 270, 0), (2, 60, -30), (30, 180, 30)],
)
def test_box_in_the_middle_of_a_view_lies_where_the_view_looks(view, heading_deg, elevation_deg):
    seen = bearing(np.array([view]), np.array([[300, 220, 40, 40]]))
    # Headings run clockwise from +y, azimuths counter-clockwise from +x.
    assert np.cos(seen.azimuth_rad - np.radians(90 - heading_deg)) == pytest.approx(1, abs=1e-9)
    assert np.degrees(seen.elevation_rad) == pytest.approx(elevation_deg, abs=0.05)
    assert np.degrees(seen.width_rad) == pytest.approx(2 * np.degrees(np.arctan(20 / 415.69)), abs=0.05)
    assert np.degrees(seen.height_rad) == pytest.approx(2 * np.degrees(np.arctan(20 / 415.69)), abs=0.05)


@pytest.mark.parametrize("box", [[100, 60, 30, 20], [500, 400, 20, 30], [20, 300, 16, 16]])
@pytest.mark.parametrize("view", [1, 16, 34])
def test_small_box_follows_the_pinhole_formula(view, box):
    x, y, w, h = box
    a, b = x + w / 2 - 320, 240 - (y + h / 2)
    f, e0, h0 = 240 / np.tan(np.radians(30)), np.radians(30 * (view // 12 - 1)), np.radians(30 * (view % 12))
    ahead, up = f * np.cos(e0) - b * np.sin(e0), f * np.sin(e0) + b * np.cos(e0)
    heading, elevation = h0 + np.arctan2(a, ahead), np.arctan2(up, np.hypot(a, ahead))
    seen = bearing(np.array([view]), np.array([box]))
    assert angle_deg(direction(seen.azimuth_rad, seen.elevation_rad), direction(np.pi / 2 - heading, elevation)) < 0.1


@pytest.mark.parametrize("azimuth_deg", np.arange(-180, 180, 61))
@pytest.mark.parametrize("elevation_deg", [-40, -12, 0, 25])
@pytest.mark.parametrize("spans_deg", [6, 30, 70])
def test_ball_is_found_and_measured_also_where_views_cut_it(azimuth_deg, elevation_deg, spans_deg):
    truth = direction(np.radians(azimuth_deg), np.radians(elevation_deg))
    views, boxes = ball_boxes(2 * truth, 2 * np.sin(np.radians(spans_deg) / 2))
    seen = bearing(np.array(views), np.array(boxes))
    # A box around a disc reaches farther at its corners, the more the larger it is.
    assert angle_deg(direction(seen.azimuth_rad, seen.elevation_rad), truth) < 0.3 + 0.05 * spans_deg
    assert np.degrees(seen.width_rad) == pytest.approx(spans_deg, rel=0.3, abs=1)
    assert np.degrees(seen.height_rad) == pytest.approx(spans_deg, rel=0.3, abs=1)


def test_box_cut_by_a_border_is_completed_by_the_next_view():
    truth = direction(
        np.radians(90 - 45), 0.0
    )  # heading 45 deg: near the right border of view 12, near the left one of view 15
    views, boxes = ball_boxes(2 * truth, 0.5)
    cut = [i for i, (x, _, w, _) in enumerate(boxes) if x == 0 or x + w == 640]
    assert cut
    joined = bearing(np.array(views), np.array(boxes))
    alone = max(angle_deg(direction(*bearing(np.array([views[i]]), np.array([boxes[i]]))[:2]), truth) for i in cut)
    assert angle_deg(direction(joined.azimuth_rad, joined.elevation_rad), truth) < 1 < 5 < alone


def test_contradicting_boxes_still_give_a_bearing():
    seen = bearing(np.array([12, 12]), np.array([[0, 0, 10, 10], [600, 400, 10, 10]]))
    assert np.isfinite(seen).all()
