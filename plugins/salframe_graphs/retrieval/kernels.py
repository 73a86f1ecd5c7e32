"""Kernels of the scene index `compiled-lists`, compiled by numba: scan of the lists, and verification of scenes by
two-point hypotheses.

Import them with `kernel_cache.load_kernels`. The text of this file is the key of the cache. Therefore a kernel does not
call functions of other modules, and receives their constants as arguments.
"""

from __future__ import annotations

import numba
import numpy as np

BLOCK = 1 << 14
"""Number of scenes to score at once. Their sums then fit into the processor's cache."""
MAX_BASES = 16
"""Maximum number of pairs of a query object and a scene object from which hypotheses are made. The pairs with the
highest values are used. Two pairs give a hypothesis, so there are at most 120 hypotheses."""
MIN_BASE_M = 0.3
"""Minimum distance in metres between the two objects of a hypothesis, because their direction gives the heading."""

_compile = numba.njit(nogil=True, error_model="numpy")


@_compile
def scan_lists(lists, labels, similarities, totals, state, min_score, scenes, scores):  # type: ignore[no-untyped-def]
    """Score scenes in blocks, starting with scene state[0], until the map ends or `scenes` is nearly full.

    Args:
        lists: scene (P,), code (P, 3) and weight (S,) of the map's `Postings`.
        labels: Arrays over the J labels of the query, labels with short lists first: first (J,) and last (J,) index of
            the label's objects, end (J,) of its list, rarity (J,), and rest (J + 1,), the maximum that this and the
            following labels can add to the shared value of a scene.
        similarities: (n, 3, 256) int32, similarity of the query's objects to each code.
        totals: The sum of the query's rarities, and the shared value of two identical objects.
        state: (2 + J,) int64, updated: the next scene, the number of results, and the position in each list.
        min_score: Only scenes with a higher score are results.
        scenes: (C,) indices of the resulting scenes, in the order of the map. C is at least BLOCK more than the number
            of results.
        scores: (C,) scores of the results.
    """
    scene, code, weight = lists
    first, last, end, rarity, rest = labels
    query_rarity, full = totals
    shared, min_shared = np.empty(BLOCK, np.int64), np.empty(BLOCK, np.int64)
    best_of_query = np.zeros(len(similarities), np.int32)
    share = full * min_score / (1 + min_score) * (1 - 1e-9)
    while state[0] < len(weight) and state[1] + BLOCK <= len(scenes):
        low = state[0]
        high = min(low + BLOCK, len(weight))
        for row in range(high - low):
            shared[row] = 0
            min_shared[row] = np.int64(share * (query_rarity + np.int64(weight[low + row])))
        for j in range(len(first)):
            position = state[2 + j]
            while position < end[j] and scene[position] < high:
                number = scene[position]
                row = np.int64(number) - low
                if shared[row] + rest[j] < min_shared[row]:
                    position += 1
                    continue
                of_query, of_scene = np.int64(0), np.int64(0)
                while position < end[j] and scene[position] == number:
                    best = np.int32(0)
                    for i in range(first[j], last[j]):
                        similarity = similarities[i, 0, code[position, 0]] * similarities[i, 1, code[position, 1]]
                        similarity *= similarities[i, 2, code[position, 2]]
                        best = max(best, similarity)
                        best_of_query[i] = max(best_of_query[i], similarity)
                    of_scene += best
                    position += 1
                for i in range(first[j], last[j]):
                    of_query += best_of_query[i]
                    best_of_query[i] = 0
                shared[row] += rarity[j] * min(of_query, of_scene)
            state[2 + j] = position
        for row in range(high - low):
            if shared[row] > 0 and shared[row] >= min_shared[row]:
                total = full * (query_rarity + np.int64(weight[low + row])) - shared[row]
                score = shared[row] / total
                if score > min_score:
                    scenes[state[1]], scores[state[1]] = low + row, score
                    state[1] += 1
        state[0] = high


@_compile
def _search(scene, low, high, number, step):  # type: ignore[no-untyped-def]
    """Return the first position in scene[low:high], ascending, with a value of at least `number`.

    The search starts at low + step.
    """
    near, far = low, low + step
    while far < high and scene[far] < number:
        step *= 2
        near, far = far, far + step
    far = min(far, high)
    while near < far:
        middle = (near + far) // 2
        if scene[middle] < number:
            near = middle + 1
        else:
            far = middle
    return near


@_compile
def verify_scenes(lists, labels, query, limits, scenes, explained):  # type: ignore[no-untyped-def]
    """Compute the support of the best pose of each scene.

    Each object that coincides with another one under the pose contributes rarity x similarity x nearness. These values
    are summed over the objects of the query, and also over the objects of the scene. The smaller sum is the support.

    Args:
        lists: scene (P,), code (P, 3) and position (P, 2) of the map's `Postings`, and the values of the codes:
            height_m (256,) and position_m (256,).
        labels: Arrays over the J labels of the query: first (J,) and last (J,) index of the label's objects, start and
            end (J,) of its list, and step (J,), the mean number of its objects in a scene.
        query: Arrays over the query's n objects: xy_m (n, 2), range_m (n,), weight (n,), and similarities (n, 3, 256)
            from 0 to 1.
        limits: tolerance_m, tolerance_share, max_shift_m, min_similarity.
        scenes: (K,) indices of scenes, ascending.
        explained: (K,) output, the support of each scene.
    """
    scene, code, position, height_m, position_m = lists
    first, last, start, end, step = labels
    xy_m, range_m, weight, similarities = query
    tolerance_m, tolerance_share, max_shift_m, min_similarity = limits
    low, high = start.copy(), start.copy()
    pair, place, previous = np.empty((64, 2), np.int64), np.empty((64, 4)), 0
    for k in range(len(scenes)):
        number, num_pairs = scenes[k], 0
        for j in range(len(first)):
            low[j] = _search(scene, high[j], end[j], number, 1 + np.int64(step[j] * (number - previous)))
            high[j] = low[j]
            while high[j] < end[j] and scene[high[j]] == number:
                high[j] += 1
            num_pairs += (high[j] - low[j]) * (last[j] - first[j])
        previous = number
        if num_pairs > len(pair):
            pair, place = np.empty((2 * num_pairs, 2), np.int64), np.empty((2 * num_pairs, 4))
        count, objects = 0, 0
        for j in range(len(first)):
            for i in range(first[j], last[j]):
                for p in range(low[j], high[j]):
                    height, length, box_height = code[p]
                    similarity = (
                        similarities[i, 0, height] * similarities[i, 1, length] * similarities[i, 2, box_height]
                    )
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
    """Return the support of the pose of a scene that explains the largest part of the query; 0 if there is no pose.

    Args:
        pair: (C, 2) indices of a query object and a scene object, ordered by query object.
        place: (C, 4) x and y of the scene object (m), similarity, and tolerance (m).
        xy_m: (n, 2) positions of the query's objects.
        weight: (n,) weights of the query's objects.
        max_shift_m: Maximum distance of the pose from the scene's panorama.
    """
    base, bases = np.empty(MAX_BASES, np.int64), 0
    for c in range(len(pair)):
        value, at = weight[pair[c, 0]] * place[c, 2], bases
        while at > 0 and weight[pair[base[at - 1], 0]] * place[base[at - 1], 2] < value:
            if at < MAX_BASES:
                base[at] = base[at - 1]
            at -= 1
        if at < MAX_BASES:
            base[at] = c
            bases = min(bases + 1, MAX_BASES)
    # Upper bound of the support of this and the following pairs: each query object with its most similar scene object.
    remaining, maximum = np.zeros(len(pair) + 1), 0.0
    for c in range(len(pair) - 1, -1, -1):
        if c + 1 == len(pair) or pair[c + 1, 0] != pair[c, 0]:
            maximum = 0.0
        rise = max(place[c, 2] - maximum, 0.0)
        remaining[c], maximum = remaining[c + 1] + weight[pair[c, 0]] * rise, maximum + rise
    best, near, nearest = 0.0, np.empty(len(pair)), np.zeros(len(pair))
    for a in range(bases):
        for b in range(a):
            first, second = base[a], base[b]
            if pair[first, 0] == pair[second, 0] or pair[first, 1] == pair[second, 1]:
                continue
            (x_first, y_first), (x_second, y_second) = xy_m[pair[first, 0]], xy_m[pair[second, 0]]
            x, y = x_second - x_first, y_second - y_first
            x_map, y_map = place[second, 0] - place[first, 0], place[second, 1] - place[first, 1]
            length, length_map = np.sqrt(x * x + y * y), np.sqrt(x_map * x_map + y_map * y_map)
            difference_m = abs(length - length_map)
            if difference_m >= place[first, 3] + place[second, 3] or min(length, length_map) <= MIN_BASE_M:
                continue
            product = length * length_map
            cos, sin = (x * x_map + y * y_map) / product, (x * y_map - y * x_map) / product
            x, y = (x_first + x_second) / 2, (y_first + y_second) / 2
            x_shift = (place[first, 0] + place[second, 0]) / 2 - (cos * x - sin * y)
            y_shift = (place[first, 1] + place[second, 1]) / 2 - (sin * x + cos * y)
            if x_shift * x_shift + y_shift * y_shift >= max_shift_m * max_shift_m:
                continue
            explained, maximum = 0.0, 0.0
            for c in range(len(pair)):
                i = pair[c, 0]
                if c == 0 or pair[c - 1, 0] != i:
                    maximum = 0.0
                    if explained + remaining[c] <= best:
                        break
                x = cos * xy_m[i, 0] - sin * xy_m[i, 1] + x_shift - place[c, 0]
                y = sin * xy_m[i, 0] + cos * xy_m[i, 1] + y_shift - place[c, 1]
                near[c] = place[c, 2] * max(1 - (x * x + y * y) / (place[c, 3] * place[c, 3]), 0.0)
                if near[c] > maximum:
                    explained += weight[i] * (near[c] - maximum)
                    maximum = near[c]
            if explained > best:
                best, near, nearest = explained, nearest, near
    return min(best, _explain_scene(pair, nearest, weight)) if best > 0 else 0.0


@_compile
def _explain_scene(pair, near, weight):  # type: ignore[no-untyped-def]
    """Return the support summed over the scene's objects, each with its best value in near (C,)."""
    explained, nearest = 0.0, np.zeros(pair[:, 1].max() + 1)
    for c in range(len(pair)):
        rise = max(near[c] - nearest[pair[c, 1]], 0.0)
        explained += weight[pair[c, 0]] * rise
        nearest[pair[c, 1]] += rise
    return explained
