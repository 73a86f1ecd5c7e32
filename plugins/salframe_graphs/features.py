"""Structural features of nodes that are comparable between graphs
(docs/explanation/single-panoramas.md#node-similarity)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.segments import Segments, ranges
from salframe.graphs.table import GraphNodes


def ring_hop_histograms(
    nodes: GraphNodes, adjacency: np.ndarray, labels: np.ndarray, ring_edges_m: Sequence[float], hops: int
) -> np.ndarray:
    """Count the labels around each node: in distance rings, then at 1 to `hops` edges.

    Ring r contains the other nodes at distances from ring_edges_m[r - 1] (0 for the first ring) up to, but not
    including, ring_edges_m[r]. Nodes of label -1 are not counted.

    Args:
        nodes: K graphs, N nodes together.
        adjacency: (K, m, m) bool, padded to the largest graph.
        labels: (L,) ids of the labels whose counts are returned.
        ring_edges_m: Outer radii of the rings in metres, ascending.
        hops: Maximum number of edges.

    Returns:
        (N, (len(ring_edges_m) + hops) * L) float64 counts of the requested labels. Each row is divided by the L2 norm
        of the counts of all labels, not only of the requested ones. The row of a node without neighbours is 0.
    """
    is_node = np.arange(adjacency.shape[1]) < nodes.count[:, None]
    x, y, label = np.zeros(is_node.shape), np.zeros(is_node.shape), np.full(is_node.shape, -1)
    x[is_node], y[is_node], label[is_node] = nodes.centroid_m[:, 0], nodes.centroid_m[:, 1], nodes.label
    dx_m, dy_m = x[:, :, None] - x[:, None], y[:, :, None] - y[:, None]
    distance_m = np.sqrt(dx_m * dx_m + dy_m * dy_m)
    identity = np.eye(is_node.shape[1], dtype=bool)
    neighbourhoods = np.empty((len(ring_edges_m) + hops, *distance_m.shape), np.float32)
    for block, (low, high) in zip(neighbourhoods, pairwise((0.0, *ring_edges_m)), strict=False):
        block[:] = (distance_m >= low) & (distance_m < high) & ~identity
    step, reached, frontier = adjacency.astype(np.float32), identity, identity
    for block in neighbourhoods[len(ring_edges_m) :]:
        frontier = (frontier.astype(np.float32) @ step > 0) & ~reached
        reached = reached | frontier
        block[:] = frontier
    has_label = (label[:, :, None] == labels).astype(np.float32)
    width = len(neighbourhoods) * len(labels)
    counts = (neighbourhoods @ has_label).transpose(1, 2, 0, 3).reshape(*is_node.shape, width)[is_node]
    same_label = ((label[:, :, None] == label[:, None]) & (label >= 0)[:, None]).astype(np.float32)
    squares = np.einsum("bkij,bkij->ki", neighbourhoods @ same_label, neighbourhoods)[
        is_node
    ]  # sum of squared counts of all labels
    return counts / np.sqrt(np.maximum(squares, 1).astype(np.float64))[:, None]  # type: ignore[no-any-return]


def feature_products(query: np.ndarray, features: Any, i: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the P dot products of row i[p] of `query` (n, F) and row row[p] of the csr_array `features` (N, F)."""
    length = np.diff(features.indptr)[row]
    entry = ranges(features.indptr[row], length)
    products = features.data[entry] * query[i.repeat(length), features.indices[entry]]
    return Segments(length).sum(products)


def node2vec(
    graphs: Sequence[SaliencyGraph], seed: int, size: int = 32, walks: int = 10, length: int = 8
) -> list[np.ndarray]:
    """Train node2vec (Grover and Leskovec 2016, p = q = 1) jointly on several graphs.

    Every second token of a walk is the label of the preceding node. Labels occur in all graphs, which makes the
    embeddings of different graphs comparable. Embeddings of graphs trained separately are not comparable.

    Args:
        graphs: The graphs to embed.
        seed: Seed of the walks and of the training.
        size: Number of dimensions of an embedding.
        walks: Number of walks from each node.
        length: Number of nodes of a walk.

    Returns:
        For each graph (N, size) float64 with rows of unit length.
    """
    from gensim.models import Word2Vec

    rng = np.random.default_rng(seed)
    sentences = []
    for index, graph in enumerate(graphs):
        for node in np.repeat(np.arange(len(graph)), walks):
            sentence: list[str] = []
            for _ in range(length):
                sentence += [f"{index}:{node}", graph.labels[node]]
                neighbours = np.flatnonzero(graph.adjacency[node])
                if not len(neighbours):
                    break
                node = rng.choice(neighbours)
            sentences.append(sentence)
    model = Word2Vec(
        sentences, vector_size=size, window=4, min_count=1, sg=1, workers=1, seed=seed, epochs=50, alpha=0.1
    )
    vectors = [
        np.array([model.wv[f"{i}:{n}"] for n in range(len(graph))], float).reshape(-1, size)
        for i, graph in enumerate(graphs)
    ]
    return [v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12) for v in vectors]
