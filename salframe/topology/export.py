"""Exports a map to other programs: its topology as GraphML or GeoJSON, its scenes as Parquet."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.errors import ConfigError
from salframe.framework.files.writing import atomic_path, write_text
from salframe.localization.export import export_scenes
from salframe.topology.store import open_topology
from salframe.topology.topological_map import TopologicalMap

COORDINATES = (
    "x, y, z in metres in the map's world frame, z up; "
    "not longitude and latitude, although GeoJSON readers interpret them as WGS 84"
)
"""Coordinates of GeoJSON, stated in every file."""


def export_map(directory: str | Path, path: str | Path) -> None:
    """Write the topology of a map as .graphml or .geojson, or its scenes as .parquet, by the file's suffix.

    Raises:
        ConfigError: The file has another suffix.
        DataError: The map has no such part.
    """
    directory, path = Path(directory), Path(path)
    if path.suffix == ".parquet":
        export_scenes(directory, path)
    elif path.suffix in _WRITERS:
        _WRITERS[path.suffix](open_topology(directory), path)
    else:
        suffixes = f"{', '.join(_WRITERS)} or .parquet"
        raise ConfigError(f"received the file {path.name}, expected one that ends in {suffixes}")


def _write_graphml(topology: TopologicalMap, path: Path) -> None:
    """Write nodes with kind, x_m, y_m, z_m, regions and frames, and edges with kind, length_m, azimuth_deg and path_m;
    lists are joined by ';'."""
    import networkx as nx

    graph = nx.MultiGraph(name="topological map")
    for node in topology.nodes:
        x, y, z = node.xyz_m
        regions, frames = ";".join(node.regions), ";".join(node.frames)
        graph.add_node(node.id, kind=str(node.kind), x_m=x, y_m=y, z_m=z, regions=regions, frames=frames)
    for edge in topology.edges:
        corners = ";".join(f"{x} {y}" for x, y in edge.path_m)
        graph.add_edge(
            edge.start,
            edge.end,
            kind=str(edge.kind),
            length_m=edge.length_m,
            azimuth_deg=float(np.degrees(edge.azimuth_rad)),
            path_m=corners,
        )
    with atomic_path(path) as temporary:
        nx.write_graphml(graph, temporary)


def _write_geojson(topology: TopologicalMap, path: Path) -> None:
    write_text(path, json.dumps(topology_geojson(topology), indent=1, allow_nan=False) + "\n")


def topology_geojson(topology: TopologicalMap) -> dict[str, Any]:
    """Return a point for each node and a line for each edge as GeoJSON.

    GeoJSON coordinates are longitude and latitude; these are local metres, which is stated in the collection.
    """
    height = {node.id: node.xyz_m[2] for node in topology.nodes}
    place = {node.id: node.xyz_m[:2] for node in topology.nodes}
    features = [
        geojson_feature("Point", node.xyz_m, id=node.id, kind=node.kind, regions=node.regions, frames=node.frames)
        for node in topology.nodes
    ]
    for edge in topology.edges:
        line = [(x, y, height[edge.start]) for x, y in edge.path_m]
        line = line or [(*place[id], height[id]) for id in (edge.start, edge.end)]
        azimuth_deg = float(np.degrees(edge.azimuth_rad))
        features.append(
            geojson_feature(
                "LineString",
                line,
                start=edge.start,
                end=edge.end,
                kind=edge.kind,
                length_m=edge.length_m,
                azimuth_deg=azimuth_deg,
            )
        )
    return {"type": "FeatureCollection", "properties": {"coordinates": COORDINATES}, "features": features}


def geojson_feature(geometry: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """Return a GeoJSON feature of a geometry with coordinates in metres and properties."""
    return {"type": "Feature", "geometry": {"type": geometry, "coordinates": coordinates}, "properties": properties}


_WRITERS: dict[str, Callable[[TopologicalMap, Path], None]] = {".graphml": _write_graphml, ".geojson": _write_geojson}
