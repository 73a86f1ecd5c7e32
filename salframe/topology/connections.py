"""Connections: stairs and lifts between the storeys of a map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError, UnknownName
from salframe.framework.files.reading import read_csv_texts
from salframe.framework.validation import validate
from salframe.panoramas.floors import Connection, FloorMasks, find_floor
from salframe.panoramas.frames import ReferenceFrame
from salframe.topology.edges import components
from salframe.topology.routes import find_nodes
from salframe.topology.storeys import find_walks
from salframe.topology.topological_map import EdgeKind, MapEdge, MapNode, NodeKind, TopologicalMap

COLUMNS = ("start", "end", "kind", "length_m")
"""Columns of a file with connections."""


def read_connections(path: Path) -> list[Connection]:
    """Read connections from a CSV file with the columns start, end, kind and length_m.

    Raises:
        DataError: The file cannot be read, or a column is missing.
        ConfigError: A row has an invalid value.
    """
    columns = read_csv_texts(path, COLUMNS)
    rows = zip(*(columns[name] for name in COLUMNS), strict=True)
    return [
        validate(Connection, dict(zip(COLUMNS, row, strict=True)), f"{path}, row {number}:")
        for number, row in enumerate(rows, 2)
    ]


def connect_storeys(topology: TopologicalMap, connections: Iterable[Connection]) -> TopologicalMap:
    """Return a map with additional edges, one for each connection.

    If an end is a place with several nodes, the edge joins the two nodes that are nearest to each other in top view. If
    the map already has a connection between the same two nodes, the new connection replaces it.

    Args:
        topology: The map.
        connections: Stairs and lifts.

    Raises:
        UnknownName: The map has no node or place of this name.
        DataError: Both ends are on the same storey.
    """
    every = {}
    for connection in (*topology.connections, *connections):
        edge = _edge(topology, connection)
        every[frozenset((edge.start, edge.end))] = connection, edge
    edges = [edge for edge in topology.edges if not edge.storeys] + [edge for _, edge in every.values()]
    notes = [note for note in topology.notes if note != disconnected_note(topology.floors, topology.edges)]
    return replace(
        topology,
        edges=tuple(edges),
        connections=tuple(connection for connection, _ in every.values()),
        notes=(*notes, *filter(None, [disconnected_note(topology.floors, edges)])),
    )


def connect_by_walks(topology: TopologicalMap, frames: Sequence[ReferenceFrame]) -> TopologicalMap:
    """Return a map with a connection, and a note, for each recorded walk between its storeys.

    If there are several walks between two places, the shortest walk is used. Walks whose ends have no node are left
    out.

    Args:
        topology: The map.
        frames: The reference frames in the order of their recording.
    """
    scenes = [node for node in topology.nodes if node.kind is NodeKind.SCENE]
    of_region = {region: node.id for node in scenes for region in node.regions}
    of_frame = {frame: node.id for node in scenes for frame in node.frames}
    nodes = {frame.id: of_frame.get(frame.id) or of_region.get(frame.place) for frame in frames}
    ends = {frame: node for frame, node in nodes.items() if node is not None}
    joined: set[frozenset[str]] = set()
    for walk in sorted(find_walks(frames, ends), key=lambda walk: walk.length_m):
        places = frozenset((walk.start.place, walk.end.place))
        if places in joined:
            continue
        values = {"start": ends[walk.start.id], "end": ends[walk.end.id], "kind": walk.kind}
        connection = validate(Connection, {**values, "length_m": walk.length_m}, "recorded walk:")
        with suppress(UnknownName, DataError):
            topology = connect_storeys(topology, [connection])
            joined.add(places)
            note = (
                f"two floors are connected by {walk.kind} of {walk.length_m:.1f} m, recorded from the frame "
                f"{walk.start.id} to the frame {walk.end.id}"
            )
            topology = replace(topology, notes=(*topology.notes, note))
    return topology


def restore_connections(topology: TopologicalMap, connections: Iterable[Connection]) -> TopologicalMap:
    """Return the map with these stairs and lifts. Those that cannot be added are dropped, and a note states why."""
    for connection in connections:
        try:
            topology = connect_storeys(topology, [connection])
        except (UnknownName, DataError) as error:
            note = f"the connection ({connection.kind}) from {connection.start} to {connection.end} is dropped: {error}"
            topology = replace(topology, notes=(*topology.notes, note))
    return topology


def disconnected_note(floors: Sequence[FloorMasks], edges: Sequence[MapEdge]) -> str | None:
    """Return a note about floors that no edge connects; None if all floors are connected."""
    pairs = np.array([edge.storeys for edge in edges if edge.storeys], int).reshape(-1, 2) - 1
    count = len(set(components(len(floors), pairs).tolist()))
    if count == 1:
        return None
    heights = ", ".join(f"{floor.z_m:.2f}" for floor in floors)
    all_floors = f"the {len(floors)} floors at z = {heights} m are"
    if count == len(floors):
        return f"{all_floors} not connected: add stairs or lifts with `salframe map connect`"
    return f"{all_floors} in {count} unconnected groups: add stairs or lifts with `salframe map connect`"


def _edge(topology: TopologicalMap, connection: Connection) -> MapEdge:
    """Return the edge of a connection. Raises as `connect_storeys`."""
    nodes = {node.id: node for node in topology.nodes}
    starts, ends = ([nodes[id] for id in find_nodes(topology, name)] for name in (connection.start, connection.end))

    def offset_m(pair: Sequence[MapNode]) -> np.ndarray:
        return np.subtract(pair[1].xyz_m[:2], pair[0].xyz_m[:2])

    def storey(node: MapNode) -> int:
        return (find_floor(topology.floors, np.array(node.xyz_m)) or 0) + 1

    pairs = [pair for pair in product(starts, ends) if storey(pair[0]) != storey(pair[1])]
    if not pairs:
        raise DataError(
            f"the connection ({connection.kind}) starts at {connection.start} and ends at {connection.end}, both on "
            f"floor {storey(starts[0])}, expected two different floors"
        )
    start, end = min(pairs, key=lambda pair: float(np.hypot(*offset_m(pair))))
    storeys = storey(start), storey(end)
    x_m, y_m = offset_m((start, end))
    azimuth_rad = float(np.arctan2(y_m, x_m))
    return MapEdge(start.id, end.id, connection.length_m, azimuth_rad, kind=EdgeKind(connection.kind), storeys=storeys)
