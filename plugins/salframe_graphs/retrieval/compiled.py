"""The function of `scoring` compiled by numba, with the same results."""

from __future__ import annotations

import numba
import numpy as np

from salframe_graphs.retrieval.postings import CODE_LOW, CODE_STEP, Postings
from salframe_graphs.retrieval.scoring import FULL, Asked

_BLOCK = 1 << 14
"""So many scenes at a time: what they share stays in the processor's cache."""


def best_scenes(postings: Postings, asked: Asked, count: int) -> tuple[np.ndarray, np.ndarray]:
    """As in scoring. Rare labels come first; a scene that is not among the first even if all labels to come were
    shared in full is passed over."""
    if not len(asked.label):
        return np.zeros(0, np.int64), np.zeros(0)
    lists = postings.start, postings.rarity, postings.scene, postings.code, postings.weight
    objects = asked.label, asked.appearance, asked.scale, asked.rarity
    return _best(*lists, *objects, (CODE_LOW, CODE_STEP, FULL), count)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True)
def _best(start, rarity, scene, code, weight, label, appearance, scale, asked, constants, count):  # type: ignore[no-untyped-def]
    """Candidates gather until there are twice as many as wanted, then the lesser half goes."""
    low_code, step, full = constants
    alike, first = _alike(appearance, scale, low_code, step), _by_length(label, start)
    place, rest = np.empty(len(first), np.int64), np.zeros(len(first) + 1)  # what labels from each on share at most
    for j in range(len(first) - 1, -1, -1):
        own, objects = label[first[j, 0]], first[j, 1] - first[j, 0]
        place[j], rest[j] = start[own], rest[j + 1] + full * rarity[own] * objects
    block = min(_BLOCK, len(weight))
    shared, needed = np.zeros(block, np.int64), np.zeros(block)
    found, score = np.empty(2 * count, np.int64), np.empty(2 * count)
    held, least = 0, 0.0
    for low in range(0, len(weight), _BLOCK):
        high = min(low + _BLOCK, len(weight))
        shared[:] = 0
        share = full * least / (1 + least) * (1 - 1e-9)
        for here in range(high - low):
            needed[here] = share * (asked + np.int64(weight[low + here]))
        for j in range(len(first)):
            own, like = label[first[j, 0]], alike[first[j, 0] : first[j, 1]]
            end = start[own + 1]
            place[j] = _add(shared, needed, low, high, place[j], end, scene, code, rarity[own], like, rest[j])
        for here in range(high - low):
            if shared[here] == 0 or shared[here] < needed[here]:
                continue
            value = shared[here] / (full * (asked + np.int64(weight[low + here])) - shared[here])
            if value <= least:  # of equal scores those of lower numbers are held already
                continue
            found[held], score[held] = low + here, value
            held += 1
            if held == 2 * count:
                order = np.argsort(-score, kind="mergesort")[:count]
                found[:count], score[:count] = found[order], score[order]
                held, least = count, score[count - 1]
    return found[:held], score[:held]


@numba.njit(nogil=True)
def _by_length(label, start):  # type: ignore[no-untyped-def]
    """(J, 2) the first and the last + 1 of the objects of each label, of labels (n,) in order, the shortest list
    first."""
    first, count = np.empty((len(label), 2), np.int64), 0
    for i in range(len(label)):
        if i == 0 or label[i] != label[i - 1]:
            first[count, 0] = i
            count += 1
        first[count - 1, 1] = i + 1
    length = np.array([start[label[i] + 1] - start[label[i]] for i in first[:count, 0]])
    return first[:count][np.argsort(length, kind="mergesort")]


@numba.njit(nogil=True, error_model="numpy")
def _alike(appearance, scale, low, step):  # type: ignore[no-untyped-def]
    """As of Asked, in as many bits as the product of three takes."""
    alike = np.full((len(appearance), 3, 256), 255, np.int32)
    for i in range(len(appearance)):
        for part in range(3):
            own = appearance[i, part]
            for code in range(0 if np.isnan(own) else 256):
                apart = (own - (low[part] + step * np.int32(code))) / scale[part]
                alike[i, part, code] = np.int32(np.rint(max(255 / (1 + apart * apart), 1.0)))
    return alike


@numba.njit(nogil=True)
def _add(shared, needed, low, high, place, end, scene, code, rarity, alike, rest):  # type: ignore[no-untyped-def]
    """Add what a label's list shares with the query's objects to those of the scenes low to high that may still share
    as much as is needed; where the list goes on."""
    most_of, count = np.zeros(len(alike), np.int32), len(alike)
    while place < end and scene[place] < high:
        here = scene[place]
        if shared[here - low] + rest < needed[here - low]:
            place += 1
            continue
        there, of_asked = np.int64(0), np.int64(0)
        while place < end and scene[place] == here:
            most = np.int32(0)
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
