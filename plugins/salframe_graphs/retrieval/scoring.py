"""What each scene of a map shares with a query, in whole numbers: compiled or not, the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FULL = 255**3
"""What two objects of one height and one size share."""


@dataclass(frozen=True, eq=False)
class Asked:
    """The n objects of a query that bear one label of the map: the list's start and end; rarity; alike (n, 3, 256)
    int64, from 1 to 255 how alike each object is to each code of height, length and box height."""

    start: int
    end: int
    rarity: int
    alike: np.ndarray


def add_shared(shared: np.ndarray, scene: np.ndarray, code: np.ndarray, rarity: int, alike: np.ndarray) -> None:
    """Add to shared (S,) int64 what each scene of a list, scene (P,) and code (P, 3), shares with the objects asked.

    Each object shares as much as the most alike of the other side is alike; of both sides the lesser counts: four
    chairs in a scene do not share four with one that is asked, nor one with four.
    """
    likeness = alike[:, 0, code[:, 0]] * alike[:, 1, code[:, 1]] * alike[:, 2, code[:, 2]]
    first = np.flatnonzero(np.diff(scene, prepend=np.int64(-1)))
    asked = np.maximum.reduceat(likeness, first, axis=1).sum(0)
    there = np.add.reduceat(likeness.max(0), first)
    shared[scene[first]] += rarity * np.minimum(asked, there)
