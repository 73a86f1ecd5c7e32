"""A query in the layout for inverted lists."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe_graphs.retrieval.postings import CODE_LOW, CODE_STEP, Postings, appearance

FULL = 255**3
"""Product of the three similarities of two identical objects, each of which is 255."""


@dataclass(frozen=True, eq=False)
class IndexQuery:
    """The n objects of a query whose labels occur in the map, ordered by label. They have J distinct labels.

    Attributes:
        node: (n,) int64 indices of the objects in the query's graph.
        object_label: (n,) int64 index of the label of each object.
        label: (J,) int64 indices of the distinct labels. Labels with short inverted lists come first.
        first: (J,) int64, index of the first object with each label.
        last: (J,) int64, index of the last object with each label, plus 1.
        similarity: (n, 3, 256) int32, similarity (1 to 255) of three sizes of each object (height above the camera, box
            length, box height) to the value of each code (see CODE_LOW); 255 where the query's value is unknown.
        rarity: Sum of the rarities of all objects of the query, in units of 1 / RARITY_UNIT.
    """

    node: np.ndarray
    object_label: np.ndarray
    label: np.ndarray
    first: np.ndarray
    last: np.ndarray
    similarity: np.ndarray
    rarity: int

    @classmethod
    def of(cls, graph: SaliencyGraph, postings: Postings, scale: np.ndarray) -> IndexQuery:
        """Return a graph in this layout.

        Args:
            graph: The query's graph.
            postings: The lists of the map.
            scale: (3,) differences in height (m), log length and log box height that halve similarity.
        """
        number = np.array([postings.labels.get(name, -1) for name in graph.labels], np.int64)
        node = np.argsort(number, kind="stable")[np.count_nonzero(number < 0) :]
        label, first, count = np.unique(number[node], return_index=True, return_counts=True)
        shortest = np.argsort(postings.start[label + 1] - postings.start[label], kind="stable")
        label, first, count = label[shortest], first[shortest], count[shortest]
        value = CODE_LOW[:, None] + CODE_STEP * np.arange(256)
        difference = (appearance(graph)[node][..., None] - value) / scale[:, None]
        similarity = np.where(np.isnan(difference), 255, np.maximum(np.round(255 / (1 + difference**2)), 1)).astype(
            np.int32
        )
        return cls(node, number[node], label, first, first + count, similarity, int(postings.rarity[number].sum()))
