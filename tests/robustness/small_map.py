"""A topological map of three nodes and two edges, a hall in a row, the second way with a corner."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from salframe.localization.map_files import write_map
from salframe.panoramas.floors import FloorMasks
from salframe.topology.store import write_topology
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap, TopologySettings


def write_small_map(directory: Path) -> None:
    """Write it to a folder."""
    nodes = tuple(
        MapNode(name, NodeKind.SCENE, (x, 0.0, 0.0), ("hall",) * (1 + number), (f"{name}-map",))
        for number, (name, x) in enumerate((("a", 0.0), ("b", 2.0), ("c", 5.0)))
    )
    edges = (MapEdge("a", "b", 2.0, 0.0), MapEdge("b", "c", 6.0, 0.0, ((2.0, 0.0), (2.0, 1.5), (5.0, 1.5), (5.0, 0.0))))
    free = np.ones((20, 30), bool)
    floor = FloorMasks(free, np.where(free, 1, 0).astype(np.int32), ~free, 0.25, (-1.0, 2.5), {1: "hall"})
    with write_map(directory) as parts:
        write_topology(parts, TopologicalMap(nodes, edges, (floor,), TopologySettings(snap_m=0.25), ("a note",)))
