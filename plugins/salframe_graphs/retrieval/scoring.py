"""What each scene of a map shares with a query, in whole numbers, and the scenes that share most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe_graphs.retrieval.postings import CODE_LOW, CODE_STEP, Postings

FULL = 255**3
"""What two objects of one height and one size share."""


@dataclass(frozen=True, eq=False)
class Asked:
    """A query's n objects whose labels the map has: label (n,) int64, ascending; appearance (n, 3) as of graphs, NaN
    where not known, and scale (3,), the difference that halves likeness; rarity: of all objects of the query
    together."""

    label: np.ndarray
    appearance: np.ndarray
    scale: np.ndarray
    rarity: int

    @property
    def alike(self) -> np.ndarray:
        """(n, 3, 256) int64: how alike each object is to each code, from 1 to 255: that where they do not differ, or
        nothing is known."""
        stands_for = CODE_LOW[:, None] + CODE_STEP * np.arange(256)
        apart = (self.appearance[..., None] - stands_for) / self.scale[:, None]
        return np.where(np.isnan(apart), 255, np.maximum(np.round(255 / (1 + apart**2)), 1)).astype(np.int64)


def best_scenes(postings: Postings, asked: Asked, count: int) -> tuple[np.ndarray, np.ndarray]:
    """At least the first `count` scenes (K,) int64 of those that share anything, and their Jaccard indices (K,)
    float64.

    Each object shares as much as the most alike of the other side is alike; of both sides the lesser counts: four
    chairs in a scene do not share four with one that is asked, nor one with four.
    """
    shared, likeness_of = np.zeros(len(postings.weight), np.int64), asked.alike
    for label in np.unique(asked.label).tolist():
        alike = likeness_of[asked.label == label]
        listed = slice(*postings.start[label : label + 2])
        scene, code = postings.scene[listed], postings.code[listed]
        likeness = alike[:, 0, code[:, 0]] * alike[:, 1, code[:, 1]] * alike[:, 2, code[:, 2]]
        first_of = np.flatnonzero(np.append(True, scene[1:] != scene[:-1]))
        worth = np.maximum.reduceat(likeness, first_of, axis=1).sum(0)
        if len(alike) > 1:  # of one object that is the lesser
            worth = np.minimum(worth, np.add.reduceat(likeness.max(0), first_of))
        shared[scene[first_of]] += postings.rarity[label] * worth
    scene = np.flatnonzero(shared)
    score = shared[scene] / (FULL * (asked.rarity + postings.weight[scene].astype(np.int64)) - shared[scene])
    if len(scene) > count:
        kept = score >= np.partition(score, len(score) - count)[len(score) - count]
        scene, score = scene[kept], score[kept]
    return scene, score
