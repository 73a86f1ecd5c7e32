"""Two storeys that stairs connect, compared with closed forms: paths, rides and episodes across."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from apartment_plugin import STAIRS_M, STOREY_M, Tower, masks
from salframe_planners.planners import Dijkstra

from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, UnknownName
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.tracker import Tracker
from salframe.navigation.agent import Agent, Located
from salframe.navigation.agent_localizer import localize_nearest
from salframe.navigation.episodes import EpisodeRequest, Site, draw_episodes, resolve_episodes
from salframe.navigation.guide import Guide
from salframe.navigation.walk import NavigationConfig, walk
from salframe.navigation.world import floor_worlds, open_worlds
from salframe.panoramas.floors import Connection
from salframe.panoramas.geometry import pose_2d

CAMERA_M = 1.5
BELOW, ABOVE = np.array([3.0, 2.0, CAMERA_M]), np.array([3.0, 2.0, STOREY_M + CAMERA_M])
STAIRS_XY_M = (1.0, 2.0)


@pytest.fixture
def tower():
    (world,) = open_worlds(Tower())
    return world


@pytest.fixture
def site(tower):
    return Site(tower, Guide(tower.chart, Dijkstra.Config()))


def stairs(world):
    (edge,) = [edge for edge in world.chart.map.edges if edge.storeys]
    return edge


def at(pose: np.ndarray) -> Located:
    return Located(Localization((RankedPlace("a", "a-west", 1.0),), pose, LocalizationStatus.OK))


def test_only_points_of_the_own_storey_are_in_reach(tower):
    points_m = np.array([[7.0, 2.0, 0.0], [7.0, 2.0, STOREY_M]])
    np.testing.assert_allclose(tower.chart.reach(BELOW, points_m), [4.0, np.inf])
    np.testing.assert_allclose(tower.chart.reach(ABOVE, points_m), [np.inf, 4.0])


def test_a_path_to_the_other_storey_takes_the_stairs(site):
    path = site.guide.shortest_path(BELOW, "up-b")
    assert path.length_m == pytest.approx(2.0 + STAIRS_M + 6.0)
    np.testing.assert_allclose(path.leg(BELOW), [-2.0, 0.0], atol=1e-9)
    edge = path.leg(np.array([1.2, 2.1, CAMERA_M]))
    assert (edge.start, edge.end, edge.length_m) == ("a-west", "up-a-west", STAIRS_M)
    assert site.guide.shortest_path(ABOVE, "b").length_m == pytest.approx(2.0 + STAIRS_M + 6.0)


def test_a_collision_on_a_storey_leaves_the_other_one_as_it_is(tower):
    chart = tower.chart.after_collision(pose_2d(2.0, 2.0, 0.0, STOREY_M + CAMERA_M), again=False)
    above, below = np.array([[4.1, 2.0, STOREY_M]]), np.array([[4.1, 2.0, 0.0]])
    assert np.isinf(chart.reach(np.array([1.5, 2.0, STOREY_M + CAMERA_M]), above)).all()
    np.testing.assert_allclose(chart.reach(np.array([1.5, 2.0, CAMERA_M]), below), [2.6])
    assert [edge for edge in chart.map.edges if edge.storeys] == [stairs(tower)]


def test_stairs_are_taken_from_their_foot_alone(tower):
    up = stairs(tower)
    end, failed = tower.take_stairs(pose_2d(1.6, 2.6, 0.7, CAMERA_M), up)
    assert not failed
    np.testing.assert_allclose(end, pose_2d(*STAIRS_XY_M, 0.7, STOREY_M + CAMERA_M))
    for pose in (pose_2d(2.1, 2.0, 0.7, CAMERA_M), pose_2d(*STAIRS_XY_M, 0.7, STOREY_M + CAMERA_M)):
        end, failed = tower.take_stairs(pose, up)
        assert failed
        np.testing.assert_array_equal(end, pose)
    down, failed = tower.take_stairs(pose_2d(*STAIRS_XY_M, 0.7, STOREY_M + CAMERA_M), up.reversed())
    assert not failed
    assert down[2, 3] == CAMERA_M


def test_the_storeys_are_joined(tower):
    assert tower.is_reachable(pose_2d(1.0, 1.0, 0.0, CAMERA_M), pose_2d(7.0, 2.0, 0.0, STOREY_M + CAMERA_M))
    assert tower.region(pose_2d(7.0, 2.0, 0.0, STOREY_M + CAMERA_M)) == "up-b"


def test_an_agent_without_noise_walks_the_shortest_path_across(site):
    quiet = {"turn_noise_deg": 0.0, "length_noise": 0.0, "odometry_turn_noise_deg": 0.0, "odometry_length_noise": 0.0}
    config = NavigationConfig(**quiet)
    request = EpisodeRequest(start=(3.0, 2.0), floor=1, goal="up-b", yaw_deg=30.0)
    ([episode], _) = resolve_episodes([request], {"floor": site}, 0)
    assert episode.shortest_m == pytest.approx(2.0 + STAIRS_M + 6.0)
    row = walk(site, lambda pose, yaw_rad, turn: at(pose), episode, config, 0)
    assert row["success"]
    assert row["travelled_m"] == pytest.approx(episode.shortest_m, abs=config.arrival_m)
    assert row["collisions"] == 0
    assert [z for _, _, z, _ in row["path"]] == sorted(z for _, _, z, _ in row["path"])


def test_an_agent_that_is_not_at_the_stairs_steps_aside(site):
    tracker = registry().build(Tracker.role, NavigationConfig().tracker)
    agent = Agent(site.guide, "up-b", 0.0, 0.25, np.random.default_rng(0), tracker)
    agent.add_localization(at(pose_2d(*STAIRS_XY_M, 0.0, CAMERA_M)))
    assert agent.decide().stairs == stairs(site.world)
    agent.add_motion(np.eye(4), stopped=True)
    move = agent.decide()
    assert move.stairs is None
    assert move.length_m == site.world.chart.aside_m


def test_the_floor_of_a_start_is_stated(site):
    with pytest.raises(
        DataError, match="floor has 2 floors, but the start has no floor: set `floor` to a number from 1 to 2"
    ):
        resolve_episodes([EpisodeRequest(start=(3.0, 2.0), goal="up-b")], {"floor": site}, 0)
    with pytest.raises(DataError, match="floor has no floor 3, expected a number from 1 to 2"):
        site.world.stand(3.0, 2.0, 0.0, 3)
    assert site.world.stand(3.0, 2.0, 0.0, 2)[2, 3] == STOREY_M + CAMERA_M


def test_starts_and_goals_are_on_both_storeys(site):
    episodes, _ = draw_episodes({"floor": site}, 40, 0)
    storeys = {(episode.start[11] > STOREY_M, episode.goal.startswith("up-")) for episode in episodes}
    assert len(storeys) == 4


def test_at_a_blocked_end_of_the_stairs_the_agent_arrives_beside_it():
    (world,) = floor_worlds(Tower(), [masks(), replace(masks((0.8, 1.8, 1.2, 2.2)), z_m=STOREY_M)])
    end, failed = world.take_stairs(pose_2d(*STAIRS_XY_M, 0.7, CAMERA_M), stairs(world))
    assert not failed
    assert 0.2 <= np.linalg.norm(end[:2, 3] - STAIRS_XY_M) <= 0.5
    assert end[2, 3] == STOREY_M + CAMERA_M
    (world,) = floor_worlds(Tower(), [masks(), replace(masks((-0.5, 0.0, 3.0, 4.0)), z_m=STOREY_M)])
    assert world.take_stairs(pose_2d(*STAIRS_XY_M, 0.7, CAMERA_M), stairs(world))[1]
    assert not world.is_reachable(pose_2d(1.0, 1.0, 0.0, CAMERA_M), pose_2d(7.0, 2.0, 0.0, STOREY_M + CAMERA_M))


@pytest.mark.parametrize(
    ("ends", "error", "message"),
    [
        (("a", "attic"), UnknownName, "unknown node or place 'attic'"),
        (("a", "b"), DataError, "starts at a and ends at b, both on floor 1, expected two different floors"),
    ],
)
def test_stairs_that_lead_nowhere_are_an_error(monkeypatch, ends, error, message):
    connection = Connection(start=ends[0], end=ends[1], kind="stairs", length_m=STAIRS_M)
    monkeypatch.setattr(Tower, "connections", lambda self: [connection])
    with pytest.raises(error, match=message):
        open_worlds(Tower())


def test_a_place_on_both_floors_is_connected_across(monkeypatch):
    upper = replace(masks(), z_m=STOREY_M, regions={1: "a", 2: "up-b"})
    monkeypatch.setattr(Tower, "floors", lambda self: [masks(), upper])
    monkeypatch.setattr(
        Tower, "connections", lambda self: [Connection(start="a", end="up-b", kind="stairs", length_m=STAIRS_M)]
    )
    (world,) = open_worlds(Tower())
    assert stairs(world).storeys == (1, 2)


def test_floors_without_connections_are_separate_worlds(monkeypatch):
    monkeypatch.setattr(Tower, "connections", lambda self: [])
    assert [world.id for world in open_worlds(Tower())] == ["floor-0", "floor-1"]


def test_the_order_of_the_floors_does_not_matter(monkeypatch, tower):
    upper, lower = reversed(Tower().floors())
    monkeypatch.setattr(Tower, "floors", lambda self: [upper, lower])
    (world,) = open_worlds(Tower())
    assert world.chart.map.edges == tower.chart.map.edges
    assert world.stand(3.0, 2.0, 0.0, 2)[2, 3] == STOREY_M + CAMERA_M


def test_perfect_place_recognition_stays_on_its_storey(tower):
    located = localize_nearest(tower, pose_2d(7.4, 0.6, 0.0, CAMERA_M), 0.0)
    assert not located.frame.startswith("up-")
