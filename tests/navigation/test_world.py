"""The rendered world: free positions of an agent, and the ends of its walks."""

from __future__ import annotations

import numpy as np
import pytest
from apartment_plugin import POSES, Apartment, Still, Unmasked, masks, references

from salframe.framework.errors import DataError, InputMissing, UnknownName
from salframe.navigation.world import FloorWorld, open_worlds
from salframe.panoramas.geometry import pose_2d, pose_yaw

PIXEL_M = 0.05
RADIUS_M = 0.18


def test_a_free_walk_ends_where_trigonometry_says(world):
    end, stopped = world.move(pose_2d(1.0, 1.0, 0.2, 1.5), 0.4, 1.25)
    assert not stopped
    np.testing.assert_allclose(end[:3, 3], (1 + 1.25 * np.cos(0.6), 1 + 1.25 * np.sin(0.6), 1.5), atol=1e-12)
    assert pose_yaw(end) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("start", "yaw", "wall"), [((3.0, 0.6), 0.0, 4.0), ((1.0, 3.0), np.pi, 0.0), ((7.0, 3.0), 0.0, 8.0)]
)
def test_a_wall_stops_the_disc_at_its_radius(world, start, yaw, wall):
    end, stopped = world.move(pose_2d(*start, yaw, 1.5), 0.0, 3.0)
    assert stopped
    assert abs(wall - end[0, 3]) == pytest.approx(RADIUS_M, abs=PIXEL_M + 0.01)
    assert end[1, 3] == pytest.approx(start[1])


def test_the_door_lets_through(world):
    end, stopped = world.move(pose_2d(3.0, 2.0, 0.0, 1.5), 0.0, 2.5)
    assert not stopped
    assert world.region(end) == "b"
    assert world.region(pose_2d(3.0, 2.0, 0.0, 1.5)) == "a"


def test_a_turn_alone_moves_nothing(world):
    end, stopped = world.move(pose_2d(1.0, 1.0, 0.0, 1.5), -2.0, 0.0)
    assert not stopped
    np.testing.assert_allclose(end, pose_2d(1.0, 1.0, -2.0, 1.5), atol=1e-12)


def test_what_was_moved_since_the_map_was_made_stops_the_agent():
    changed = FloorWorld("floor", Apartment(), [masks()], references(), [masks((2.0, 1.0, 2.5, 3.0))])
    end, stopped = changed.move(pose_2d(1.0, 2.0, 0.0, 1.5), 0.0, 2.0)
    assert stopped
    assert end[0, 3] == pytest.approx(2.0 - RADIUS_M, abs=PIXEL_M + 0.01)
    assert changed.chart.reach(np.array([1.0, 2.0, 1.5]), np.array([[3.0, 2.0, 0.0]])) == pytest.approx(2.0)


def test_what_was_moved_may_shut_a_room_off(world):
    shut = FloorWorld("floor", Apartment(), [masks()], references(), [masks((3.7, 1.0, 4.0, 3.0))])
    here, there = pose_2d(1.0, 2.0, 0.0, 1.5), pose_2d(7.0, 2.0, 0.0, 1.5)
    assert world.is_reachable(here, there)
    assert not shut.is_reachable(here, there)
    assert shut.is_reachable(here, pose_2d(2.0, 0.5, 0.0, 1.5))


@pytest.mark.parametrize("place", [(4.1, 0.5), (0.1, 2.0), (-3.0, 2.0), (50.0, 2.0)])
def test_nobody_stands_in_a_wall(world, place):
    with pytest.raises(
        DataError, match=rf"\({place[0]:.2f}, {place[1]:.2f}\) m is in a wall or obstacle, or less than 0.18 m from one"
    ):
        world.stand(*place, 0.0)


def test_an_unknown_node_is_named(world):
    with pytest.raises(UnknownName, match="floor: unknown node 'a-wst', did you mean 'a-west'"):
        world.node("a-wst")


def test_starts_are_uniform_over_the_floor_and_the_circle(world, rng):
    starts = [world.draw_start(rng) for _ in range(400)]
    assert all(world.stand(*start[:2, 3], 0.0)[2, 3] == 1.5 for start in starts)
    in_a = np.mean([world.region(start) == "a" for start in starts])
    assert in_a == pytest.approx(3.64 / (3.64 + 3.44), abs=0.08)
    assert np.abs(np.mean([np.exp(1j * pose_yaw(start)) for start in starts])) < 0.15


def test_the_map_has_every_frame(world):
    assert [frame.id for frame in world.references(world.stand(1.0, 1.0, 0.0))] == list(POSES)
    assert {frame for node in world.chart.map.nodes for frame in node.frames} == set(POSES)


def test_a_data_set_that_cannot_render_says_so():
    with pytest.raises(
        InputMissing, match="navigation needs panoramas at new poses, which the dataset still cannot render"
    ):
        open_worlds(Still())
    with pytest.raises(
        DataError,
        match=r"navigation needs floor masks .* to detect collisions, which the dataset unmasked does not have",
    ):
        open_worlds(Unmasked())
