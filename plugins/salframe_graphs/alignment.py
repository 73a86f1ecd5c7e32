"""One-to-one alignment of the nodes of two graphs (docs/explanation/single-panoramas.md#node-similarity)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from salframe_graphs.node_pairs import NodePairs


def align(pairs: NodePairs, first_node: np.ndarray, similarity: np.ndarray, kernel: np.ndarray) -> list[np.ndarray]:
    """Return one-to-one node pairs of a query and each of K graphs.

    The pairs maximise the sum of their kernels. If that gives fewer than two pairs, they maximise the sum of their
    similarities. Pairs with a kernel (or similarity) of 0 are left out.

    Args:
        pairs: The P node pairs to choose from.
        first_node: (K,) index of each graph's first node among the nodes of all graphs.
        similarity: (P,) similarity of each pair, at least 0.
        kernel: (P,) measure of how well the best query pose for the graph explains each pair, at least 0.

    Returns:
        K arrays (M, 2) int64: the index of the query node, and the index of the node in its graph.
    """
    aligned = []
    for graph, (low, high) in enumerate(pairwise(pairs.segments.start.tolist())):
        nodes = np.column_stack([pairs.query[low:high], pairs.node[low:high] - first_node[graph]])
        assignment = _assign(nodes, kernel[low:high])
        aligned.append(assignment if len(assignment) >= 2 else _assign(nodes, similarity[low:high]))
    return aligned


def _assign(nodes: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the pairs, a subset of (P, 2), that use each node at most once and maximise the sum of their values."""
    nodes, value = nodes[value > 0], value[value > 0]
    if all(len(set(side)) == len(side) for side in nodes.T.tolist()):
        return nodes
    from scipy.optimize import linear_sum_assignment

    matrix = np.zeros(nodes.max(0) + 1)
    matrix[tuple(nodes.T)] = value
    rows, columns = linear_sum_assignment(matrix, maximize=True)
    accepted = matrix[rows, columns] > 0
    return np.column_stack([rows[accepted], columns[accepted]])
