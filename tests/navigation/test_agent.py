"""An agent's estimate of its pose, and its moves."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_planners.planners import Dijkstra

from salframe.navigation.agent import Agent, Belief, Located
from salframe.navigation.guide import Guide
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw

STEP = pose_2d(1.0, 0.0, 0.0)


def at(x, y=0.0, yaw=0.0) -> np.ndarray:
    return pose_2d(x, y, yaw, 1.5)


def test_a_belief_moves_by_odometry():
    belief = Belief(0.0)
    assert belief.pose is None
    before, after = at(2.0, 1.0, 0.5), at(3.5, -1.0, 2.0)
    belief.add_localization(Located(before, 1.0))
    belief.add_motion(invert_pose(before) @ after)
    np.testing.assert_allclose(belief.pose, after, atol=1e-12)
    assert belief.yaw_rad == pytest.approx(1.5)


def test_a_single_wrong_answer_is_outvoted():
    belief = Belief(0.0)
    for k in range(2):
        belief.add_localization(Located(at(k), 1.0))
        belief.add_motion(STEP)
    belief.add_localization(Located(at(9.0, 9.0), 1.5))
    np.testing.assert_allclose(belief.pose[:2, 3], [2.0, 0.0])


def test_a_better_answer_corrects_a_doubtful_one():
    belief = Belief(0.0)
    belief.add_localization(Located(at(9.0, 9.0), 0.2))
    belief.add_motion(STEP)
    belief.add_localization(Located(at(1.0), 1.0))
    np.testing.assert_allclose(belief.pose[:2, 3], [1.0, 0.0])


def test_of_answers_that_agree_the_latest_is_believed():
    belief = Belief(0.0)
    for shift in (0.0, 0.1, 0.2):
        belief.add_localization(Located(at(shift), 1.0))
        belief.add_motion(pose_2d(0.0, 1.0, 0.0))
        belief.add_motion(pose_2d(0.0, -0.5, 0.0))
    np.testing.assert_allclose(belief.pose[:2, 3], [0.2, 0.5], atol=1e-12)


def test_answers_from_one_spot_count_once():
    belief = Belief(0.0)
    belief.add_localization(Located(at(0.0), 1.0))
    belief.add_motion(STEP)
    for _ in range(5):  # the same wrong answer repeatedly, without moving
        belief.add_localization(Located(at(9.0, 9.0), 0.6))
        belief.add_motion(pose_2d(0.0, 0.0, 0.0))
    np.testing.assert_allclose(belief.pose[:2, 3], [1.0, 0.0])


def test_answers_agree_only_where_they_look_the_same_way():
    belief = Belief(0.0)
    belief.add_localization(Located(at(0.0, yaw=2.0), 1.0))
    belief.add_motion(pose_2d(0.0, 1.0, 0.0))
    belief.add_localization(Located(at(-0.9, -0.4, yaw=-1.0), 1.2))
    assert pose_yaw(belief.pose) == pytest.approx(-1.0)


def test_a_place_tells_nothing_while_it_stays_the_same():
    belief = Belief(0.0)
    for _ in range(3):
        belief.add_localization(Located(at(5.0), 1.0, "room"))
        belief.add_motion(STEP)
    np.testing.assert_allclose(belief.pose[:2, 3], [8.0, 0.0])
    belief.add_localization(Located(at(20.0), 1.5, "hall"))
    np.testing.assert_allclose(belief.pose[:2, 3], [20.0, 0.0])


def make(world, goal="b") -> Agent:
    return Agent(Guide(world.chart, Dijkstra.Config()), goal, 0.0, 0.25, np.random.default_rng(0))


def test_the_turn_is_the_azimuth_of_the_leg_minus_the_heading(world):
    agent = make(world)
    agent.belief.add_localization(Located(at(2.5, 2.8, yaw=1.0), 1.0))
    turn_rad, length_m = agent.decide()
    door = next(node.xyz_m for node in world.chart.map.nodes if node.kind == "transition")
    azimuth = np.arctan2(door[1] - 2.8, door[0] - 2.5)
    assert np.cos(turn_rad - (azimuth - 1.0)) == pytest.approx(1.0, abs=1e-9)
    assert length_m == pytest.approx(np.hypot(door[0] - 2.5, door[1] - 2.8))


def test_long_legs_are_walked_in_stretches(world):
    agent = make(world)
    agent.belief.add_localization(Located(at(1.0, 2.0), 1.0))
    assert agent.decide() == (pytest.approx(0.0), world.chart.max_move_m)


def test_it_says_that_it_has_arrived_by_its_own_estimate(world):
    agent = make(world)
    agent.belief.add_localization(Located(at(7.2, 2.1), 1.0))
    assert agent.decide() is None


def test_without_a_belief_it_looks_from_elsewhere(world):
    move = make(world).decide()
    assert np.pi / 2 <= move.turn_rad <= 3 * np.pi / 2
    assert move.length_m == world.chart.aside_m


def test_stopped_by_a_known_wall_it_steps_aside_and_by_another_thing_it_goes_around(world):
    agent = make(world)
    agent.belief.add_localization(Located(at(3.8, 1.0), 1.0))
    agent.add_motion(pose_2d(0.0, 0.0, 0.0), stopped=True)
    assert agent.decide().length_m == world.chart.aside_m
    agent.add_motion(pose_2d(0.0, 0.0, 0.0), stopped=True)
    assert agent.decide().length_m != world.chart.aside_m  # a second collision at the same position: it is not the wall
    agent = make(world)
    agent.belief.add_localization(Located(at(2.0, 2.0), 1.0))
    agent.add_motion(pose_2d(0.0, 0.0, 0.0), stopped=True)
    assert agent.decide() == (
        pytest.approx(np.arctan2(1.5, 1.0), abs=0.02),
        pytest.approx(np.hypot(1.5, 1.0), abs=0.05),
    )


def test_where_bumps_leave_no_way_they_are_forgotten(world):
    agent = make(world)
    for y in np.arange(1.6, 2.5, 0.2):  # estimated positions in the door, which collisions close
        agent.belief.add_localization(Located(at(3.55, y), 1.0))
        agent.add_motion(pose_2d(0.0, 1.0, 0.0), stopped=True)
    agent.belief.add_localization(Located(at(1.0, 2.0), 99.0))
    assert agent.decide() is not None
