"""Routes against networkx, on random graphs and on maps of rendered buildings."""

from __future__ import annotations

import itertools
from functools import lru_cache

import networkx as nx
import numpy as np
import pytest
from conformance import conforms
from salframe_house.building import generate_building
from salframe_planners.planners import Dijkstra, FloydWarshall

from salframe.framework.errors import NoRoute, UnknownName
from salframe.topology.build import build_topology
from salframe.topology.topological_map import MapEdge, MapNode, TopologicalMap

PLANNERS = [FloydWarshall, Dijkstra]


def random_map(seed: int, count: int = 40) -> TopologicalMap:
    """Points in the plane, about three random edges each, some longer than straight, some pairs joined twice."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 30, (count, 2))
    nodes = tuple(MapNode(f"n{i}", "scene", (x, y, 0.0), (f"room-{i}",)) for i, (x, y) in enumerate(xy))
    edges = []
    for i, j in rng.integers(0, count, (3 * count // 2, 2)):
        if i != j:
            along = xy[j] - xy[i]
            straight = MapEdge(f"n{i}", f"n{j}", float(np.hypot(*along)), float(np.arctan2(along[1], along[0])))
            edges.append(straight)
            if rng.random() < 0.3:
                bend = xy[i] + rng.normal(0, 3, 2)
                length = float(np.linalg.norm(bend - xy[i]) + np.linalg.norm(xy[j] - bend))
                path = tuple((float(x), float(y)) for x, y in (xy[i], bend, xy[j]))
                edges.append(MapEdge(f"n{j}", f"n{i}", length, float(np.arctan2(-along[1], -along[0])), path[::-1]))
    return TopologicalMap(nodes, tuple(edges))


@lru_cache
def house_map(style: str, rooms: int, seed: int) -> TopologicalMap:
    return build_topology([generate_building(style, rooms, seed).floor_masks(0.1)])


def networkx_lengths(topology: TopologicalMap) -> dict[str, dict[str, float]]:
    graph = nx.Graph()
    graph.add_nodes_from(node.id for node in topology.nodes)
    for edge in topology.edges:
        known = graph.get_edge_data(edge.start, edge.end, {"length": np.inf})["length"]
        graph.add_edge(edge.start, edge.end, length=min(known, edge.length_m))
    return dict(nx.all_pairs_dijkstra_path_length(graph, weight="length"))


MAPS = {
    **{f"random-{seed}": lambda seed=seed: random_map(seed) for seed in range(4)},
    "home-12": lambda: house_map("home", 12, 1),
    "office-18": lambda: house_map("office", 18, 2),
}


@pytest.mark.parametrize("planner", PLANNERS)
def test_it_keeps_the_promises_of_the_role(planner):
    assert conforms(planner)


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("name", MAPS)
def test_every_route_is_as_short_as_networkx_finds_and_is_walked_edge_by_edge(planner, name):
    topology = MAPS[name]()
    expected = networkx_lengths(topology)
    given = {(edge.start, edge.end): edge for edge in topology.edges}
    position = {node.id: np.array(node.xyz_m[:2]) for node in topology.nodes}
    made = planner()
    made.prepare(topology)
    reached = 0
    for start, goal in itertools.product(position, repeat=2):
        if goal not in expected[start]:
            with pytest.raises(NoRoute, match=f"no route from {start} to {goal}"):
                made.route(start, goal)
            continue
        route = made.route(start, goal)
        reached += 1
        assert abs(route.length_m - expected[start][goal]) < 1e-9
        assert (route.nodes[0], route.nodes[-1]) == (start, goal)
        assert [(leg.start, leg.end) for leg in route.legs] == list(itertools.pairwise(route.nodes))
        for leg in route.legs:
            along = position[leg.end] - position[leg.start]
            assert abs(np.angle(np.exp(1j * (leg.azimuth_rad - np.arctan2(along[1], along[0]))))) < 1e-9
            assert (leg.start, leg.end) in given or (leg.end, leg.start) in given
            if leg.path_m:
                np.testing.assert_allclose(
                    [leg.path_m[0], leg.path_m[-1]], [position[leg.start], position[leg.end]], atol=1e-9
                )
    assert reached > len(position)


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_node_that_is_not_there_is_named_with_the_closest(planner):
    made = planner()
    made.prepare(random_map(0))
    with pytest.raises(UnknownName, match="unknown node 'n-7', did you mean 'n7'"):
        made.route("n1", "n-7")


@pytest.mark.parametrize("planner", PLANNERS)
def test_two_nodes_at_one_spot_are_joined_by_an_edge_of_no_length(planner):
    nodes = tuple(MapNode(name, "scene", (x, 0.0, 0.0), (name,)) for name, x in (("a", 0.0), ("b", 0.0), ("c", 2.0)))
    made = planner()
    made.prepare(TopologicalMap(nodes, (MapEdge("a", "b", 0.0, 0.0), MapEdge("b", "c", 2.0, 0.0))))
    assert made.route("a", "c").nodes == ("a", "b", "c")
    assert made.route("a", "c").length_m == 2.0
