"""The function of `scoring` compiled by numba, with the same results."""

from __future__ import annotations

import numba
import numpy as np

from salframe_graphs.retrieval.postings import Postings
from salframe_graphs.retrieval.scoring import FULL, Asked

_BLOCK = 1 << 14
"""So many scenes at a time: what they share stays in the processor's cache."""


def best_scenes(postings: Postings, asked: Asked, count: int) -> tuple[np.ndarray, np.ndarray]:
    """As in scoring. Rare labels come first; once the others together are worth no place among the first, their lists
    matter only to scenes that have a rarer label of the query."""
    order = np.argsort(np.diff(postings.start)[asked.label], kind="stable")
    label = asked.label[order]
    objects = np.stack([asked.first[:-1], asked.first[1:]], 1)[order]
    worth = postings.rarity[label] * (objects[:, 1] - objects[:, 0])
    rest = worth[::-1].cumsum()[::-1] / max(asked.rarity, 1)  # of this label and those after it: bound of the score
    return _best(  # type: ignore[no-any-return]
        np.stack([postings.start[label], postings.start[label + 1]], 1),
        objects,
        postings.rarity[label],
        rest,
        asked.alike,
        postings.scene,
        postings.code,
        postings.weight,
        asked.rarity,
        count,
    )


@numba.njit(cache=True, nogil=True)
def _best(lists, objects, rarity, rest, alike, scene, code, weight, asked, count):  # type: ignore[no-untyped-def]
    """Candidates gather until there are twice as many as wanted, then the lesser half goes."""
    place, shared = lists[:, 0].copy(), np.zeros(_BLOCK, np.int64)
    found, score = np.empty(2 * count, np.int64), np.empty(2 * count)
    held, least = 0, 0.0
    for low in range(0, len(weight), _BLOCK):
        high = min(low + _BLOCK, len(weight))
        shared[:] = 0
        for j in range(len(lists)):
            place[j] = _add(
                shared,
                low,
                high,
                place[j],
                lists[j, 1],
                scene,
                code,
                rarity[j],
                alike[objects[j, 0] : objects[j, 1]],
                rest[j] <= least,
            )
        for here in range(high - low):
            if shared[here] == 0:
                continue
            whole = FULL * (asked + np.int64(weight[low + here])) - shared[here]
            if shared[here] * 1.000001 < least * whole:  # spares most a division
                continue
            value = shared[here] / whole
            if value <= least:  # of equal scores those of lower numbers are held already
                continue
            found[held], score[held] = low + here, value
            held += 1
            if held == 2 * count:
                order = np.argsort(-score, kind="mergesort")[:count]
                found[:count], score[:count] = found[order], score[order]
                held, least = count, score[count - 1]
    return found[:held], score[:held]


@numba.njit(cache=True, nogil=True)
def _add(shared, low, high, place, end, scene, code, rarity, alike, only_known):  # type: ignore[no-untyped-def]
    """Add what a label's list shares with the query's objects to scenes low to high, to those that share something
    already if only_known; where the list goes on."""
    most_of = np.zeros(len(alike), np.int64)
    while place < end and scene[place] < high:
        here = scene[place]
        if only_known and shared[here - low] == 0:
            place += 1
            continue
        there = np.int64(0)
        most_of[:] = 0
        while place < end and scene[place] == here:
            most = np.int64(0)
            for i in range(len(alike)):
                likeness = alike[i, 0, code[place, 0]] * alike[i, 1, code[place, 1]] * alike[i, 2, code[place, 2]]
                most = max(most, likeness)
                most_of[i] = max(most_of[i], likeness)
            there += most
            place += 1
        shared[here - low] += rarity * min(most_of.sum(), there)
    return place
