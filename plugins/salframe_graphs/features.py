"""Structural features of nodes, comparable between graphs (method.md 3, step 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.table import GraphBatch, ranges, starts


@dataclass(frozen=True, eq=False)
class Histograms:
    """Labels around N nodes: how many other nodes bear a label in a distance ring, then 1..hops edges away; `width`
    columns, a block of all labels for each.

    Of the counts over 0, node by node: start (N + 1,) int64, where each node's begin; column, count (E,); norm (N,)
    float64, the length of each node's row.
    """

    start: np.ndarray
    column: np.ndarray
    count: np.ndarray
    norm: np.ndarray
    width: int

    @classmethod
    def joined(cls, parts: Sequence[Histograms]) -> Histograms:
        """Those of several, at least one, one after the other."""
        column, count, norm = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("column", "count", "norm")
        )
        each = np.concatenate([np.diff(part.start) for part in parts])
        return cls(starts(each), column, count, norm, parts[0].width)

    def take(self, nodes: np.ndarray) -> Histograms:
        """Those of some nodes, in this order."""
        each = self.start[nodes + 1] - self.start[nodes]
        entry = ranges(self.start[nodes], each)
        return Histograms(starts(each), self.column[entry], self.count[entry], self.norm[nodes], self.width)

    def unit(self, columns: np.ndarray) -> np.ndarray:
        """(N, C) float64: some columns of the rows at length 1."""
        place = np.full(self.width, -1)
        place[columns] = np.arange(len(columns))
        place, row = place[self.column], np.repeat(np.arange(len(self.norm)), np.diff(self.start))
        used = place >= 0
        found = np.zeros((len(self.norm), len(columns)))
        found[row[used], place[used]] = self.count[used]
        return found / np.maximum(self.norm, 1e-12)[:, None]


def ring_hop_histograms(
    batch: GraphBatch, adjacency: np.ndarray, labels: int, ring_edges_m: Sequence[float], hops: int
) -> Histograms:
    """The histograms of the nodes of a batch, one graph after the other, of (len(ring_edges_m) + hops) * labels
    columns; nodes of label -1 are not counted.

    adjacency (K, m, m) bool. Ring r holds the nodes nearer than ring_edges_m[r] and not nearer than the edge before.
    """
    is_node, width = batch.is_node, (len(ring_edges_m) + hops) * labels
    distance = np.sqrt(((batch.centroid_m[:, :, None, :2] - batch.centroid_m[:, None, :, :2]) ** 2).sum(3))
    own = np.broadcast_to(np.eye(is_node.shape[1], dtype=bool), distance.shape)
    rings = pairwise((0.0, *ring_edges_m))
    blocks = [(distance >= low) & (distance < high) & ~own for low, high in rings]
    step, reached, frontier = adjacency.astype(np.float32), own, own
    for _ in range(hops):
        frontier = (frontier.astype(np.float32) @ step > 0) & ~reached
        reached = reached | frontier
        blocks.append(frontier)
    counted = is_node[:, :, None] & (batch.label >= 0)[:, None]
    number = is_node.cumsum().reshape(is_node.shape) - 1
    cells = []
    for first, block in zip(range(0, width, max(labels, 1)), blocks, strict=False):
        graph, node, other = np.nonzero(block & counted)
        cells.append(number[graph, node] * width + first + batch.label[graph, other])
    cell, count = np.unique(np.concatenate([np.zeros(0, np.int64), *cells]), return_counts=True)
    row, column = np.divmod(cell, max(width, 1))
    nodes = int(is_node.sum())
    norm = np.sqrt(np.bincount(row, count.astype(np.float64) ** 2, nodes))
    each = np.bincount(row, minlength=nodes)
    return Histograms(starts(each), column.astype(np.int32), count.astype(np.int32), norm, width)


def node2vec(
    graphs: Sequence[SaliencyGraph], seed: int, size: int = 32, walks: int = 10, length: int = 8
) -> list[np.ndarray]:
    """node2vec (Grover and Leskovec 2016, p = q = 1) trained jointly on several graphs, (N, size) float64 unit rows for
    each.

    Every second token of a walk is the label of the node before it: labels are shared between graphs and tie their
    embeddings together; embeddings of separately trained graphs are not comparable (method.md 3).
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
