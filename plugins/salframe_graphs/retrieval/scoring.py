"""What each scene of a map shares with a query, in whole numbers, and the scenes that share most."""

from __future__ import annotations

import numpy as np

FULL = 255**3
"""What two objects of one height and one size share."""


def add_shared(shared: np.ndarray, scene: np.ndarray, code: np.ndarray, rarity: int, alike: np.ndarray) -> None:
    """Add to shared (S,) int64 what each scene of a label's list, scene (P,) and code (P, 3), shares with the n objects
    of a query that bear the label; alike (n, 3, 256) int64, from 1 to 255 how alike each is to each code.

    Each object shares as much as the most alike of the other side is alike; of both sides the lesser counts: four
    chairs in a scene do not share four with one that is asked, nor one with four.
    """
    likeness = alike[:, 0, code[:, 0]] * alike[:, 1, code[:, 1]] * alike[:, 2, code[:, 2]]
    first_of = np.flatnonzero(np.diff(scene, prepend=np.int64(-1)))
    asked = np.maximum.reduceat(likeness, first_of, axis=1).sum(0)
    there = np.add.reduceat(likeness.max(0), first_of)
    shared[scene[first_of]] += rarity * np.minimum(asked, there)


def first(shared: np.ndarray, weight: np.ndarray, asked: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """At least the first `count` scenes (K,) int64 of those that share anything, and their Jaccard indices (K,)
    float64; weight (S,) uint32 of the scenes' objects, asked: of the query's, in parts of rarity."""
    scene = np.flatnonzero(shared)
    score = shared[scene] / (FULL * (asked + weight[scene].astype(np.int64)) - shared[scene])
    if len(scene) > count:
        kept = score >= np.partition(score, len(score) - count)[len(score) - count]
        scene, score = scene[kept], score[kept]
    return scene, score
