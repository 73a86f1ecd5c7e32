"""Episodes in closed loop, compared with closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_planners.planners import Dijkstra

from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.next_view import NextView
from salframe.navigation.agent import Located
from salframe.navigation.episodes import Episode, Site
from salframe.navigation.guide import Guide
from salframe.navigation.walk import NavigationConfig, walk
from salframe.panoramas.geometry import pose_2d

STILL = {"turn_noise_deg": 0.0, "length_noise": 0.0, "odometry_turn_noise_deg": 0.0, "odometry_length_noise": 0.0}


@pytest.fixture
def site(world):
    return Site(world, Guide(world.chart, Dijkstra.Config()))


def episode(site, x, y, goal="b", number=0) -> Episode:
    start = pose_2d(x, y, 2.0, 1.5)
    return Episode(
        number, "floor", tuple(start.ravel().tolist()), goal, site.guide.shortest_path(start[:3, 3], goal).length_m
    )


NOWHERE = Located(Localization((), None, LocalizationStatus.NO_OBJECTS))


def located(T) -> Located:
    return Located(Localization((RankedPlace("frame", "room", 1.0),), T, LocalizationStatus.OK))


def truly(T, yaw_rad, turn):
    return located(T)


def located_once():
    """Localizes the agent at its true pose once, and never again."""
    answers = [True]
    return lambda T, yaw_rad, turn: located(T) if answers and answers.pop() else NOWHERE


def test_without_noise_the_way_walked_is_the_shortest(site):
    row = walk(site, truly, episode(site, 1.5, 2.0), NavigationConfig(**STILL, arrival_m=0.01), 0)
    assert (row["status"], row["success"], row["collisions"]) == ("arrived", True, 0)
    assert row["shortest_m"] == row["travelled_m"] == pytest.approx(5.5)
    assert row["spl"] == pytest.approx(1.0)
    assert row["panoramas"] == 4 == len(row["believed"])  # one for each 2 m, and one at the goal
    np.testing.assert_allclose([pose[0] for pose in row["path"]], [1.5, 3.5, 5.5, 7.0], atol=1e-4)


def test_spl_is_the_shortest_over_the_walked_way(site):
    longer = [np.array([0.0, 0.4]), np.array([0.0, -0.4])]

    def detour(T, yaw_rad, turn):
        shift = longer.pop(0) if longer else np.zeros(2)
        return located(pose_2d(*(T[:2, 3] + shift), 2.0 if T[0, 3] == 1.5 else yaw_rad, 1.5))

    row = walk(site, detour, episode(site, 1.5, 2.0), NavigationConfig(**STILL), 0)
    steps = np.diff([pose[:2] for pose in row["path"]], axis=0)
    assert row["travelled_m"] == pytest.approx(np.hypot(*steps.T).sum(), abs=1e-3)
    assert row["travelled_m"] > 5.55
    assert row["spl"] == pytest.approx(row["success"] * 5.5 / row["travelled_m"])


def test_to_say_so_elsewhere_is_no_success(site):
    row = walk(
        site,
        lambda T, yaw_rad, turn: located(pose_2d(7.0, 2.0, yaw_rad, 1.5)),
        episode(site, 5.0, 2.0),
        NavigationConfig(**STILL),
        0,
    )
    reached = {key: row[key] for key in ("status", "success", "oracle", "success_1m", "success_3m", "spl")}
    assert reached == {
        "status": "arrived", "success": False, "oracle": False, "success_1m": False, "success_3m": True, "spl": 0.0
    }  # fmt: skip
    assert row["left_m"] == pytest.approx(2.0)


@pytest.mark.parametrize(("x_m", "reached"), [(6.4, [False, True, True]), (5.9, [False, False, True])])
def test_looser_rules_take_a_greater_distance(site, x_m, reached):
    """The agent reports its arrival at 0.6 m and at 1.1 m from the goal."""
    row = walk(
        site,
        lambda T, yaw_rad, turn: located(pose_2d(7.0, 2.0, yaw_rad, 1.5)),
        episode(site, x_m, 2.0),
        NavigationConfig(**STILL),
        0,
    )
    assert [row[key] for key in ("success", "success_1m", "success_3m")] == reached


def test_to_pass_the_goal_without_saying_so_is_the_oracles(site):
    def behind(T, yaw_rad, turn):
        return located(pose_2d(T[0, 3] - 1.5, T[1, 3], yaw_rad, 1.5))

    row = walk(site, behind, episode(site, 5.0, 2.0), NavigationConfig(**STILL, budget=6), 0)
    assert (row["success"], row["oracle"], row["status"]) == (False, True, "out of budget")


def test_a_wrong_localization_sends_the_agent_the_wrong_way(site):
    """An agent localized in room b, east of the goal, walks west, into the wall of room a."""

    def astray(T, yaw_rad, turn):
        return located(pose_2d(7.7, 2.0, yaw_rad, 1.5))

    row = walk(site, astray, episode(site, 1.0, 2.0), NavigationConfig(**STILL, budget=2), 0)
    assert row["path"][1][0] == pytest.approx(1.0 - 0.7, abs=1e-3)


def test_never_localized_it_keeps_trying_until_the_budget_ends(site):
    row = walk(site, lambda T, yaw_rad, turn: NOWHERE, episode(site, 1.0, 2.0), NavigationConfig(budget=5), 0)
    assert (row["status"], row["panoramas"], row["not_localized"], row["believed"]) == (
        "out of budget",
        5,
        5,
        [None] * 5,
    )


def test_between_localizations_odometry_leads_on(site):
    row = walk(site, located_once(), episode(site, 1.5, 2.0), NavigationConfig(**STILL), 0)
    assert row["success"]
    assert row["not_localized"] == row["panoramas"] - 1


def test_noise_is_that_of_the_seed_and_has_the_stated_size(site):
    config = NavigationConfig(budget=1)
    one = episode(site, 1.5, 2.0)
    assert walk(site, truly, one, config, 5) == walk(site, truly, one, config, 5)
    ends = []
    for number in range(120):
        row = walk(site, truly, episode(site, 1.5, 2.0, number=number), config, 5)
        x, y = np.subtract(row["path"][1][:2], (1.5, 2.0))
        ends.append((np.hypot(x, y) / 2.0, np.degrees(np.arctan2(y, x))))
    scale, turn_deg = np.std(ends, axis=0)
    assert scale == pytest.approx(0.05, rel=0.25)
    assert turn_deg == pytest.approx(2.0, rel=0.25)


def test_a_slip_is_as_long_as_stated_any_way_and_odometry_tells_of_it(site):
    """From 2 m walked east the agent stands 0.4 m away, still looking east; the belief, moved by odometry, goes along.
    A walk that is no longer than that does not slip."""
    away = []
    for number in range(40):
        row = walk(
            site,
            located_once(),
            episode(site, 1.5, 2.0, number=number),
            NavigationConfig(**STILL, slip_m=0.4, budget=2),
            0,
        )
        x, y, _, yaw_rad = row["path"][1]
        away.append((x - 3.5, y - 2.0))
        assert yaw_rad == pytest.approx(0.0, abs=1e-4)
        np.testing.assert_allclose(row["believed"][1], row["path"][1], atol=2e-4)
        once = walk(
            site, truly, episode(site, 1.5, 2.0, number=number), NavigationConfig(**STILL, slip_m=0.4, budget=1), 0
        )
        assert once["travelled_m"] == pytest.approx(2.0 + 0.4, abs=0.02)  # not the line across
    np.testing.assert_allclose(np.hypot(*np.transpose(away)), 0.4, atol=0.02)
    bearing = np.arctan2(*np.transpose(away)[::-1])
    assert {int(np.floor(2 * one / np.pi)) for one in bearing} == {-2, -1, 0, 1}  # each quarter of the circle
    short = walk(site, truly, episode(site, 6.7, 2.0), NavigationConfig(**STILL, slip_m=0.4), 0)
    assert short["path"][-1][:2] == pytest.approx((7.0, 2.0), abs=1e-3)


def test_odometry_has_the_stated_noise(site):
    """Without further localizations, the estimate drifts from the true pose by the noise of odometry only."""
    off = []
    for number in range(120):
        row = walk(site, located_once(), episode(site, 1.5, 2.0, number=number), NavigationConfig(budget=2), 7)
        true, believed = np.array(row["path"][1]), np.array(row["believed"][1])
        length_m = np.linalg.norm(true[:2] - (1.5, 2.0))
        off.append((np.linalg.norm(believed[:2] - (1.5, 2.0)) / length_m - 1, np.degrees(believed[3] - true[3])))
    scale, turn_deg = np.std(off, axis=0)
    assert scale == pytest.approx(0.05, rel=0.25)
    assert turn_deg == pytest.approx(2.0, rel=0.25)


def test_an_unsure_agent_turns_on_the_spot_and_passes_the_motion(site):
    turns = []

    def unsure(T, yaw_rad, turn):
        turns.append(turn)
        places = (RankedPlace("frame", "room", 1.0, 0.1),)
        return Located(
            Localization(places, T, LocalizationStatus.OK, out_of_map_probability=0.9, next_view=NextView(120.0))
        )

    row = walk(site, unsure, episode(site, 1.5, 2.0), NavigationConfig(**STILL, arrival_m=0.01, max_turns=1), 0)
    assert (row["success"], row["collisions"]) == (True, 0)
    assert row["travelled_m"] == pytest.approx(5.5)
    assert row["panoramas"] == 8  # two at each of four positions
    assert [turn is None for turn in turns] == [True, False] * 4
    np.testing.assert_allclose(turns[1], pose_2d(0, 0, np.radians(120)), atol=1e-9)
