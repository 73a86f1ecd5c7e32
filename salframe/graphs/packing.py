"""Graphs as named arrays: exact arrays, and packed arrays of a few hundred bytes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from salframe.framework.errors import DataError
from salframe.graphs.graph import REACH_M, SaliencyGraph

NODE = np.dtype([("score", "u1"), ("yaw", "u1"), ("saliency", "<u2"), ("position_mm", "<i2", 3), ("size_mm", "<u2", 3)])
"""Data type of a packed node, see `pack_graph`."""

GRAPH_ARRAYS = frozenset({"labels", "scores", "saliency", "centroid_m", "size_m", "yaw_rad", "edges"})
"""Names of the arrays that `graph_to_arrays` returns for every graph."""

BEARING_ARRAYS = ("bearing", "solid_angle_sr", "origin_m")
"""Names of the arrays that a graph has in addition if it has nodes without range."""

VARIANCE, DEVIATION = "variance_m2", "deviation_mm"
"""Names of the array that a graph has in addition if it has triangulated nodes: in exact form, and packed."""
TEXTS = "texts"
"""Name of the array with the text of each node, in graphs with at least one text."""


def graph_to_arrays(graph: SaliencyGraph) -> dict[str, np.ndarray]:
    """Return the fields of a graph as named arrays, without loss, for `graph_from_arrays`."""
    labels = np.array(graph.labels, dtype=np.str_)
    has_range = np.isfinite(graph.centroid_m).all()
    # With range, bearings are computed from the centroids.
    bearing = {} if has_range else {name: getattr(graph, name) for name in BEARING_ARRAYS}
    variance = {VARIANCE: graph.variance_m2} if graph.variance_m2.any() else {}
    out_of_reach = {"out_of_reach": np.array(graph.out_of_reach)} if graph.out_of_reach else {}
    texts = {TEXTS: np.array(graph.texts, np.str_)} if any(graph.texts) else {}
    return {
        "labels": labels,
        "scores": graph.scores,
        "saliency": graph.saliency,
        "centroid_m": graph.centroid_m,
        "size_m": graph.size_m,
        "yaw_rad": graph.yaw_rad,
        "edges": graph.edges,
        **bearing,
        **variance,
        **out_of_reach,
        **texts,
    }


def graph_from_arrays(arrays: Mapping[str, np.ndarray]) -> SaliencyGraph:
    """Return the graph of arrays from `graph_to_arrays`."""
    fields = {name: arrays[name] for name in ("scores", "saliency", "centroid_m", "size_m", "yaw_rad", "edges")}
    fields |= {name: arrays[name] for name in (*BEARING_ARRAYS, VARIANCE) if name in arrays}
    out_of_reach = int(arrays.get("out_of_reach", 0))
    texts = tuple(arrays[TEXTS].tolist()) if TEXTS in arrays else ()
    return SaliencyGraph(tuple(arrays["labels"].tolist()), **fields, out_of_reach=out_of_reach, texts=texts)


def pack_graph(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Pack arrays of `graph_to_arrays` into 16 bytes per node, one bit per pair of nodes, the labels, and the texts.

    Returns:
        Packed arrays by name:

        - `labels`: (N,) str.
        - `nodes`: (N,) NODE. The units are 1/255 for the score, pi/256 for the yaw, 1/65535 for the saliency, and mm
          for position and size. A size is from 1 to 65535 mm.
        - `edges`: uint8, one bit for each pair of nodes, row by row above the diagonal of the adjacency matrix.
        - `deviation_mm`: (N,) uint16, standard deviation of the position along each horizontal axis. Only if a node was
          triangulated.
        - `texts`: (N,) str. Only if a node has a text.

    Raises:
        DataError: A position is unknown or beyond +-32.7 m.
    """
    centroid_m, count = arrays["centroid_m"], len(arrays["labels"])
    if not (np.abs(centroid_m) <= REACH_M).all():
        raise DataError(
            f"an object is {np.abs(centroid_m).max():.1f} m from the camera along one axis, expected at most {REACH_M} "
            "m: check the unit of the range images"
        )
    nodes = np.zeros(count, NODE)
    nodes["score"] = np.round(arrays["scores"] * 255)
    nodes["yaw"] = np.round(arrays["yaw_rad"] % np.pi * 256 / np.pi).astype(int) % 256
    nodes["saliency"] = np.round(arrays["saliency"] * 65535)
    nodes["position_mm"] = np.round(centroid_m * 1000)
    nodes["size_mm"] = np.clip(np.round(arrays["size_m"] * 1000), 1, 65535)
    edges = edge_bits(arrays["edges"], count)
    packed = {"labels": arrays["labels"], "nodes": nodes, "edges": edges, **texts_of(arrays)}
    if VARIANCE in arrays:
        deviation_mm = np.round(np.sqrt(arrays[VARIANCE]) * 1000)
        packed[DEVIATION] = np.minimum(deviation_mm, 65535).astype(np.uint16)
    return packed


def unpack_graph(packed: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of `graph_to_arrays`, rounded as in `pack_graph`."""
    pairs = _pairs(len(packed["nodes"]))
    edges = pairs[np.unpackbits(packed["edges"], count=len(pairs)).view(bool)]
    variance = {VARIANCE: (packed[DEVIATION] / 1000) ** 2} if DEVIATION in packed else {}
    nodes = unpack_nodes(packed["nodes"])
    return {"labels": packed["labels"], **nodes, "edges": edges, **variance, **texts_of(packed)}


def texts_of(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the texts from the arrays of a graph or of a packed graph, as {"texts": array}; {} if no node has a
    text."""
    return {TEXTS: arrays[TEXTS]} if TEXTS in arrays else {}


def unpack_nodes(nodes: np.ndarray) -> dict[str, np.ndarray]:
    """Unpack nodes (N,), and return the same arrays for nodes as `graph_to_arrays`."""
    return {
        "scores": nodes["score"] / 255,
        "saliency": nodes["saliency"] / 65535,
        "centroid_m": nodes["position_mm"] / 1000,
        "size_m": nodes["size_mm"] / 1000,
        "yaw_rad": nodes["yaw"] * (np.pi / 256),
    }


def edge_bits(edges: np.ndarray, count: int) -> np.ndarray:
    """Return the edges (E, 2) of a graph of `count` nodes as packed bits, uint8: one bit for each pair of nodes, row by
    row above the diagonal of the adjacency matrix."""
    linked = np.zeros((count, count), bool)
    linked[tuple(edges.T)] = True
    return np.packbits(linked[tuple(_pairs(count).T)])


@lru_cache(maxsize=256)
def _pairs(count: int) -> np.ndarray:
    """Return all pairs a < b of `count` nodes, (P, 2)."""
    return np.column_stack(np.triu_indices(count, 1))
