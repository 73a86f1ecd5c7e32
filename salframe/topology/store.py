"""A topological map on disk: nodes and edges as Parquet, floors as an array archive, the rest as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from salframe.framework.errors import DataError
from salframe.framework.files import atomic_path, read_json, write_json
from salframe.panoramas.floors import read_floors, write_floors
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap

TOPOLOGY, FORMAT = "topology.json", 1


def write_topology(directory: Path, topology: TopologicalMap) -> None:
    """Write a map to a folder: topology.json (format, parameters, notes, floors), nodes.parquet, edges.parquet,
    floors.npz, each atomically."""
    directory.mkdir(parents=True, exist_ok=True)
    _write_table(directory / "nodes.parquet", _node_rows(topology), _node_schema())
    _write_table(directory / "edges.parquet", [asdict(edge) for edge in topology.edges], _edge_schema())
    content = {
        "format": FORMAT,
        "parameters": dict(topology.parameters),
        "notes": list(topology.notes),
        "floors": write_floors(directory, topology.floors),
    }
    write_json(directory / TOPOLOGY, content)


def read_topology(directory: str | Path) -> TopologicalMap:
    """The map that `write_topology` wrote, identical. Raises DataError where the folder holds none, or one of another
    format."""
    directory = Path(directory)
    if not (directory / TOPOLOGY).exists():
        raise DataError(f"{directory} holds no topological map: make one with salframe map build DATA -o {directory}")
    content = read_json(directory / TOPOLOGY)
    try:
        if content["format"] != FORMAT:
            raise DataError(f"{directory} has topology format {content['format']}, expected {FORMAT}: build it again")
        floors = read_floors(directory, content["floors"])
        nodes = tuple(
            MapNode(
                row["id"],
                NodeKind(row["kind"]),
                (row["x_m"], row["y_m"], row["z_m"]),
                tuple(row["regions"]),
                tuple(row["frames"]),
            )
            for row in _read_table(directory / "nodes.parquet")
        )
        edges = tuple(
            MapEdge(
                row["start"],
                row["end"],
                row["length_m"],
                row["azimuth_rad"],
                tuple(tuple(point) for point in row["path_m"]),
            )
            for row in _read_table(directory / "edges.parquet")
        )
        return TopologicalMap(nodes, edges, floors, content["parameters"], tuple(content["notes"]))
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"{directory} is no whole topological map ({type(error).__name__}: {error}): build it again"
        ) from None


def _node_rows(topology: TopologicalMap) -> list[dict[str, Any]]:
    names = ("x_m", "y_m", "z_m")
    return [
        {
            "id": node.id,
            "kind": node.kind,
            **dict(zip(names, node.xyz_m, strict=True)),
            "regions": node.regions,
            "frames": node.frames,
        }
        for node in topology.nodes
    ]


def _node_schema():
    import pyarrow as pa

    text, number = pa.string(), pa.float64()
    return pa.schema(
        [
            ("id", text),
            ("kind", text),
            ("x_m", number),
            ("y_m", number),
            ("z_m", number),
            ("regions", pa.list_(text)),
            ("frames", pa.list_(text)),
        ]
    )


def _edge_schema():
    import pyarrow as pa

    number = pa.float64()
    return pa.schema(
        [
            ("start", pa.string()),
            ("end", pa.string()),
            ("length_m", number),
            ("azimuth_rad", number),
            ("path_m", pa.list_(pa.list_(number))),
        ]
    )


def _write_table(path: Path, rows: list[dict[str, Any]], schema) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    with atomic_path(path) as temporary:
        pq.write_table(pa.Table.from_pylist(rows, schema), temporary)


def _read_table(path: Path) -> list[dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.read_table(path).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise DataError(f"cannot read {path}: {' '.join(str(error).split())}") from None
