"""The next view of a camera: the middle of the largest sector that a query does not show, by its geometry."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.localization.next_view import NextView, next_view_of

NUM_BINS = 72
MIDDLES_DEG = (np.arange(NUM_BINS) + 0.5) * 5.0


def view(heading_deg: float, width_deg: float) -> np.ndarray:
    """The azimuth bins that a camera with a heading and a field of view shows."""
    off_deg = (MIDDLES_DEG - heading_deg + 180) % 360 - 180
    return np.abs(off_deg) < width_deg / 2


@pytest.mark.parametrize("heading_deg", [0.0, 50.0, -135.0])
def test_one_view_is_followed_by_its_opposite(heading_deg):
    assert next_view_of(view(heading_deg, 90)[None]) == NextView(180.0, 90.0)


@pytest.mark.parametrize(
    ("width_deg", "views_deg"),
    [(180, [180]), (120, [90, 180]), (90, [90, 180]), (60, [60, 120, 180]), (50, [45, 90, 135, 180])],
)
def test_the_views_of_a_turn_leave_no_direction_out(width_deg, views_deg):
    turn = next_view_of(view(0, width_deg)[None])
    np.testing.assert_allclose(turn.views_deg, views_deg)
    shown = np.any([view(heading_deg, width_deg) for heading_deg in (0, *turn.views_deg)], axis=0)
    assert shown[MIDDLES_DEG < 180].all()
    assert NextView(-100, 40).views_deg == pytest.approx((-100 / 3, -200 / 3, -100))


@pytest.mark.parametrize(
    ("headings_deg", "width_deg", "step_deg"),
    [([0, 180], 60, 60), ([-100, 100], 90, 90), ([-20, 20], 30, 30), ([0], 270, 270)],
)
def test_a_rig_with_gaps_turns_by_the_widest_sector_without_a_gap(headings_deg, width_deg, step_deg):
    rig = np.any([view(heading_deg, width_deg) for heading_deg in headings_deg], axis=0)
    turn = next_view_of(rig[None])
    assert turn.max_step_deg == step_deg
    (left, *_) = headings_deg
    swept = np.any([view(left + angle_deg, width_deg) for angle_deg in (0, *turn.views_deg)], axis=0)
    between = (np.sign(turn.turn_deg) * (MIDDLES_DEG - left)) % 360 < abs(turn.turn_deg)
    assert swept[between].all()


@pytest.mark.parametrize(
    ("headings_deg", "turn_deg"),
    [
        ([0, 180], -90),  # two sectors of 90 degrees: of equal ones, the first from the x axis
        ([180, 0], 90),
        ([0, 90], 135),  # 135 to 315 degrees are not shown: the middle is at 225, and the camera looks to 90
        ([90, 0], -135),
        ([0, 120, 40], -160),  # 165 to 315 degrees are not shown: the middle is at 240
        ([0, 90, 180, 60], -150),  # one sector is left, around 270 degrees
    ],
)
def test_views_are_followed_by_the_largest_sector_that_is_left(headings_deg, turn_deg):
    shown = np.stack([view(heading_deg, 90) for heading_deg in headings_deg])
    assert next_view_of(shown).turn_deg == turn_deg


def test_a_panorama_has_no_next_view():
    assert next_view_of(np.ones((1, NUM_BINS), bool)) is None
    assert next_view_of(np.stack([view(heading_deg, 90) for heading_deg in (0, 90, 180, 270)])) is None


def test_a_view_without_directions_has_no_next_view():
    assert next_view_of(np.zeros((1, NUM_BINS), bool)) is None


def test_a_turn_is_written_in_words():
    assert str(NextView(120.0)) == "turn left 120 deg"
    assert str(NextView(-90.4)) == "turn right 90 deg"
    assert str(NextView(180.0, 90.0)) == "turn left 180 deg, with a view every 90 deg"
    assert str(NextView(-160.0, 60.0)) == "turn right 160 deg, with a view every 53 deg"
