"""`scoring.add_shared` compiled by numba."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def add_shared(shared, scene, code, rarity, alike):  # type: ignore[no-untyped-def]
    """As in scoring."""
    asked = np.zeros(len(alike), np.int64)
    place = 0
    while place < len(scene):
        here, there = scene[place], 0
        asked[:] = 0
        while place < len(scene) and scene[place] == here:
            most = 0
            for i in range(len(alike)):
                likeness = alike[i, 0, code[place, 0]] * alike[i, 1, code[place, 1]] * alike[i, 2, code[place, 2]]
                most = max(most, likeness)
                asked[i] = max(asked[i], likeness)
            there += most
            place += 1
        shared[here] += rarity * min(asked.sum(), there)
