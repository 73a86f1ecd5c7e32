"""Random episodes, and episodes from files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from apartment_plugin import Apartment, masks, references
from salframe_planners.planners import Dijkstra

from salframe.framework.errors import DataError
from salframe.navigation.episodes import Site, draw_episodes, read_episode_requests, resolve_episodes
from salframe.navigation.guide import Guide
from salframe.navigation.world import FloorWorld
from salframe.panoramas.geometry import pose_yaw


@pytest.fixture
def sites(world):
    return {"floor": Site(world, Guide(world.chart, Dijkstra.Config()))}


def write(content) -> Path:
    path = Path("episodes.json")
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_goals_lie_in_another_room(sites):
    episodes, left_out = draw_episodes(sites, 40, 3)
    assert len(episodes) == 40
    assert not left_out
    for episode in episodes:
        start = np.reshape(episode.start, (4, 4))
        assert sites["floor"].world.region(start) != episode.goal[0]
        assert (
            episode.shortest_m
            >= np.linalg.norm(start[:2, 3] - sites["floor"].world.node(episode.goal).xyz_m[:2]) - 1e-9
        )
    assert {episode.goal for episode in episodes} == {"a-west", "a-north", "b"}


def test_a_seed_gives_the_same_episodes_and_more_of_them_begin_alike(sites):
    assert draw_episodes(sites, 8, 3)[0] == draw_episodes(sites, 12, 3)[0][:8]
    assert draw_episodes(sites, 8, 3)[0] != draw_episodes(sites, 8, 4)[0]


def test_a_file_gives_starts_and_goals(sites):
    path = write(
        [{"start": [1.0, 1.0], "goal": "b", "yaw_deg": 90}, {"start": "a-west", "goal": "b", "world": "floor"}]
    )
    episodes, left_out = resolve_episodes(read_episode_requests(path), sites, 0)
    assert not left_out
    first, second = (np.reshape(episode.start, (4, 4)) for episode in episodes)
    np.testing.assert_allclose(first[:3, 3], [1.0, 1.0, 1.5])
    assert pose_yaw(first) == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(second[:2, 3], [1.0, 2.0])
    assert episodes[1].shortest_m == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        (
            {"start": [4.1, 0.5], "goal": "b"},
            r"episode 1: building floor: the position \(4.10, 0.50\) m is in a wall or obstacle",
        ),
        ({"start": "a-wets", "goal": "b"}, "episode 1: building floor: unknown node 'a-wets', did you mean 'a-west'"),
        ({"start": "b", "goal": "c"}, "episode 1: building floor: unknown node 'c'"),
        (
            {"start": "b", "goal": "a-west", "world": "attic"},
            r"episode 1: the episode has the unknown `world` \(building\) 'attic', expected one of floor",
        ),
    ],
)
def test_an_episode_that_cannot_be_walked_costs_only_itself(sites, entry, line):
    episodes, left_out = resolve_episodes(
        read_episode_requests(write([{"start": "a-west", "goal": "b"}, entry])), sites, 0
    )
    assert [episode.number for episode in episodes] == [0]
    with pytest.raises(DataError, match=line):
        raise DataError(*left_out)
    with pytest.raises(DataError, match=line.replace("episode 1", "episode 0")):
        resolve_episodes(read_episode_requests(write([entry])), sites, 0)


def test_goals_that_what_was_moved_shuts_off_are_not_asked_for():
    shut = FloorWorld("floor", Apartment(), [masks()], references(), [masks((3.7, 1.0, 4.0, 3.0))])
    sites = {"floor": Site(shut, Guide(shut.chart, Dijkstra.Config()))}
    with pytest.raises(DataError, match="floor allows no episode"):
        draw_episodes(sites, 5, 3)
    with pytest.raises(
        DataError, match="episode 0: obstacles in the building floor block every path from the start to b"
    ):
        resolve_episodes(read_episode_requests(write([{"start": "a-west", "goal": "b"}])), sites, 0)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("nonsense", "episodes.json is not JSON"),
        ({"start": "b"}, "episodes.json: received {'start': 'b'}, expected a list"),
        ([{"start": "b"}], "episodes.json: the required key 0.goal is missing"),
        ([{"start": "b", "goal": "a-west", "yaw": 3}], "episodes.json: unknown key 0.yaw"),
    ],
)
def test_a_malformed_file_is_one_line(sites, content, line):
    with pytest.raises(DataError, match=line) as caught:
        read_episode_requests(write(content))
    assert "\n" not in str(caught.value)


def test_a_file_without_episodes_is_one_line(sites):
    with pytest.raises(DataError, match=r"episodes\.json contains no episode, expected a list of at least one"):
        resolve_episodes(read_episode_requests(write([])), sites, 0)


def test_several_worlds_must_be_told_apart(sites):
    with pytest.raises(DataError, match=r"episode 0: the episode has no `world` .*, expected one of floor, attic"):
        resolve_episodes(
            read_episode_requests(write([{"start": "b", "goal": "a-west"}])), {**sites, "attic": sites["floor"]}, 0
        )


def test_a_floor_without_free_regions_allows_no_episode():
    blocked = FloorWorld("floor", Apartment(), [masks()], references(), [masks((-1.0, -1.0, 9.0, 9.0))])
    with pytest.raises(DataError, match="floor has no free floor in any room"):
        blocked.draw_start(np.random.default_rng(0))
    with pytest.raises(DataError, match="floor allows no episode"):
        draw_episodes({"floor": Site(blocked, Guide(blocked.chart, Dijkstra.Config()))}, 5, 3)
