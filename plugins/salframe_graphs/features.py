"""Structural features of nodes, comparable between graphs (method.md 3, step 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from salframe.graphs.graph import SaliencyGraph


def label_one_hot(graph: SaliencyGraph, vocabulary: Mapping[str, int]) -> np.ndarray:
    """(N, L) float64; a label outside the vocabulary is a row of zeros."""
    hot = np.zeros((len(graph), len(vocabulary)))
    for node, label in enumerate(graph.labels):
        if label in vocabulary:
            hot[node, vocabulary[label]] = 1
    return hot


def ring_hop_histograms(
    graph: SaliencyGraph, vocabulary: Mapping[str, int], ring_edges_m: Sequence[float], hops: int
) -> np.ndarray:
    """(N, (len(ring_edges_m) + hops) * L) float64: labels of the other nodes by distance ring, then by 1..hops edges
    away; unit rows.

    Ring r holds the nodes nearer than ring_edges_m[r] and not nearer than the edge before.
    """
    hot = label_one_hot(graph, vocabulary)
    distance = np.linalg.norm(graph.centroid_m[:, None, :2] - graph.centroid_m[None, :, :2], axis=2)
    np.fill_diagonal(distance, np.inf)
    inner = np.array([0.0, *ring_edges_m[:-1]])
    blocks = [((distance >= low) & (distance < high)) @ hot for low, high in zip(inner, ring_edges_m, strict=True)]
    reached, frontier = np.eye(len(graph), dtype=bool), np.eye(len(graph), dtype=bool)
    for _ in range(hops):
        frontier = (frontier.astype(float) @ graph.adjacency > 0) & ~reached
        reached |= frontier
        blocks.append(frontier @ hot)
    features = np.concatenate(blocks, axis=1)
    return features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-12)


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
