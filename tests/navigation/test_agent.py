"""An agent's estimate of its pose, and its moves."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_planners.planners import Dijkstra
from salframe_trackers.votes import VoteTracker

from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.next_view import NextView
from salframe.navigation.agent import Agent, Located
from salframe.navigation.guide import Guide
from salframe.panoramas.geometry import invert_pose, pose_2d

STEP = pose_2d(1.0, 0.0, 0.0)


def at(x, y=0.0, yaw=0.0) -> np.ndarray:
    return pose_2d(x, y, yaw, 1.5)


def located(x, y=0.0, yaw=0.0, score=1.0, frame=None) -> Located:
    places = (RankedPlace(frame or "frame", "room", score),)
    return Located(Localization(places, at(x, y, yaw), LocalizationStatus.OK), frame)


def test_the_pose_is_that_of_the_tracker_moved_by_odometry(world):
    agent = make(world)
    assert agent.pose is None
    before, after = at(2.0, 1.0, 0.5), at(3.5, -1.0, 2.0)
    agent.add_localization(located(2.0, 1.0, 0.5))
    agent.add_motion(invert_pose(before) @ after, stopped=False)
    np.testing.assert_allclose(agent.pose, after, atol=1e-12)
    assert agent.yaw_rad == pytest.approx(1.5)


def test_a_place_tells_nothing_while_it_stays_the_same(world):
    agent = make(world)
    for _ in range(3):
        agent.add_localization(located(5.0, frame="room"))
        agent.add_motion(STEP, stopped=False)
    np.testing.assert_allclose(agent.pose[:2, 3], [8.0, 0.0])
    agent.add_localization(Located(Localization((), None, LocalizationStatus.NO_OBJECTS)))
    agent.add_localization(located(5.0, frame="room"))
    np.testing.assert_allclose(agent.pose[:2, 3], [8.0, 0.0])
    agent.add_localization(located(20.0, score=1.5, frame="hall"))
    np.testing.assert_allclose(agent.pose[:2, 3], [20.0, 0.0])


def make(world, goal="b", max_turns=0) -> Agent:
    guide, rng = Guide(world.chart, Dijkstra.Config()), np.random.default_rng(0)
    return Agent(guide, goal, 0.0, 0.25, rng, VoteTracker(), max_turns)


def test_the_turn_is_the_azimuth_of_the_leg_minus_the_heading(world):
    agent = make(world)
    agent.add_localization(located(2.5, 2.8, yaw=1.0))
    turn_rad, length_m, _ = agent.decide()
    door = next(node.xyz_m for node in world.chart.map.nodes if node.kind == "transition")
    azimuth = np.arctan2(door[1] - 2.8, door[0] - 2.5)
    assert np.cos(turn_rad - (azimuth - 1.0)) == pytest.approx(1.0, abs=1e-9)
    assert length_m == pytest.approx(np.hypot(door[0] - 2.5, door[1] - 2.8))


def test_long_legs_are_walked_in_stretches(world):
    agent = make(world)
    agent.add_localization(located(1.0, 2.0))
    assert agent.decide() == (pytest.approx(0.0), world.chart.max_move_m, None)


def test_it_says_that_it_has_arrived_by_its_own_estimate(world):
    agent = make(world)
    agent.add_localization(located(7.2, 2.1))
    assert agent.decide() is None


def test_without_a_belief_it_looks_from_elsewhere(world):
    move = make(world).decide()
    assert np.pi / 2 <= move.turn_rad <= 3 * np.pi / 2
    assert move.length_m == world.chart.aside_m


def test_stopped_by_a_known_wall_it_steps_aside_and_by_another_thing_it_goes_around(world):
    agent = make(world)
    agent.add_localization(located(3.8, 1.0))
    agent.add_motion(pose_2d(0.0, 0.0, 0.0), stopped=True)
    assert agent.decide().length_m == world.chart.aside_m
    agent.add_motion(pose_2d(0.0, 0.0, 0.0), stopped=True)
    assert agent.decide().length_m != world.chart.aside_m  # a second collision at the same position: it is not the wall
    agent = make(world)
    agent.add_localization(located(2.0, 2.0))
    agent.add_motion(pose_2d(0.0, 0.0, 0.0), stopped=True)
    assert agent.decide() == (
        pytest.approx(np.arctan2(1.5, 1.0), abs=0.02),
        pytest.approx(np.hypot(1.5, 1.0), abs=0.05),
        None,
    )


def test_where_bumps_leave_no_way_they_are_forgotten(world):
    agent = make(world)
    for y in np.arange(1.6, 2.5, 0.2):  # estimated positions in the door, which collisions close
        agent.add_localization(located(3.55, y))
        agent.add_motion(pose_2d(0.0, 1.0, 0.0), stopped=True)
    agent.add_localization(located(1.0, 2.0, score=99.0))
    assert agent.decide() is not None


TURN = NextView(120.0)


def unsure(out_of_map_probability: float, next_view: NextView = TURN) -> Located:
    share = 1 - out_of_map_probability
    places = (RankedPlace("frame", "room", 1.0, share),)
    answer = Localization(
        places, at(2.5, 2.8), LocalizationStatus.OK, out_of_map_probability=out_of_map_probability, next_view=next_view
    )
    return Located(answer)


def test_an_answer_that_is_not_accepted_makes_the_agent_turn_before_it_walks(world):
    agent, turn = make(world, max_turns=2), pose_2d(0, 0, np.radians(120))
    for _ in range(2):
        agent.add_localization(unsure(0.9))
        assert agent.decide() == (pytest.approx(np.radians(120)), 0.0, None)
        agent.add_motion(turn, stopped=False)
    agent.add_localization(unsure(0.9))
    assert agent.decide().length_m > 0  # no more than two turns at a position
    agent.add_motion(STEP, stopped=False)
    agent.add_localization(unsure(0.9))
    assert agent.decide().length_m == 0  # a new position


def test_a_turn_stops_at_each_view_and_ends_at_an_accepted_answer(world):
    agent, step = make(world, max_turns=1), pose_2d(0, 0, np.radians(60))
    for _ in range(3):
        agent.add_localization(unsure(0.9, NextView(180.0, 60.0)))
        assert agent.decide() == (pytest.approx(np.radians(60)), 0.0, None)
        agent.add_motion(step, stopped=False)
    agent.add_localization(unsure(0.9, NextView(90.0, 60.0)))
    assert agent.decide().length_m > 0  # no more than one turn at a position
    agent.add_motion(STEP, stopped=False)
    agent.add_localization(unsure(0.9, NextView(180.0, 60.0)))
    assert agent.decide().length_m == 0
    agent.add_motion(step, stopped=False)
    agent.add_localization(unsure(0.1))
    assert agent.decide().length_m > 0  # accepted after the first of three views


def test_an_agent_that_turned_after_a_collision_still_steps_aside(world):
    agent = make(world, max_turns=1)
    agent.add_localization(located(3.8, 1.0))
    agent.add_motion(pose_2d(0, 0, 0), stopped=True)  # by a known wall
    agent.add_localization(unsure(0.9))
    assert agent.decide() == (pytest.approx(np.radians(120)), 0.0, None)
    agent.add_motion(pose_2d(0, 0, np.radians(120)), stopped=False)
    agent.add_localization(unsure(0.9))
    assert agent.decide().length_m == world.chart.aside_m


def test_an_accepted_answer_needs_no_turn(world):
    agent = make(world, max_turns=2)
    agent.add_localization(unsure(0.1))
    assert agent.decide().length_m > 0
    eager = make(world)
    eager.add_localization(unsure(0.9))
    assert eager.decide().length_m > 0
