"""A query laid out for a look-up in inverted lists."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe_graphs.retrieval.postings import CODE_LOW, CODE_STEP, Postings, appearance

FULL = 255**3
"""Product of the three likenesses of two objects that differ in nothing."""


@dataclass(frozen=True, eq=False)
class IndexQuery:
    """The n objects of a query whose labels the map has, ordered by label, of J labels.

    Attributes:
        node: (n,) int64 numbers of the objects in the query's graph.
        object_label: (n,) int64 numbers of their labels.
        label: (J,) int64 the distinct ones, shortest list first.
        first, last: (J,) int64, the objects first to last - 1 have the label.
        likeness: (n, 3, 256) int32, likeness in height, length and box height of each object to each code, 1 to 255;
            255 where the query's value is unknown.
        rarity: rarity of all objects of the query together, in parts of RARITY_UNIT.
    """

    node: np.ndarray
    object_label: np.ndarray
    label: np.ndarray
    first: np.ndarray
    last: np.ndarray
    likeness: np.ndarray
    rarity: int

    @classmethod
    def of(cls, graph: SaliencyGraph, postings: Postings, half_at: np.ndarray) -> IndexQuery:
        """Lay out a graph; half_at (3,): the differences in height (m), log length and log box height that halve
        likeness."""
        number = np.array([postings.labels.get(name, -1) for name in graph.labels], np.int64)
        node = np.argsort(number, kind="stable")[np.count_nonzero(number < 0) :]
        label, first, count = np.unique(number[node], return_index=True, return_counts=True)
        shortest = np.argsort(postings.start[label + 1] - postings.start[label], kind="stable")
        label, first, count = label[shortest], first[shortest], count[shortest]
        value = CODE_LOW[:, None] + CODE_STEP * np.arange(256)
        apart = (appearance(graph)[node][..., None] - value) / half_at[:, None]
        likeness = np.where(np.isnan(apart), 255, np.maximum(np.round(255 / (1 + apart**2)), 1)).astype(np.int32)
        return cls(node, number[node], label, first, first + count, likeness, int(postings.rarity[number].sum()))
