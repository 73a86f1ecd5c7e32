"""The 360-degree saliency graph: from scored objects to a graph, to a few hundred bytes, and to a table (method.md 2)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from salframe.errors import DataError
from salframe.storage import atomic_path
from salframe.types import Detections, SaliencyGraph


class GraphConfig(BaseModel):
    """Which objects become nodes and which nodes are in context."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    min_share: float = Field(0.0, ge=0, le=1, description="least saliency (share of volume) of a node")
    top_k: int | None = Field(None, ge=1, description="keep the k most salient objects at most; null: all")
    extent: Literal["mean", "max"] = Field("mean", description="l of Eq. 1: mean or largest box dimension")
    distance: Literal["surface", "centroid"] = Field("surface", description="d_s of Eq. 1: between the upright boxes or the centroids")


def build_graph(detections: Detections, saliency: np.ndarray, config: GraphConfig) -> SaliencyGraph:
    """The saliency graph of detections with known positions and their saliency (N,).

    Nodes run from the most to the least salient; E(a, b) = 1 iff min(l_a, l_b) > d_s(a, b) (paper Eq. 1).
    """
    keep = np.flatnonzero((saliency >= config.min_share) & np.isfinite(detections.centroid_m).all(1))
    # Ties are broken by position, not by order of detection, which turning the panorama changes.
    keep = keep[np.lexsort((detections.centroid_m[keep, 2], -saliency[keep]))][: config.top_k]
    chosen, saliency = detections.take(keep), saliency[keep]
    extent = chosen.size_m.mean(1) if config.extent == "mean" else chosen.size_m.max(1, initial=0)
    distance = box_distances(chosen) if config.distance == "surface" else _centroid_distances(chosen.centroid_m)
    a, b = np.triu_indices(len(chosen), 1)
    linked = np.minimum(extent[a], extent[b]) > distance[a, b]
    edges = np.column_stack([a[linked], b[linked]])
    return SaliencyGraph(chosen.labels, chosen.scores, saliency, chosen.centroid_m, chosen.size_m, chosen.yaw_rad, edges)


def _centroid_distances(centroid_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm(centroid_m[:, None] - centroid_m[None], axis=2)


def box_distances(detections: Detections) -> np.ndarray:
    """(N, N) float64 metres between the surfaces of the upright boxes, 0 where they touch or overlap."""
    import shapely

    c, s = np.cos(detections.yaw_rad), np.sin(detections.yaw_rad)
    along = np.stack([c, s], 1) * detections.size_m[:, :1] / 2
    across = np.stack([-s, c], 1) * detections.size_m[:, 1:2] / 2
    corners = detections.centroid_m[:, None, :2] + np.stack([along + across, along - across, -along - across, across - along], 1)
    footprint = shapely.polygons(corners) if len(corners) else np.empty(0, object)
    flat = shapely.distance(footprint[:, None], footprint[None])
    z, half = detections.centroid_m[:, 2], detections.size_m[:, 2] / 2
    gap = np.maximum(np.abs(z[:, None] - z[None]) - half[:, None] - half[None], 0)
    return np.hypot(flat, gap)


_NODE = np.dtype([("label", "<u2"), ("score", "u1"), ("yaw", "u1"), ("saliency", "<u2"), ("position_mm", "<i2", 3), ("size_mm", "<u2", 3)])


def pack_graph(graph: SaliencyGraph, vocabulary: Mapping[str, int]) -> bytes:
    """The graph in 2 + 18 N bytes and an edge bit matrix: label index, score (1/255), yaw (pi/256), saliency (1/65535), position and box
    in mm.

    Raises DataError on a label outside the vocabulary or a position beyond +-32.7 m.
    """
    unknown = set(graph.labels) - set(vocabulary)
    if unknown:
        raise DataError(f"label {min(unknown)!r} is not in the vocabulary of {len(vocabulary)} labels")
    if len(graph) and np.abs(graph.centroid_m).max() > 32.767:
        raise DataError(f"an object lies {np.abs(graph.centroid_m).max():.1f} m away, expected at most 32.767 m")
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
        raise DataError(f"a packed graph of {count} nodes has {2 + 18 * count + (pairs + 7) // 8} bytes, received {len(data)}")
    nodes = np.frombuffer(data, _NODE, count, 2)
    bits = np.unpackbits(np.frombuffer(data, np.uint8, offset=2 + 18 * count), count=pairs).astype(bool)
    edges = np.column_stack(np.triu_indices(count, 1))[bits]
    names = tuple(labels[i] for i in nodes["label"])
    return SaliencyGraph(
        names, nodes["score"] / 255, nodes["saliency"] / 65535, nodes["position_mm"] / 1000, nodes["size_mm"] / 1000,
        nodes["yaw"] * np.pi / 256, edges,
    )  # fmt: skip


def graph_to_arrays(graph: SaliencyGraph) -> dict[str, np.ndarray]:
    """The graph as named arrays, exact."""
    labels = np.array(graph.labels, dtype=np.str_)
    return {"labels": labels, "scores": graph.scores, "saliency": graph.saliency, "centroid_m": graph.centroid_m, "size_m": graph.size_m,
            "yaw_rad": graph.yaw_rad, "edges": graph.edges}  # fmt: skip


def graph_from_arrays(arrays: Mapping[str, np.ndarray]) -> SaliencyGraph:
    """The graph that `graph_to_arrays` made."""
    fields = {name: arrays[name] for name in ("scores", "saliency", "centroid_m", "size_m", "yaw_rad", "edges")}
    return SaliencyGraph(tuple(arrays["labels"].tolist()), **fields)


def write_graphs(path: Path, graphs: Sequence[SaliencyGraph]) -> None:
    """Graphs as one Parquet table, a row a node; `neighbours` lists the later nodes of the same scene it is in context with."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows: dict[str, list] = {name: [] for name in ("scene", "node", "label", "score", "saliency", "x_m", "y_m", "z_m", "length_m", "width_m",
                                                   "height_m", "yaw_rad", "azimuth_rad", "range_m", "neighbours")}  # fmt: skip
    for scene, graph in enumerate(graphs):
        for node in range(len(graph)):
            neighbours = graph.edges[graph.edges[:, 0] == node, 1].tolist()
            values = (scene, node, graph.labels[node], graph.scores[node], graph.saliency[node], *graph.centroid_m[node], *graph.size_m[node],
                      graph.yaw_rad[node], graph.azimuth_rad[node], graph.range_m[node], neighbours)  # fmt: skip
            for column, value in zip(rows.values(), values, strict=True):
                column.append(value)
    types = {"scene": pa.int32(), "node": pa.int32(), "label": pa.string(), "neighbours": pa.list_(pa.int32())}
    schema = pa.schema([(name, types.get(name, pa.float64())) for name in rows])
    with atomic_path(path) as temporary:
        pq.write_table(pa.table(rows, schema), temporary)


def read_graphs(path: Path, count: int) -> list[SaliencyGraph]:
    """The `count` graphs that `write_graphs` wrote. Raises DataError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
        column = {name: table[name].to_numpy() for name in table.column_names if name not in ("label", "neighbours")}
        label, neighbours = table["label"].to_pylist(), table["neighbours"].to_pylist()
        centroid = np.column_stack([column["x_m"], column["y_m"], column["z_m"]])
        size = np.column_stack([column["length_m"], column["width_m"], column["height_m"]])
    except (OSError, pa.ArrowException, KeyError) as error:
        raise DataError(f"{path} is not a table of graphs: {' '.join(str(error).split())}") from None
    graphs = []
    for scene in range(count):
        rows = np.flatnonzero(column["scene"] == scene)
        edges = [(int(column["node"][r]), b) for r in rows for b in neighbours[r]]
        graphs.append(SaliencyGraph(
            tuple(label[r] for r in rows), column["score"][rows], column["saliency"][rows], centroid[rows], size[rows], column["yaw_rad"][rows],
            np.array(edges, np.int64).reshape(-1, 2),
        ))  # fmt: skip
    return graphs
