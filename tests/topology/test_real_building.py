"""The map of a real building from its top-down pictures, against the viewpoint graph that people walked."""

from __future__ import annotations

import os
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from salframe_matterport.habitat_maps import maps_path, read_floor
from salframe_matterport.readers import connectivity_path, read_connectivity, read_regions, regions_path

from salframe.framework.files.reading import read_json
from salframe.panoramas.frames import ReferenceFrame
from salframe.topology.build import build_topology

ROOT = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")) / "matterport3d"
SCAN = "17DRP5sb8fy"

pytestmark = pytest.mark.skipif(
    not maps_path(ROOT, SCAN).is_dir(), reason=f"no {maps_path(ROOT, SCAN)}: set SALFRAME_SHARED_DATA"
)


@pytest.fixture(scope="module")
def viewpoints() -> dict[str, int]:
    """Region of each included viewpoint."""
    regions = read_regions(regions_path(ROOT))[SCAN]
    return {name: regions[name] for name in read_connectivity(connectivity_path(ROOT, SCAN))}


@pytest.fixture(scope="module")
def topology(viewpoints):
    poses = read_connectivity(connectivity_path(ROOT, SCAN))
    frames = [ReferenceFrame(name, f"{SCAN}/region-{viewpoints[name]}", pose) for name, pose in poses.items()]
    return build_topology([read_floor(ROOT, SCAN, 0.05)], frames)


def region_graph(topology) -> nx.Graph:
    pairs = [node.regions for node in topology.nodes if node.kind == "transition"]
    return nx.Graph([tuple(int(name.rsplit("-", 1)[1]) for name in pair) for pair in pairs])


def walked_pairs(viewpoints) -> set[frozenset[int]]:
    """Pairs of regions with an edge of the viewpoint graph between them."""
    entries = read_json(connectivity_path(ROOT, SCAN))
    edges = [
        (a["image_id"], b["image_id"])
        for a in entries
        for b, free in zip(entries, a["unobstructed"], strict=True)
        if free
    ]
    known = [(a, b) for a, b in edges if a in viewpoints and b in viewpoints]
    return {frozenset((viewpoints[a], viewpoints[b])) for a, b in known if viewpoints[a] != viewpoints[b]}


def test_regions_are_joined_as_people_walked_between_them(topology, viewpoints):
    """Of the map's ten pairs of regions nine have an edge of the viewpoint graph; at the tenth, 7 and 9, three regions
    of one hall meet.

    Edges of the viewpoint graph are up to 4.5 m long: where the map has no doorway for one, it leads across a third
    region.
    """
    region_edges, walked = region_graph(topology), walked_pairs(viewpoints)
    assert set(region_edges) == set(viewpoints.values()) == set(range(10))
    assert nx.is_connected(region_edges)
    assert {frozenset(pair) for pair in region_edges.edges} - walked == {frozenset((7, 9))}
    assert all(nx.shortest_path_length(region_edges, *pair) <= 2 for pair in walked)


def test_every_region_is_reached_and_what_is_not_is_told(topology, viewpoints):
    graph = nx.Graph([(edge.start, edge.end) for edge in topology.edges])
    main = max(nx.connected_components(graph), key=len)
    assert {name for node in topology.nodes if node.id in main for name in node.regions} == set(
        topology.floors[0].regions.values()
    )
    scenes = {node.id: node for node in topology.nodes if node.kind == "scene"}
    notes = "\n".join(topology.notes)
    for name in viewpoints:
        if name not in scenes:
            assert f"frame {name} at" in notes  # it stands on a sofa or in a shower
        elif name not in main:
            assert f"node {name} cannot be reached" in notes
    assert len(main & set(scenes)) >= 0.9 * len(viewpoints)


def test_edges_are_as_long_as_the_viewpoints_are_apart(topology):
    poses = read_connectivity(connectivity_path(ROOT, SCAN))
    straight = [edge for edge in topology.edges if not edge.path_m and {edge.start, edge.end} <= set(poses)]
    assert len(straight) > 50
    along = np.array([poses[edge.end][:2, 3] - poses[edge.start][:2, 3] for edge in straight])
    away_m = [abs(edge.length_m - np.hypot(*step)) for edge, step in zip(straight, along, strict=True)]
    assert max(away_m) < 0.2  # of viewpoints beside furniture, moved by 0.11 m at most
    assert np.median(away_m) < 1e-9
