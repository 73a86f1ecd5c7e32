"""Export a map for other programs. The suffix of the file selects the format."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files.writing import atomic_path, write_text
from salframe.localization.export import export_scenes
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import METHOD, MapParts, read_map
from salframe.topology.geojson import GeoAnchor, map_geojson
from salframe.topology.map_server import write_map_server
from salframe.topology.places_json import write_places
from salframe.topology.store import TOPOLOGY, open_topology, read_topology
from salframe.topology.svg_plan import write_plan
from salframe.topology.topological_map import TopologicalMap


def export_map(directory: str | Path, path: str | Path, anchor: GeoAnchor | None = None) -> tuple[Path, ...]:
    """Write a map to a file for other programs. The suffix of the file selects the format.

    - .json: the places with their frames and objects, and a JSON schema beside it.
    - .geojson: floors, places, objects, nodes and edges.
    - .yaml: the free floor for map_server of ROS, with a PGM image per storey.
    - .svg: a floor plan.
    - .graphml: the topology.
    - .parquet: the descriptions of the reference frames.

    Args:
        directory: The saved map.
        path: The file.
        anchor: Geographic anchor of a .geojson file; None: its coordinates are metres.

    Returns:
        The written files.

    Raises:
        ConfigError: The file has another suffix, or an anchor was passed for another format.
        DataError: The map lacks the part that the format needs.
    """
    directory, path = Path(directory), Path(path)
    if path.suffix not in _WRITERS:
        *suffixes, last = _WRITERS
        raise ConfigError(f"received the file {path.name}, expected one that ends in {', '.join(suffixes)} or {last}")
    if anchor is not None and path.suffix != ".geojson":
        raise ConfigError(
            f"received an anchor (--anchor), but {path.name} cannot store it: leave out the anchor, or write "
            "a .geojson file"
        )
    if path.suffix == ".geojson":
        return _write_geojson(directory, path, anchor)
    return _WRITERS[path.suffix](directory, path)


def _read_both(parts: MapParts) -> tuple[LocalizationMap | None, TopologicalMap | None]:
    localization = LocalizationMap.read(parts, indexed=False) if parts.has(METHOD) else None
    return localization, read_topology(parts) if parts.has(TOPOLOGY) else None


def _write_geojson(directory: Path, path: Path, anchor: GeoAnchor | None = None) -> tuple[Path, ...]:
    localization, topology = read_map(directory, _read_both)
    collection = map_geojson(directory.name, localization, topology, anchor)
    write_text(path, json.dumps(collection, indent=1, allow_nan=False) + "\n")
    return (path,)


def _write_json(directory: Path, path: Path) -> tuple[Path, ...]:
    localization, _ = read_map(directory, _read_both)
    if localization is None:
        raise DataError(
            f"{directory} has no reference frames, expected a map that was built from panoramas with poses and places"
        )
    return write_places(directory.name, localization, path)


def _write_map_server(directory: Path, path: Path) -> tuple[Path, ...]:
    return write_map_server(open_topology(directory).floors, path)


def _write_svg(directory: Path, path: Path) -> tuple[Path, ...]:
    localization, topology = read_map(directory, _read_both)
    if topology is None:
        raise DataError(
            f"{directory} has no topology (graph for routes), expected a map that was built from data with floor "
            "masks or range"
        )
    write_plan(directory.name, localization, topology, path)
    return (path,)


def _write_parquet(directory: Path, path: Path) -> tuple[Path, ...]:
    export_scenes(directory, path)
    return (path,)


def _write_graphml(directory: Path, path: Path) -> tuple[Path, ...]:
    """Write the topology as GraphML.

    Nodes have the attributes kind, x_m, y_m, z_m, regions and frames. Edges have the attributes kind, length_m,
    azimuth_deg and path_m. Lists are joined by ';'.
    """
    import networkx as nx

    topology = open_topology(directory)
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
    return (path,)


_WRITERS: dict[str, Callable[[Path, Path], tuple[Path, ...]]] = {
    ".json": _write_json,
    ".geojson": _write_geojson,
    ".yaml": _write_map_server,
    ".svg": _write_svg,
    ".graphml": _write_graphml,
    ".parquet": _write_parquet,
}
