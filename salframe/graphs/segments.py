"""Sums, maxima and indices for arrays that contain the elements of several groups one after the other, without
padding."""

from __future__ import annotations

import numpy as np


class Segments:
    """N groups of consecutive elements along the last axis of an array, T elements in total.

    Attributes:
        count: (N,) int64, number of elements of each group.
        start: (N + 1,) int64, index of the first element of each group, then T.
    """

    def __init__(self, count: np.ndarray) -> None:
        self.count, self.start = count, starts(count)
        self._filled = None if count.all() else np.flatnonzero(count)
        self._first = self.start[:-1] if self._filled is None else self.start[self._filled]

    def __len__(self) -> int:
        return len(self.count)

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Return the sum of `values` (..., T) over each group, (..., N); 0 for an empty group."""
        return self._reduce(np.add, values)

    def max(self, values: np.ndarray) -> np.ndarray:
        """Return the maximum of `values` (..., T) over each group, (..., N); 0 for an empty group."""
        return self._reduce(np.maximum, values)

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Return one value for each element, (..., T): the value of its group in `values` (..., N)."""
        return values.repeat(self.count, axis=-1)

    def _reduce(self, function: np.ufunc, values: np.ndarray) -> np.ndarray:
        reduced = function.reduceat(values, self._first, axis=-1) if len(self._first) else values[..., :0]
        if self._filled is None:
            return reduced  # type: ignore[no-any-return]
        result = np.zeros((*values.shape[:-1], len(self)), values.dtype)
        result[..., self._filled] = reduced
        return result


def starts(count: np.ndarray) -> np.ndarray:
    """Return the index of the first element of each of N groups of these sizes, then the number of all elements,
    (N + 1,) int64."""
    start = np.zeros(len(count) + 1, np.int64)
    np.cumsum(count, out=start[1:])
    return start


def ranges(first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the concatenated ranges first[i], first[i] + 1, ..., first[i] + count[i] - 1 of all groups i,
    (sum(count),) int64."""
    start = starts(count)
    return (first - start[:-1]).repeat(count) + np.arange(start[-1])


def run_starts(*keys: np.ndarray) -> np.ndarray:
    """Return the indices at which at least one of the arrays (N,) differs from its previous element, including index
    0."""
    is_start = np.zeros(len(keys[0]), bool)
    is_start[:1] = True
    for key in keys:
        is_start[1:] |= key[1:] != key[:-1]
    return np.flatnonzero(is_start)


def pairs_within(start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of elements in the same group: two arrays (P,) int64 with their indices a < b, sorted by group.

    Args:
        start: (N + 1,) index of the first element of each group, then the number of elements, as in `Segments`.
    """
    position = np.arange(start[-1])
    later = start[1:].repeat(np.diff(start)) - position - 1
    return position.repeat(later), ranges(position + 1, later)


def top_per_group(value: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Return the indices of the `count` largest finite values of each group, sorted by group, then by decreasing value.

    Equal values keep their order.

    Args:
        value: (N,) float.
        group: (N,) int, group of each value.
        count: Maximum number of values per group.
    """
    order = np.flatnonzero(np.isfinite(value))
    order = order[np.lexsort((-value[order], group[order]))]
    ranked = group[order]
    begin = run_starts(ranked)
    if count == 1:
        return order[begin]
    rank = np.arange(len(order)) - begin.repeat(np.diff(np.append(begin, len(order))))
    return order[rank < count]
