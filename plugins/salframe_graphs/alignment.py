"""One-to-one pairs of the nodes of two graphs (method.md 3)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from salframe.graphs.table import starts


def align(similarity: np.ndarray, kernel: np.ndarray) -> list[np.ndarray]:
    """K times (M, 2) node pairs of a query and a graph, each node in one at most: those of greatest total kernel
    (K, n, m), what one pose explains, where there are two, else those of greatest total similarity (K, n, m). Neither
    is negative; pairs that have none are left out."""
    explained = kernel > 0
    rows, columns = explained.sum(2), explained.sum(1)
    clear = (rows.max(1, initial=0) <= 1) & (columns.max(1, initial=0) <= 1) & (rows.sum(1) >= 2)
    nodes = np.column_stack(np.nonzero(explained)[1:])
    pairs = [nodes[first:end] for first, end in pairwise(starts(rows.sum(1)).tolist())]
    for k in np.flatnonzero(~clear):  # of the others no two pairs share a node
        pairs[k] = _assign(similarity[k], kernel[k])
    return pairs


def _assign(similarity: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """(M, 2) of one graph, as of `align`."""
    from scipy.optimize import linear_sum_assignment

    for value in (kernel, similarity):
        rows, columns = linear_sum_assignment(value, maximize=True)
        accepted = value[rows, columns] > 0
        if np.count_nonzero(accepted) >= 2:
            break
    return np.array([rows[accepted], columns[accepted]]).T
