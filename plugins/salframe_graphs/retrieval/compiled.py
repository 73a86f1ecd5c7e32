"""The function of `scoring` compiled by numba, with the same results."""

from __future__ import annotations

import numba
import numpy as np

from salframe_graphs.retrieval.postings import Postings
from salframe_graphs.retrieval.scoring import FULL, Asked

_BLOCK = 1 << 14
"""So many scenes at a time: what they share stays in the processor's cache."""


def best_scenes(postings: Postings, asked: Asked, count: int) -> tuple[np.ndarray, np.ndarray]:
    """As in scoring. Rare labels come first; a scene that is not among the first even if all labels to come were
    shared in full is passed over."""
    order = np.argsort(np.diff(postings.start)[asked.label], kind="stable")
    label = asked.label[order]
    objects = np.stack([asked.first[:-1], asked.first[1:]], 1)[order]
    worth = FULL * postings.rarity[label] * (objects[:, 1] - objects[:, 0])
    return _best(  # type: ignore[no-any-return]
        np.stack([postings.start[label], postings.start[label + 1]], 1),
        objects,
        postings.rarity[label],
        worth[::-1].cumsum()[::-1],
        asked.alike,
        postings.scene,
        postings.code,
        postings.weight,
        asked.rarity,
        count,
    )


@numba.njit(cache=True, nogil=True)
def _best(lists, objects, rarity, rest, alike, scene, code, weight, asked, count):  # type: ignore[no-untyped-def]
    """Candidates gather until there are twice as many as wanted, then the lesser half goes. rest (J,): what the labels
    from each on share at most."""
    place, shared, needed = lists[:, 0].copy(), np.zeros(_BLOCK, np.int64), np.zeros(_BLOCK)
    found, score = np.empty(2 * count, np.int64), np.empty(2 * count)
    held, least = 0, 0.0
    for low in range(0, len(weight), _BLOCK):
        high = min(low + _BLOCK, len(weight))
        shared[:] = 0
        share = FULL * least / (1 + least) * (1 - 1e-9)
        for here in range(high - low):
            needed[here] = share * (asked + np.int64(weight[low + here]))
        for j in range(len(lists)):
            own = alike[objects[j, 0] : objects[j, 1]]
            place[j] = _add(shared, needed, low, high, place[j], lists[j, 1], scene, code, rarity[j], own, rest[j])
        for here in range(high - low):
            if shared[here] == 0 or shared[here] < needed[here]:
                continue
            value = shared[here] / (FULL * (asked + np.int64(weight[low + here])) - shared[here])
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
def _add(shared, needed, low, high, place, end, scene, code, rarity, alike, rest):  # type: ignore[no-untyped-def]
    """Add what a label's list shares with the query's objects to those of the scenes low to high that may still share
    as much as is needed; where the list goes on."""
    most_of, count = np.zeros(len(alike), np.int64), len(alike)
    while place < end and scene[place] < high:
        here = scene[place]
        if shared[here - low] + rest < needed[here - low]:
            place += 1
            continue
        there, of_asked = np.int64(0), np.int64(0)
        while place < end and scene[place] == here:
            most = np.int64(0)
            for i in range(count):
                likeness = alike[i, 0, code[place, 0]] * alike[i, 1, code[place, 1]] * alike[i, 2, code[place, 2]]
                most = max(most, likeness)
                most_of[i] = max(most_of[i], likeness)
            there += most
            place += 1
        for i in range(count):
            of_asked += most_of[i]
            most_of[i] = 0
        shared[here - low] += rarity * min(of_asked, there)
    return place
