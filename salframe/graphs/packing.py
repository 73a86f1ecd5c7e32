"""Graphs as a few hundred bytes, as named arrays, and as a table."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files import atomic_path
from salframe.graphs.graph import REACH_M, SaliencyGraph

_NODE = np.dtype(
    [
        ("label", "<u2"),
        ("score", "u1"),
        ("yaw", "u1"),
        ("saliency", "<u2"),
        ("position_mm", "<i2", 3),
        ("size_mm", "<u2", 3),
    ]
)


def pack_graph(graph: SaliencyGraph, vocabulary: Mapping[str, int]) -> bytes:
    """The graph in 2 + 18 N bytes and an edge bit matrix: label index, score (1/255), yaw (pi/256), saliency (1/65535),
    position and box in mm.

    Raises DataError on a label outside the vocabulary or a position beyond +-32.7 m.
    """
    unknown = set(graph.labels) - set(vocabulary)
    if unknown:
        raise DataError(f"label {min(unknown)!r} is not in the vocabulary of {len(vocabulary)} labels")
    if len(graph) and np.abs(graph.centroid_m).max() > REACH_M:
        raise DataError(f"an object lies {np.abs(graph.centroid_m).max():.1f} m away, expected at most {REACH_M} m")
    nodes = np.zeros(len(graph), _NODE)
    nodes["label"] = [vocabulary[label] for label in graph.labels]
    nodes["score"] = np.round(graph.scores * 255)
    nodes["saliency"] = np.round(graph.saliency * 65535)
    nodes["position_mm"] = np.round(graph.centroid_m * 1000)
    nodes["size_mm"] = np.round(np.minimum(graph.size_m, 65.535) * 1000)
    nodes["yaw"] = np.round(graph.yaw_rad % np.pi * 256 / np.pi).astype(int) % 256
    bits = graph.adjacency[np.triu_indices(len(graph), 1)]
    return struct.pack("<H", len(graph)) + nodes.tobytes() + np.packbits(bits).tobytes()


def unpack_graph(data: bytes, labels: Sequence[str]) -> SaliencyGraph:
    """The graph that `pack_graph` wrote, to its rounding; labels by index. Raises DataError on data cut short."""
    count = struct.unpack_from("<H", data)[0] if len(data) >= 2 else 0
    pairs = count * (count - 1) // 2
    if len(data) != 2 + 18 * count + (pairs + 7) // 8:
        raise DataError(
            f"a packed graph of {count} nodes has {2 + 18 * count + (pairs + 7) // 8} bytes, received {len(data)}"
        )
    nodes = np.frombuffer(data, _NODE, count, 2)
    bits = np.unpackbits(np.frombuffer(data, np.uint8, offset=2 + 18 * count), count=pairs).astype(bool)
    edges = np.column_stack(np.triu_indices(count, 1))[bits]
    names = tuple(labels[i] for i in nodes["label"])
    return SaliencyGraph(
        names,
        nodes["score"] / 255,
        nodes["saliency"] / 65535,
        nodes["position_mm"] / 1000,
        nodes["size_mm"] / 1000,
        nodes["yaw"] * np.pi / 256,
        edges,
    )


def graph_to_arrays(graph: SaliencyGraph) -> dict[str, np.ndarray]:
    """The graph as named arrays, exact."""
    labels = np.array(graph.labels, dtype=np.str_)
    bearing = {"bearing": graph.bearing} if graph.bearings_only else {}  # elsewhere that of the centroids
    out_of_reach = {"out_of_reach": np.array(graph.out_of_reach)} if graph.out_of_reach else {}
    return {
        "labels": labels,
        "scores": graph.scores,
        "saliency": graph.saliency,
        "centroid_m": graph.centroid_m,
        "size_m": graph.size_m,
        "yaw_rad": graph.yaw_rad,
        "edges": graph.edges,
        **bearing,
        **out_of_reach,
    }


def graph_from_arrays(arrays: Mapping[str, np.ndarray]) -> SaliencyGraph:
    """The graph that `graph_to_arrays` made."""
    fields = {name: arrays[name] for name in ("scores", "saliency", "centroid_m", "size_m", "yaw_rad", "edges")}
    if "bearing" in arrays:
        fields["bearing"] = arrays["bearing"]
    out_of_reach = int(arrays.get("out_of_reach", 0))
    return SaliencyGraph(tuple(arrays["labels"].tolist()), **fields, out_of_reach=out_of_reach)


def write_graphs(path: Path, graphs: Sequence[SaliencyGraph]) -> None:
    """Graphs as one Parquet table, a row a node; `neighbours` lists the later nodes of the same scene it is in context
    with."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows: dict[str, list] = {
        name: []
        for name in (
            "scene",
            "node",
            "label",
            "score",
            "saliency",
            "x_m",
            "y_m",
            "z_m",
            "length_m",
            "width_m",
            "height_m",
            "yaw_rad",
            "azimuth_rad",
            "range_m",
            "neighbours",
        )
    }
    for scene, graph in enumerate(graphs):
        for node in range(len(graph)):
            neighbours = graph.edges[graph.edges[:, 0] == node, 1].tolist()
            values = (
                scene,
                node,
                graph.labels[node],
                graph.scores[node],
                graph.saliency[node],
                *graph.centroid_m[node],
                *graph.size_m[node],
                graph.yaw_rad[node],
                graph.azimuth_rad[node],
                graph.range_m[node],
                neighbours,
            )
            for column, value in zip(rows.values(), values, strict=True):
                column.append(value)
    types = {"scene": pa.int32(), "node": pa.int32(), "label": pa.string(), "neighbours": pa.list_(pa.int32())}
    count = {"scenes": str(len(graphs))}  # a scene without objects has no row
    schema = pa.schema([(name, types.get(name, pa.float64())) for name in rows], metadata=count)
    with atomic_path(path) as temporary:
        pq.write_table(pa.table(rows, schema), temporary)


def read_graphs(path: Path, count: int) -> list[SaliencyGraph]:
    """The `count` graphs that `write_graphs` wrote. Raises DataError where it wrote more or fewer, or is no such
    table."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
        column = {name: table[name].to_numpy() for name in table.column_names if name not in ("label", "neighbours")}
        label, neighbours = table["label"].to_pylist(), table["neighbours"].to_pylist()
        centroid = np.column_stack([column["x_m"], column["y_m"], column["z_m"]])
        size = np.column_stack([column["length_m"], column["width_m"], column["height_m"]])
        written = int(table.schema.metadata[b"scenes"])
    except (OSError, pa.ArrowException, KeyError, TypeError) as error:
        raise DataError(f"{path} is not a table of graphs: {' '.join(str(error).split())}") from None
    if written != count:
        raise DataError(f"{path} has {written} graphs, expected {count}")
    graphs = []
    for scene in range(count):
        rows = np.flatnonzero(column["scene"] == scene)
        edges = [(int(column["node"][r]), b) for r in rows for b in neighbours[r]]
        graphs.append(
            SaliencyGraph(
                tuple(label[r] for r in rows),
                column["score"][rows],
                column["saliency"][rows],
                centroid[rows],
                size[rows],
                column["yaw_rad"][rows],
                np.array(edges, np.int64).reshape(-1, 2),
            )
        )
    return graphs
