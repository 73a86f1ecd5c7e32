"""The functions of `scoring` compiled by numba, with the same results."""

from __future__ import annotations

import numba
import numpy as np

from salframe_graphs.retrieval.scoring import FULL


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


@numba.njit(cache=True)
def first(shared, weight, asked, count):  # type: ignore[no-untyped-def]
    """As in scoring: candidates gather until there are twice as many as wanted, then the lesser half goes."""
    scene, score = np.empty(2 * count, np.int64), np.empty(2 * count)
    held, least = 0, 0.0
    for here in range(len(shared)):
        if shared[here] == 0:
            continue
        value = shared[here] / (FULL * (asked + np.int64(weight[here])) - shared[here])
        if value <= least:  # of equal scores those of lower numbers are held already
            continue
        scene[held], score[held] = here, value
        held += 1
        if held == 2 * count:
            order = np.argsort(-score, kind="mergesort")[:count]
            scene[:count], score[:count] = scene[order], score[order]
            held, least = count, score[count - 1]
    return scene[:held], score[:held]
