"""One-to-one pairs of the nodes of two graphs (docs/explanation/method.md#node-similarity)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from salframe_graphs.node_pairs import NodePairs


def align(pairs: NodePairs, first_node: np.ndarray, similarity: np.ndarray, kernel: np.ndarray) -> list[np.ndarray]:
    """Return one-to-one node pairs of a query and each graph, K arrays (M, 2) int64.

    The pairs of greatest total kernel, what one pose explains, where there are two; else those of greatest total
    similarity. Pairs of value 0 are left out.

    Args:
        pairs: the node pairs to choose from.
        first_node: (K,) the position of each graph's first node, which node numbers are counted from.
        similarity, kernel: (P,) not negative.
    """
    aligned = []
    for graph, (low, high) in enumerate(pairwise(pairs.segments.start.tolist())):
        nodes = np.column_stack([pairs.query[low:high], pairs.node[low:high] - first_node[graph]])
        chosen = _assign(nodes, kernel[low:high])
        aligned.append(chosen if len(chosen) >= 2 else _assign(nodes, similarity[low:high]))
    return aligned


def _assign(nodes: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Those of the pairs (P, 2) that use each node at most once and have the greatest total value (P,)."""
    nodes, value = nodes[value > 0], value[value > 0]
    if all(len(set(side)) == len(side) for side in nodes.T.tolist()):
        return nodes
    from scipy.optimize import linear_sum_assignment

    matrix = np.zeros(nodes.max(0) + 1)
    matrix[tuple(nodes.T)] = value
    rows, columns = linear_sum_assignment(matrix, maximize=True)
    accepted = matrix[rows, columns] > 0
    return np.column_stack([rows[accepted], columns[accepted]])
