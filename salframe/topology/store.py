"""Read and write a topological map as parts of a saved map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError, UnknownName
from salframe.framework.files.array_files import ArrayKind
from salframe.framework.files.columns import Row
from salframe.framework.files.reading import reading
from salframe.framework.validation import Settings
from salframe.localization.map_files import MapParts, read_map, write_map
from salframe.panoramas.floors import Connection
from salframe.panoramas.geometry import wrap_angle
from salframe.topology.connections import connect_storeys
from salframe.topology.signs import nearest_to_signs
from salframe.topology.topological_map import (
    EdgeKind,
    MapEdge,
    MapNode,
    NodeKind,
    TopologicalMap,
    TopologySettings,
    TopologySources,
)

TOPOLOGY, NODES, EDGES = "topology.json", "nodes", "edges"
_NAME, _NAMES, _NUMBER = ArrayKind("U", ()), ArrayKind("U", (None,)), ArrayKind("f", ())
_NODE = {"id": _NAME, "kind": _NAME, "xyz_m": ArrayKind("f", (3,)), "regions": _NAMES, "frames": _NAMES}
_EDGE = {"start": _NAME, "end": _NAME, "length_m": _NUMBER, "azimuth_rad": _NUMBER, "path_m": ArrayKind("f", (None, 2))}
_NEAR_M, _NEAR_RAD = 1e-3, 1e-3
"""Tolerances in metres and radians when edges are compared with the positions of their nodes."""


class _Saved(Settings):
    """Content of topology.json."""

    parameters: TopologySettings
    notes: tuple[str, ...]
    sources: TopologySources = TopologySources()
    connections: tuple[Connection, ...] = ()


def open_topology(directory: str | Path) -> TopologicalMap:
    """Return the topological map in a folder, identical to the written map.

    Raises:
        DataError: The folder holds no topological map, or one that was edited or is incomplete.
    """
    return read_map(Path(directory), read_topology)


def write_topology(parts: MapParts, topology: TopologicalMap) -> None:
    """Write a topological map as parts of a saved map: topology.json (parameters, notes, sources and connections), the
    nodes, the edges of kind "walk", and the floors."""
    _write_settings(parts, topology)
    parts.write_table(NODES, map(_node_row, topology.nodes))
    parts.write_table(EDGES, (_edge_row(edge) for edge in topology.edges if edge.kind is EdgeKind.WALK))
    parts.write_floors(topology.floors)


def _write_settings(parts: MapParts, topology: TopologicalMap) -> None:
    parts.write_json(
        TOPOLOGY,
        {
            "parameters": topology.parameters.model_dump(),
            "notes": list(topology.notes),
            "sources": topology.sources.model_dump(mode="json"),
            "connections": [connection.model_dump(mode="json") for connection in topology.connections],
        },
    )


def connect_map(directory: str | Path, connections: Iterable[Connection]) -> TopologicalMap:
    """Add stairs and lifts to the map in the folder `directory`, and return its topology. If an error occurs, the map
    does not change.

    Raises:
        DataError: The folder holds no topological map, or both ends of a connection are on the same storey.
        UnknownName: The map has no node or place of this name.
    """
    directory, connections = Path(directory), list(connections)
    open_topology(directory)  # report a missing map before write_map creates its folder
    with write_map(directory) as parts:
        topology = connect_storeys(read_map(directory, read_topology), connections)
        read_map(directory, lambda old: old.copy_to(parts.folder))
        _write_settings(parts, topology)
    return topology


def read_topology(parts: MapParts) -> TopologicalMap:
    """Return the topological map from the parts of a saved map.

    Raises:
        DataError: The saved map has no topology, or the topology is invalid.
    """
    if not parts.has(TOPOLOGY):
        raise DataError(
            f"{parts.folder.parent} contains no topology: build the map again, from data with floor masks or range, "
            "and without --no-topology"
        )
    saved = parts.read_json(TOPOLOGY, _Saved)
    with reading(parts.folder / NODES, "nodes of a map"):
        nodes = tuple(_node(row) for row in parts.read_table(NODES, _NODE))
    edges = tuple(_edge(row) for row in parts.read_table(EDGES, _EDGE))
    _check_edges(parts.folder / EDGES, nodes, edges)
    signs = nearest_to_signs(parts, nodes)
    topology = TopologicalMap(
        nodes, edges, parts.read_floors(), saved.parameters, saved.notes, saved.sources, signs=signs
    )
    if not saved.connections:
        return topology
    try:
        return connect_storeys(topology, saved.connections)
    except UnknownName as error:
        raise DataError(f"{parts.folder / TOPOLOGY}: {error} Build the map again.") from None


def _check_edges(path: Path, nodes: Sequence[MapNode], edges: Sequence[MapEdge]) -> None:
    """Check that ids are unique and that edges agree with the positions of their nodes.

    Raises:
        DataError: Two nodes have the same id; or an edge has unknown nodes; or its azimuth, length or path does not
            match the positions of its nodes.
    """
    place = {node.id: np.array(node.xyz_m) for node in nodes}
    if len(place) < len(nodes):
        raise DataError(
            f"{path.with_name(NODES)} has {len(nodes)} nodes and {len(place)} different ids, "
            "expected unique ids: build the map again"
        )
    for edge in edges:
        if edge.start not in place or edge.end not in place:
            raise DataError(
                f"{path}: received an edge from {edge.start!r} to {edge.end!r}, expected two nodes of the "
                "map: build the map again"
            )
        ends = np.stack([place[edge.start], place[edge.end]])
        x_m, y_m, _ = ends[1] - ends[0]
        error_rad = abs(wrap_angle(edge.azimuth_rad - np.arctan2(y_m, x_m))) if np.hypot(x_m, y_m) > _NEAR_M else 0.0
        corners = np.array(edge.path_m) if edge.path_m else ends[:, :2]
        ends_differ = np.abs(corners[[0, -1]] - ends[:, :2]).max() > _NEAR_M
        error_m = abs(edge.length_m - np.hypot(*np.diff(corners, axis=0).T).sum())
        if error_rad > _NEAR_RAD or error_m > _NEAR_M or ends_differ:
            raise DataError(
                f"{path}: the edge from {edge.start} to {edge.end} is {edge.length_m:.2f} m long at "
                f"{np.degrees(edge.azimuth_rad):.0f} deg, which does not match the positions of these "
                "nodes: build the map again"
            )


def _node_row(node: MapNode) -> Row:
    return {
        "id": np.array(node.id),
        "kind": np.array(str(node.kind)),
        "xyz_m": np.array(node.xyz_m, np.float64),
        "regions": np.array(node.regions, np.str_),
        "frames": np.array(node.frames, np.str_),
    }


def _node(row: Row) -> MapNode:
    x, y, z = row["xyz_m"].tolist()
    regions, frames = tuple(row["regions"].tolist()), tuple(row["frames"].tolist())
    return MapNode(str(row["id"]), NodeKind(str(row["kind"])), (x, y, z), regions, frames)


def _edge_row(edge: MapEdge) -> Row:
    return {
        "start": np.array(edge.start),
        "end": np.array(edge.end),
        "length_m": np.array(edge.length_m, np.float64),
        "azimuth_rad": np.array(edge.azimuth_rad, np.float64),
        "path_m": np.array(edge.path_m, np.float64).reshape(-1, 2),
    }


def _edge(row: Row) -> MapEdge:
    path = tuple((x, y) for x, y in row["path_m"].tolist())
    return MapEdge(str(row["start"]), str(row["end"]), float(row["length_m"]), float(row["azimuth_rad"]), path)
