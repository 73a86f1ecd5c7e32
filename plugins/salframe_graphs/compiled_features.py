"""Structural features of nodes, compiled by numba: the same as of `features`, graph by graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import edge_bits
from salframe.graphs.table import GraphNodes
from salframe_graphs.features import Histograms

_compile = numba.njit(nogil=True, error_model="numpy")
_compile_and_keep = numba.njit(cache=True, nogil=True, error_model="numpy")


def structures(
    query: SaliencyGraph,
    known: np.ndarray,
    index: Any,
    candidates: np.ndarray,
    there: GraphNodes,
    labels: int,
    ring_edges_m: Sequence[float],
    hops: int,
) -> tuple[Histograms, Histograms, np.ndarray]:
    """As `_structures` of a `TripletMatcher` for its index, of candidates (K,) with these nodes; nothing of nodes whose
    label the query does not bear."""
    around = labels, ring_edges_m, hops
    asked = GraphNodes(np.array([len(query)]), known, query.scores, query.saliency, query.centroid_m, query.size_m)
    own = ring_hop_histograms(asked, edge_bits(query.edges, len(query)), known, *around)
    if index.structure is not None:
        return own, index.structure, index.graphs.nodes(candidates)
    found = ring_hop_histograms(there, index.graphs.take_edges(candidates), known, *around)
    return own, found, np.arange(len(there.label))


def ring_hop_histograms(
    nodes: GraphNodes, edges: np.ndarray, asked: np.ndarray, labels: int, ring_edges_m: Sequence[float], hops: int
) -> Histograms:
    """As of features, of graphs one after the other with the bits of their edges (B,) as in `pack_graph`; a node's
    columns in any order, none of a node whose label is not among `asked` (n,)."""
    counted = np.zeros(labels + 1, np.bool_)
    counted[asked] = True
    counted[-1] = False  # -1, of nodes whose label the map lacks
    start, column, count, norm = _histograms(
        nodes.count, nodes.label, nodes.centroid_m, edges, counted, np.array(ring_edges_m), hops
    )
    return Histograms(start, column, count, norm, (len(ring_edges_m) + hops) * labels)


@_compile_and_keep
def _histograms(count, label, centroid_m, edges, counted, ring_edges_m, hops):  # type: ignore[no-untyped-def]
    """start, column, count and norm of `Histograms`. counted (L + 1,): whether nodes of each label have any."""
    labels, rings, most, first = len(counted) - 1, len(ring_edges_m), 0, 0
    for k in range(len(count)):
        for i in range(first, first + count[k]):
            most += 2 * (count[k] - 1) * counted[label[i]]  # of others one is in a ring, one some edges away
        first += count[k]
    start, norm, held = np.zeros(first + 1, np.int64), np.zeros(first), 0
    column, number = np.empty(most, np.int32), np.empty(most, np.int32)
    of_label, away = np.zeros((rings + hops) * labels, np.int32), np.empty(count.max(), np.int64)
    linked, first, byte = np.zeros((count.max(), count.max()), np.bool_), 0, 0
    for k in range(len(count)):
        own = slice(first, first + count[k])
        byte = _link(edges, byte, count[k], linked)
        for i in range(count[k]):
            row, held_before = first + i, held
            if counted[label[row]]:
                _walk(i, linked, count[k], hops, away)
                held = _count_around(i, label[own], centroid_m[own], away, ring_edges_m, labels, of_label, column, held)
            squared = 0.0
            for e in range(held_before, held):
                number[e] = of_label[column[e]]
                squared += float(number[e]) ** 2
                of_label[column[e]] = 0
            norm[row], start[row + 1] = np.sqrt(squared), held
        first += count[k]
    return start, column[:held], number[:held], norm


@_compile
def _link(edges, byte, count, linked):  # type: ignore[no-untyped-def]
    """Fill in which of so many nodes are in context, of the bits of their edges from a byte on; the byte after them."""
    bit = 0
    for i in range(count):
        for j in range(i + 1, count):
            linked[i, j] = linked[j, i] = (edges[byte + bit // 8] >> (7 - bit % 8)) & 1
            bit += 1
    return byte + (bit + 7) // 8


@_compile
def _count_around(node, label, centroid_m, away, ring_edges_m, labels, of_label, column, held):  # type: ignore[no-untyped-def]
    """Count the labels around a node of a graph, and fill in which columns these are; how many are held then."""
    rings = len(ring_edges_m)
    for j in range(len(label)):
        if j == node or label[j] < 0:
            continue
        x, y = centroid_m[node, 0] - centroid_m[j, 0], centroid_m[node, 1] - centroid_m[j, 1]
        ring = np.searchsorted(ring_edges_m, np.sqrt(x * x + y * y), side="right")
        for block in (ring if ring < rings else -1, rings + away[j] - 1 if away[j] > 0 else -1):
            if block >= 0:
                of_label[block * labels + label[j]] += 1
                if of_label[block * labels + label[j]] == 1:
                    column[held] = block * labels + label[j]
                    held += 1
    return held


@_compile
def _walk(node, linked, count, hops, away):  # type: ignore[no-untyped-def]
    """Fill in how many edges each of `count` nodes is from one, -1 where more than `hops`."""
    away[:count] = -1
    away[node] = 0
    for hop in range(hops):
        for j in range(count):
            for other in range(count if away[j] == hop else 0):
                if away[other] < 0 and linked[j, other]:
                    away[other] = hop + 1
