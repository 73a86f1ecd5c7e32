"""The viewpoint graph as a world: where walks lead, what is seen, and what of the map is left out meanwhile."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from salframe_matterport.dataset import MatterportAnnotations
from salframe_planners.planners import Dijkstra

from salframe.framework.errors import DataError
from salframe.navigation.agent_localizer import localize_nearest
from salframe.navigation.episodes import Site, draw_episodes, read_episode_requests, resolve_episodes
from salframe.navigation.guide import Guide
from salframe.panoramas.geometry import pose_yaw

EDGES = ("ab", "ac")


@pytest.fixture
def world(building):
    """a joined to b and c; cameras 1.5 m, 1.6 m and 1.5 m up, 1.4 m above the floor."""
    path = building.root / "connectivity" / "fake_connectivity.json"
    listed = json.loads(path.read_text())
    names = [viewpoint["image_id"] for viewpoint in listed]
    for viewpoint in listed:
        viewpoint["height"] = 1.4
        viewpoint["unobstructed"] = [
            viewpoint["image_id"] + other in EDGES or other + viewpoint["image_id"] in EDGES for other in names
        ]
    path.write_text(json.dumps(listed))
    (world,) = MatterportAnnotations(MatterportAnnotations.Config(root=building.root)).worlds()
    return world


def at(world, name, yaw=0.0):
    return world.stand_at(world.node(f"fake/{name}"), yaw)


def viewpoint(world, pose):
    return next(node.id for node in world.chart.map.nodes if np.allclose(node.xyz_m[:2], pose[:2, 3]))


def test_nodes_and_edges_are_the_connectivity(world):
    assert {node.id: node.regions for node in world.chart.map.nodes} == {
        "fake/a": ("fake/region-0",),
        "fake/b": ("fake/region-0",),
        "fake/c": ("fake/region-1",),
    }
    assert world.node("fake/b").xyz_m == pytest.approx((1.2, 0.3, 0.2))
    length = {(edge.start, edge.end): edge.length_m for edge in world.chart.map.edges}
    assert length == {
        ("fake/a", "fake/b"): pytest.approx(np.sqrt(1.2**2 + 0.3**2 + 0.1**2)),
        ("fake/a", "fake/c"): pytest.approx(np.hypot(0.4, 3)),
    }


@pytest.mark.parametrize(
    ("start", "azimuth_deg", "length_m", "end"),
    [
        ("a", 14.0, 1.24, "b"),
        ("a", 82.0, 3.0, "c"),
        ("a", 40.0, 1.0, "b"),
        ("c", -97.0, 2.2, "a"),
        ("a", 14.0, 2.4, None),
        ("a", 50.0, 1.24, None),
        ("a", 180.0, 1.0, None),
        ("b", 115.0, 2.8, None),
    ],
)
def test_a_walk_leads_to_the_neighbour_it_points_at(world, start, azimuth_deg, length_m, end):
    """From b, c would be at 106 deg and 2.8 m, but is no neighbour."""
    pose, stopped = world.move(at(world, start, 1.0), np.radians(azimuth_deg) - 1.0, length_m)
    assert viewpoint(world, pose) == f"fake/{end or start}"
    assert stopped == (end is None)
    assert np.cos(pose_yaw(pose) - np.radians(azimuth_deg)) == pytest.approx(1.0)


def test_the_own_frame_is_left_out_of_the_map(world):
    assert [frame.id for frame in world.references(at(world, "a"))] == ["fake/b", "fake/c"]
    assert [frame.id for frame in world.references(at(world, "c"))] == ["fake/a", "fake/b"]


def test_a_panorama_shows_the_annotations_as_the_agent_is_turned(world, building):
    seen = world.observe(at(world, "a", 0.7)).annotations.objects
    by_label = dict(zip(seen.labels, seen.centroid_m, strict=True))
    assert set(by_label) == {"arm chair", "lamp", "table"}
    label, position_m, _ = building.balls[3]
    azimuth = np.arctan2(*(np.subtract(position_m, (0, 0, 1.5))[[1, 0]])) - 0.7
    assert np.arctan2(by_label[label][1], by_label[label][0]) == pytest.approx(azimuth, abs=np.radians(2))


def test_an_agent_sees_as_queries_do(world, building):
    """Of what stands around it, what is before it."""
    whole = world.observe(at(world, "a")).annotations.objects
    settings = MatterportAnnotations.Config(root=building.root, query_fov_deg=180.0)
    (narrow,) = MatterportAnnotations(settings).worlds()
    seen = narrow.observe(at(narrow, "a")).annotations.objects
    ahead = [label for label, (x_m, *_) in zip(whole.labels, whole.centroid_m, strict=True) if x_m >= 0]
    assert seen.labels == tuple(ahead) != whole.labels


def test_told_its_place_an_agent_stands_at_its_viewpoint(world):
    nearest = localize_nearest(world, at(world, "b", 0.7), 0.4)
    np.testing.assert_allclose(nearest.answer.T_world_query, at(world, "b", 0.4))
    assert nearest.frame == "fake/b"


def test_reach_is_to_neighbours_and_itself(world):
    nodes = np.array([node.xyz_m for node in world.chart.map.nodes])
    near_b = np.array([1.0, 0.5, 1.6])
    np.testing.assert_allclose(world.chart.reach(near_b, nodes), [np.sqrt(1.2**2 + 0.3**2 + 0.1**2), 0.0, np.inf])
    np.testing.assert_allclose(world.chart.spot(near_b), [1.2, 0.3, 1.6])


def test_episodes_start_at_viewpoints(world):
    sites = {"fake": Site(world, Guide(world.chart, Dijkstra.Config()))}
    episodes, _ = draw_episodes(sites, 20, 0)
    assert all(
        viewpoint(world, np.reshape(e.start, (4, 4))) in ("fake/a", "fake/b") if e.goal == "fake/c" else True
        for e in episodes
    )
    assert {episode.goal for episode in episodes} == {"fake/a", "fake/b", "fake/c"}


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ({"start": "fake/d", "goal": "fake/a"}, "fake: unknown node 'fake/d'"),
        ({"start": "fake/hidden", "goal": "fake/a"}, "fake: unknown node 'fake/hidden'"),
        (
            {"start": [0.0, 0.0], "goal": "fake/a"},
            r"fake: received the start \(0.00, 0.00\) m, expected the id of a viewpoint",
        ),
    ],
)
def test_an_unknown_viewpoint_is_one_line(world, tmp_path, entry, line):
    path = tmp_path / "episodes.json"
    path.write_text(json.dumps([entry]))
    with pytest.raises(DataError, match=line):
        resolve_episodes(read_episode_requests(path), {"fake": Site(world, Guide(world.chart, Dijkstra.Config()))}, 0)


def test_a_building_without_neighbours_is_malformed(building):
    with pytest.raises(DataError, match=r"fake_connectivity\.json has a viewpoint without the key 'unobstructed'"):
        MatterportAnnotations(MatterportAnnotations.Config(root=building.root)).worlds()


def test_a_real_building_is_connected_and_walked(real_root):
    (world,) = MatterportAnnotations(MatterportAnnotations.Config(root=real_root, scans=("GdvgFV5R1Z5",))).worlds()
    assert len(world.chart.map.nodes) == 12
    guide = Guide(world.chart, Dijkstra.Config())
    for node in world.chart.map.nodes:
        pose = world.stand_at(node, 0.0)
        assert guide.shortest_path(pose[:3, 3], world.chart.map.nodes[0].id).length_m < 30
    for edge in world.chart.map.edges:
        a, b = (np.array(world.node(name).xyz_m) for name in (edge.start, edge.end))
        pose, stopped = world.move(
            world.stand_at(world.node(edge.start), 0.0), edge.azimuth_rad, float(np.linalg.norm((b - a)[:2]))
        )
        assert not stopped
        np.testing.assert_allclose(pose[:2, 3], b[:2])


def test_a_building_whose_viewpoints_have_no_region_allows_no_episode(world):
    nodes = tuple(replace(node, regions=()) for node in world.chart.map.nodes)
    object.__setattr__(world.chart.map, "nodes", nodes)
    with pytest.raises(DataError, match="fake has no viewpoint in any region"):
        world.draw_start(np.random.default_rng(0))
    with pytest.raises(DataError, match="fake allows no episode"):
        draw_episodes({"fake": Site(world, Guide(world.chart, Dijkstra.Config()))}, 5, 0)
