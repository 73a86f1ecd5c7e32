"""Kernels of the scene index `compiled-lists`, compiled by numba: they scan the lists, and verify scenes by two-point
hypotheses.

Import them by `kernel_cache.load_kernels`. The key of the cache is the text of this file: a kernel calls nothing of
other modules, and receives their constants as arguments.
"""

from __future__ import annotations

import numba
import numpy as np

BLOCK = 1 << 14
"""Number of scenes to score at a time, so that their sums stay in the processor's cache."""
MAX_BASES = 16
"""Maximum number of node pairs of a scene that make hypotheses, those that are worth most: at most 120 hypotheses."""
MIN_BASE_M = 0.3
"""Minimum distance between the two objects of a hypothesis, whose direction gives the heading."""

_compile = numba.njit(nogil=True, error_model="numpy")


@_compile
def scan_lists(lists, labels, alike, totals, state, min_score, scenes, scores):  # type: ignore[no-untyped-def]
    """Score scenes block by block, from scene state[0] on, until the map ends or `scenes` is nearly full.

    Args:
        lists: scene (P,), code (P, 3) and weight (S,) of the map's `Postings`.
        labels: of the J labels of the query, the longest lists last: first (J,) and last (J,) number of its objects,
            end (J,) of its list, rarity (J,), and rest (J + 1,), the most that labels from each on can share.
        alike: (n, 3, 256) int32, likeness of the query's objects to each code.
        totals: the query's rarity, and what two equal objects share.
        state: (2 + J,) int64, updated: the next scene, the number of results, and the position in each list.
        min_score: scenes at or below this score are skipped.
        scenes, scores: (C,) results, in the order of the map; C is at least BLOCK more than the number of results.
    """
    scene, code, weight = lists
    first, last, end, rarity, rest = labels
    query_rarity, full = totals
    shared, needed = np.empty(BLOCK, np.int64), np.empty(BLOCK, np.int64)
    best_of_query = np.zeros(len(alike), np.int32)
    share = full * min_score / (1 + min_score) * (1 - 1e-9)
    while state[0] < len(weight) and state[1] + BLOCK <= len(scenes):
        low = state[0]
        high = min(low + BLOCK, len(weight))
        for here in range(high - low):
            shared[here] = 0
            needed[here] = np.int64(share * (query_rarity + np.int64(weight[low + here])))
        for j in range(len(first)):
            position = state[2 + j]
            while position < end[j] and scene[position] < high:
                number = scene[position]
                here = np.int64(number) - low
                if shared[here] + rest[j] < needed[here]:
                    position += 1
                    continue
                of_query, of_scene = np.int64(0), np.int64(0)
                while position < end[j] and scene[position] == number:
                    best = np.int32(0)
                    for i in range(first[j], last[j]):
                        like = alike[i, 0, code[position, 0]] * alike[i, 1, code[position, 1]]
                        like *= alike[i, 2, code[position, 2]]
                        best = max(best, like)
                        best_of_query[i] = max(best_of_query[i], like)
                    of_scene += best
                    position += 1
                for i in range(first[j], last[j]):
                    of_query += best_of_query[i]
                    best_of_query[i] = 0
                shared[here] += rarity[j] * min(of_query, of_scene)
            state[2 + j] = position
        for here in range(high - low):
            if shared[here] > 0 and shared[here] >= needed[here]:
                whole = full * (query_rarity + np.int64(weight[low + here])) - shared[here]
                score = shared[here] / whole
                if score > min_score:
                    scenes[state[1]], scores[state[1]] = low + here, score
                    state[1] += 1
        state[0] = high


@_compile
def _find(scene, low, high, wanted, step):  # type: ignore[no-untyped-def]
    """Return the first position in scene[low:high], ascending, of a number of at least `wanted`; low + step is a
    guess."""
    near, far = low, low + step
    while far < high and scene[far] < wanted:
        step *= 2
        near, far = far, far + step
    far = min(far, high)
    while near < far:
        middle = (near + far) // 2
        if scene[middle] < wanted:
            near = middle + 1
        else:
            far = middle
    return near


@_compile
def verify_scenes(lists, labels, query, limits, scenes, explained):  # type: ignore[no-untyped-def]
    """Fill in what the best pose of each scene explains (K,): the sum of the rarities of the objects that coincide
    under it, each times similarity and nearness; the smaller sum of both sides.

    Args:
        lists: scene (P,), code (P, 3) and position (P, 2) of the map's `Postings`, and what codes stand for: height_m
            and position_m (256,).
        labels: of the J labels of the query: first (J,) and last (J,) number of its objects, start and end (J,) of its
            list, and step (J,), the mean number of its objects in a scene.
        query: of its n objects: xy_m (n, 2), range_m (n,), weight (n,), and alike (n, 3, 256) in parts of one.
        limits: tolerance_m, tolerance_share, max_shift_m, min_similarity.
        scenes: (K,) numbers of scenes, ascending.
    """
    scene, code, position, height_m, position_m = lists
    first, last, start, end, step = labels
    xy_m, range_m, weight, alike = query
    tolerance_m, tolerance_share, max_shift_m, min_similarity = limits
    low, high = start.copy(), start.copy()
    pair, place, before = np.empty((64, 2), np.int64), np.empty((64, 4)), 0
    for k in range(len(scenes)):
        wanted, num_pairs = scenes[k], 0
        for j in range(len(first)):
            low[j] = _find(scene, high[j], end[j], wanted, 1 + np.int64(step[j] * (wanted - before)))
            high[j] = low[j]
            while high[j] < end[j] and scene[high[j]] == wanted:
                high[j] += 1
            num_pairs += (high[j] - low[j]) * (last[j] - first[j])
        before = wanted
        if num_pairs > len(pair):
            pair, place = np.empty((2 * num_pairs, 2), np.int64), np.empty((2 * num_pairs, 4))
        count, objects = 0, 0
        for j in range(len(first)):
            for i in range(first[j], last[j]):
                for p in range(low[j], high[j]):
                    height, length, box_height = code[p]
                    similarity = alike[i, 0, height] * alike[i, 1, length] * alike[i, 2, box_height]
                    if similarity < min_similarity:
                        continue
                    x, y, z = position_m[position[p, 0]], position_m[position[p, 1]], height_m[height]
                    tolerance = tolerance_m + tolerance_share * np.sqrt(range_m[i] ** 2 + x * x + y * y + z * z)
                    pair[count, 0], pair[count, 1] = i, objects + p - low[j]
                    place[count, 0], place[count, 1], place[count, 2], place[count, 3] = x, y, similarity, tolerance
                    count += 1
            objects += high[j] - low[j]
        explained[k] = _explain_best(pair[:count], place[:count], xy_m, weight, max_shift_m)


@_compile
def _explain_best(pair, place, xy_m, weight, max_shift_m):  # type: ignore[no-untyped-def]
    """Return what the pose that explains most of the query explains of a scene, 0 where there is no pose.

    Args:
        pair: (C, 2) numbers of an object of the query and one of the scene, ordered by that of the query.
        place: (C, 4) x, y (m) in the scene, similarity, and the distance (m) at which the two are no longer one.
    """
    base, bases = np.empty(MAX_BASES, np.int64), 0
    for c in range(len(pair)):
        worth, at = weight[pair[c, 0]] * place[c, 2], bases
        while at > 0 and weight[pair[base[at - 1], 0]] * place[base[at - 1], 2] < worth:
            if at < MAX_BASES:
                base[at] = base[at - 1]
            at -= 1
        if at < MAX_BASES:
            base[at] = c
            bases = min(bases + 1, MAX_BASES)
    # What the pairs from each on can add at most: their objects of the query under the most similar of the scene.
    left, maximum = np.zeros(len(pair) + 1), 0.0
    for c in range(len(pair) - 1, -1, -1):
        if c + 1 == len(pair) or pair[c + 1, 0] != pair[c, 0]:
            maximum = 0.0
        rise = max(place[c, 2] - maximum, 0.0)
        left[c], maximum = left[c + 1] + weight[pair[c, 0]] * rise, maximum + rise
    best, near, nearest = 0.0, np.empty(len(pair)), np.zeros(len(pair))
    for a in range(bases):
        for b in range(a):
            one, two = base[a], base[b]
            if pair[one, 0] == pair[two, 0] or pair[one, 1] == pair[two, 1]:
                continue
            (x_one, y_one), (x_two, y_two) = xy_m[pair[one, 0]], xy_m[pair[two, 0]]
            x, y = x_two - x_one, y_two - y_one
            x_there, y_there = place[two, 0] - place[one, 0], place[two, 1] - place[one, 1]
            length, length_there = np.sqrt(x * x + y * y), np.sqrt(x_there * x_there + y_there * y_there)
            apart = abs(length - length_there)
            if apart >= place[one, 3] + place[two, 3] or min(length, length_there) <= MIN_BASE_M:
                continue
            both = length * length_there
            cos, sin = (x * x_there + y * y_there) / both, (x * y_there - y * x_there) / both
            x, y = (x_one + x_two) / 2, (y_one + y_two) / 2
            x_shift = (place[one, 0] + place[two, 0]) / 2 - (cos * x - sin * y)
            y_shift = (place[one, 1] + place[two, 1]) / 2 - (sin * x + cos * y)
            if x_shift * x_shift + y_shift * y_shift >= max_shift_m * max_shift_m:
                continue
            explained, maximum = 0.0, 0.0
            for c in range(len(pair)):
                i = pair[c, 0]
                if c == 0 or pair[c - 1, 0] != i:
                    maximum = 0.0
                    if explained + left[c] <= best:
                        break
                x = cos * xy_m[i, 0] - sin * xy_m[i, 1] + x_shift - place[c, 0]
                y = sin * xy_m[i, 0] + cos * xy_m[i, 1] + y_shift - place[c, 1]
                near[c] = place[c, 2] * max(1 - (x * x + y * y) / (place[c, 3] * place[c, 3]), 0.0)
                if near[c] > maximum:
                    explained += weight[i] * (near[c] - maximum)
                    maximum = near[c]
            if explained > best:
                best, near, nearest = explained, nearest, near
    return min(best, _of_scene(pair, nearest, weight)) if best > 0 else 0.0


@_compile
def _of_scene(pair, near, weight):  # type: ignore[no-untyped-def]
    """Return what is explained of a scene's objects, each by its nearest object of the query; near (C,) of pairs."""
    explained, nearest = 0.0, np.zeros(pair[:, 1].max() + 1)
    for c in range(len(pair)):
        rise = max(near[c] - nearest[pair[c, 1]], 0.0)
        explained += weight[pair[c, 0]] * rise
        nearest[pair[c, 1]] += rise
    return explained
