"""The functions of `search` compiled by numba, place by place and with few arrays in between: the same but for
rounding."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numba
import numpy as np

from salframe_graphs.compiled import first_of
from salframe_graphs.places import compiled_layout
from salframe_graphs.places.compiled_fits import agreed, label_evidence, outline_ratio, settle
from salframe_graphs.places.compiled_functions import FREE, exp, log
from salframe_graphs.places.compiled_layout import FOUND, VARIANCE, X, Y
from salframe_graphs.places.likelihood import Poses
from salframe_graphs.places.place_index import PlaceIndex, QueryObjects
from salframe_graphs.places.rates import Likelihood, Rates
from salframe_graphs.places.search import Found

__all__ = ["agreed", "label_evidence", "outline_ratio", "search", "settle"]

_F4 = np.float32
_NONE = _F4(-23)
"""Odds whose logarithm is less, 1e-10 or fewer, count as none."""
_LARGE = 1e200
"""A product of odds beyond which the next might not be a number."""
_laid_out: WeakKeyDictionary[PlaceIndex, compiled_layout.Searched] = WeakKeyDictionary()
_compile = numba.njit(nogil=True, error_model="numpy", fastmath=FREE)
_compile_and_keep = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FREE)


def search(
    query: QueryObjects, index: PlaceIndex, places: np.ndarray, rates: Rates, likelihood: Likelihood, refined: int
) -> Found:
    """As in search."""
    if index not in _laid_out:
        _laid_out[index] = compiled_layout.searched(index)
    asked = query.label, query.xy_m, query.z_m, query.range_m, query.ray, query.log_size, query.score
    known, numbers = (_laid_out[index], index.frequency), compiled_layout.numbers(rates, likelihood)
    best, place, pose, score, share, start, unplaced = _search(asked, *known, places, numbers, refined)
    best = best[best >= 0]

    def share_of(row: int) -> np.ndarray:
        own = slice(*start[best[row] : best[row] + 2])
        return share[own].reshape(len(query), -1)  # type: ignore[no-any-return]

    return Found(Poses(place[best], pose[best, :2], pose[best, 2]), score[best], share_of, unplaced)


@_compile_and_keep
def _search(asked, index, frequency, places, numbers, refined):  # type: ignore[no-untyped-def]
    """Poses (C, 3), x, y and yaw, of which `best` are the best of their places. share: of one pose after the other, (n,
    m) of the place's m objects, from start (C + 1,) on."""
    query = compiled_layout.asked(asked, frequency, numbers)
    n, most, size = len(query.label), len(places) * refined, index.size[places]
    first, start = np.zeros(len(places) + 1, np.int64), np.zeros(most + 1, np.int64)
    for k in range(len(places)):
        first[k + 1] = first[k] + n * size[k]
    pairs, unplaced = np.empty(3 * first[-1], np.float32), np.empty(len(places))
    odds, logit = np.empty((n, size.max()), np.float32), np.empty(size.max(), np.float32)
    place, pose, count = np.empty(most, np.int64), np.empty((most, 3)), 0
    for k in range(len(places)):
        alike, sharpness, peak = pairs[3 * first[k] : 3 * first[k + 1]].reshape(3, n, size[k])
        label, of = index.label[places[k], : size[k]], index.of[places[k], :, : size[k]]
        camera_m, look = index.cameras_m[places[k]], index.look[places[k], :, : size[k]]
        _compare(query, label, look, of[VARIANCE], numbers, alike, sharpness, peak, logit)
        missed = _found(of, camera_m[0, 0], camera_m[0, 1], numbers, logit)
        unplaced[k] = missed + _unplaced(alike, logit, size[k], numbers, odds)
        found = _hypotheses(query, label, of, camera_m, alike, logit, numbers, pose[count : count + refined])
        for c in range(count, count + found):
            place[c], start[c + 1] = k, start[c] + n * size[k]
        count += found
    score, share, far = np.empty(count), np.empty(start[count], np.float32), -np.inf
    for c in range(count):
        k = place[c]
        alike, sharpness, peak = pairs[3 * first[k] : 3 * first[k + 1]].reshape(3, n, size[k])
        of, shares = index.of[places[k], :, : size[k]], share[start[c] : start[c + 1]].reshape(n, size[k])
        score[c] = _score(query, of, alike, sharpness, peak, pose[c], numbers, shares)
        far = max(far, score[c] - numbers.far_nats)
    fitted, again, best = np.empty(3), np.empty(n * size.max(), np.float32), np.full(len(places), -1)
    for c in range(count):
        k = place[c]
        if score[c] >= far:
            alike, sharpness, peak = pairs[3 * first[k] : 3 * first[k + 1]].reshape(3, n, size[k])
            of, shares = index.of[places[k], :, : size[k]], share[start[c] : start[c + 1]].reshape(n, size[k])
            other = again[: n * size[k]].reshape(n, size[k])
            for _ in range(numbers.steps):
                _fit(query, of, sharpness, shares, fitted)
                value = _score(query, of, alike, sharpness, peak, fitted, numbers, other)
                if value > score[c]:
                    score[c] = value
                    for axis in range(3):
                        pose[c, axis] = fitted[axis]
                    shares[:] = other
        if best[k] < 0 or score[c] > score[best[k]]:
            best[k] = c
    return best, place, pose, score, share, start, unplaced


@_compile
def _compare(query, label, look, variance, numbers, alike, sharpness, peak, across):  # type: ignore[no-untyped-def]
    """Fill in, of query object and object of a place (n, m): the log ratio of label, height and size; one over the
    variance of the difference of their positions along the query object's ray; and the peak of the density of that
    difference, but for 2 pi. across (m,) is written over."""
    z, length, height = look
    for j in range(len(label)):
        across[j] = variance[j] + numbers.position_variance
    for i in range(len(query.label)):
        own, known, unknown = query.label[i], _F4(query.known[i]), _F4(query.unknown[i])
        own_z, own_length, own_height = _F4(query.look[i, 0]), _F4(query.look[i, 1]), _F4(query.look[i, 2])
        by_z, by_length, by_height = _F4(query.sharpness[i, 0]), _F4(query.sharpness[i, 1]), _F4(query.sharpness[i, 2])
        for j in range(len(label)):
            up, out, high = own_z - z[j], own_length - length[j], own_height - height[j]
            ratio = known if own == label[j] else unknown
            ratio += by_z * up * up + by_length * out * out + by_height * high * high
            alike[i, j] = max(ratio, _F4(-numbers.most_log))
        range_variance = _F4(query.range_variance[i])
        for j in range(len(label)):
            along = across[j] + range_variance
            sharpness[i, j], peak[i, j] = _F4(1) / along, _F4(1) / np.sqrt(along * across[j])


@_compile
def _found(of, x_m, y_m, numbers, logit):  # type: ignore[no-untyped-def]
    """Fill in the logits that each object of a place is found from a position (m,); the log probability that none
    is."""
    nearest, reference, most = _F4(numbers.nearest_m), _F4(numbers.reference_m), _F4(numbers.most_logit)
    per_squared = _F4(numbers.per_distance / 2)
    for j in range(of.shape[1]):
        x, y = _F4(of[X, j] - x_m), _F4(of[Y, j] - y_m)
        squared = max(x * x + y * y, nearest * nearest) / (reference * reference)
        logit[j] = min(max(_F4(of[FOUND, j]) + per_squared * log(squared), -most), most)
    missed, odds = 0.0, 1.0  # odds are multiplied, and only then come the logarithms
    for j in range(of.shape[1]):
        odds *= 1 + exp(logit[j])
        if odds > _LARGE:
            missed, odds = missed - np.log(odds), 1.0
    return missed - np.log(odds)


@_compile
def _share_out(odds, size):  # type: ignore[no-untyped-def]
    """Where several query objects claim one of the place's, they share its odds (n, m)."""
    claimed = np.zeros(size, np.float32)
    for i in range(len(odds)):
        total = _F4(1)
        for j in range(size):
            total += odds[i, j]
        for j in range(size):
            claimed[j] += odds[i, j] / total
    for j in range(size):
        claimed[j] = 1 / max(claimed[j], _F4(1))
    for i in range(len(odds)):
        for j in range(size):
            odds[i, j] *= claimed[j]


@_compile
def _exponentials(log_odds, size, numbers):  # type: ignore[no-untyped-def]
    """Take the exponentials of log odds (n, m) in place."""
    for i in range(len(log_odds)):
        for j in range(size):
            value = log_odds[i, j]
            odds = exp(min(max(value, _NONE), _F4(numbers.most_log)))
            log_odds[i, j] = odds if value > _NONE else _F4(0)


@_compile
def _unplaced(alike, logit, size, numbers, odds):  # type: ignore[no-untyped-def]
    """The score of a place without a pose, but for what is missed."""
    for i in range(len(odds)):
        for j in range(size):
            odds[i, j] = alike[i, j] + logit[j] - _F4(numbers.clutter)
    _exponentials(odds, size, numbers)
    _share_out(odds, size)
    score = 0.0
    for i in range(len(odds)):
        total = 0.0
        for j in range(size):
            total += odds[i, j]
        score += np.log1p(numbers.unplaced_share * total)
    return score


@_compile
def _score(query, of, alike, sharpness, peak, pose, numbers, share):  # type: ignore[no-untyped-def]
    """The score of a place under a pose; fill in how surely each query object is each of the place's (n, m)."""
    size, half, base = of.shape[1], _F4(0.5), _F4(numbers.area - numbers.clutter)
    of_object = np.empty((4, size), np.float32)
    logit, across, x_there, y_there = of_object[0], of_object[1], of_object[2], of_object[3]
    score = _found(of, pose[0], pose[1], numbers, logit)
    c, s = _F4(np.cos(pose[2])), _F4(np.sin(pose[2]))
    for j in range(size):
        x, y = _F4(of[X, j] - pose[0]), _F4(of[Y, j] - pose[1])
        x_there[j], y_there[j] = c * x + s * y, c * y - s * x
        across[j] = 1 / (of[VARIANCE, j] + numbers.position_variance)
    for i in range(len(query.label)):
        x_here, y_here = _F4(query.xy_m[i, 0]), _F4(query.xy_m[i, 1])
        x_ray, y_ray = _F4(query.ray[i, 0]), _F4(query.ray[i, 1])
        for j in range(size):
            x, y = x_there[j] - x_here, y_there[j] - y_here
            forth, side = x * x_ray + y * y_ray, y * x_ray - x * y_ray
            off = forth * forth * sharpness[i, j] + side * side * across[j]
            share[i, j] = alike[i, j] - half * off + logit[j] + base
    _exponentials(share, size, numbers)
    for i in range(len(query.label)):
        for j in range(size):
            share[i, j] *= peak[i, j]
    _share_out(share, size)
    for i in range(len(query.label)):
        total = _F4(1)
        for j in range(size):
            total += share[i, j]
        score += np.log(total)
        for j in range(size):
            share[i, j] /= total
    return score


@_compile
def _fit(query, of, sharpness, share, pose):  # type: ignore[no-untyped-def]
    """Fill in the pose fitted in closed form to shares (n, m), pairs weighted by their certainty."""
    total, x, y, x_there, y_there = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(query.label)):
        for j in range(of.shape[1]):
            weight = share[i, j] * sharpness[i, j]
            total += weight
            x += weight * query.xy_m[i, 0]
            y += weight * query.xy_m[i, 1]
            x_there += weight * of[X, j]
            y_there += weight * of[Y, j]
    total = max(total, 1e-12)
    x, y, x_there, y_there = x / total, y / total, x_there / total, y_there / total
    turned, straight = 0.0, 0.0
    for i in range(len(query.label)):
        east, north = query.xy_m[i, 0] - x, query.xy_m[i, 1] - y
        for j in range(of.shape[1]):
            weight = share[i, j] * sharpness[i, j]
            east_there, north_there = of[X, j] - x_there, of[Y, j] - y_there
            turned += weight * (east * north_there - north * east_there)
            straight += weight * (east * east_there + north * north_there)
    pose[2] = np.arctan2(turned, straight)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    pose[0], pose[1] = x_there - (c * x - s * y), y_there - (s * x + c * y)


@_compile
def _hypotheses(query, label, of, cameras_m, alike, logit, numbers, best):  # type: ignore[no-untyped-def]
    """Fill in the poses (refined, 3) that explain most of a place, best first; how many there are."""
    most, count = len(query.label) * len(label), 0
    pair, worth = np.empty((most, 2), np.int64), np.empty(most, np.float32)
    for i in range(len(query.label)):
        for j in range(len(label)):
            if query.label[i] == label[j] and alike[i, j] > numbers.least_alike:
                pair[count, 0], pair[count, 1], worth[count] = i, j, alike[i, j]
                count += 1
    first, count = first_of(worth[:count], numbers.most_pairs), 0
    for p in range(len(first)):
        if first[p]:
            pair[count, 0], pair[count, 1], worth[count] = pair[p, 0], pair[p, 1], worth[p]
            count += 1
    pair, worth = pair[:count], worth[:count]
    poses = _two_point(query, of, cameras_m, pair, worth, numbers)
    return _most_support(query, of, cameras_m[0], pair, worth, logit, numbers, poses, best)


@_compile
def _two_point(query, of, cameras_m, pair, worth, numbers):  # type: ignore[no-untyped-def]
    """Poses (H, 3) near a camera under which the middle of two objects and the direction between them are those of two
    of the place that are alike, in the order of the pairs."""
    bases, count = len(pair) * (len(pair) - 1) // 2, 0
    pose, rank = np.empty((bases, 3)), np.empty(bases)
    for a in range(len(pair)):
        for b in range(a + 1, len(pair)):
            (i1, j1), (i2, j2) = pair[a], pair[b]
            if i1 == i2 or j1 == j2:
                continue
            here, further = query.xy_m[i1], query.xy_m[i2]
            x, y = further[0] - here[0], further[1] - here[1]
            x_there, y_there = of[X, j2] - of[X, j1], of[Y, j2] - of[Y, j1]
            length, length_there = np.sqrt(x * x + y * y), np.sqrt(x_there * x_there + y_there * y_there)
            variance = 2 * numbers.position_variance + query.range_variance[i1] + query.range_variance[i2]
            slack = numbers.slack_sigmas * np.sqrt(variance + of[VARIANCE, j1] + of[VARIANCE, j2])
            if abs(length - length_there) >= slack or min(length, length_there) <= numbers.least_base_m:
                continue
            both = length * length_there
            c, s = (x * x_there + y * y_there) / both, (x * y_there - y * x_there) / both
            yaw = np.arctan2(s, c)
            x, y = (here[0] + further[0]) / 2, (here[1] + further[1]) / 2
            pose[count, 0] = (of[X, j1] + of[X, j2]) / 2 - (c * x - s * y)
            pose[count, 1] = (of[Y, j1] + of[Y, j2]) / 2 - (s * x + c * y)
            pose[count, 2] = yaw
            rank[count] = worth[a] + worth[b] + numbers.base_worth * min(length, numbers.longest_base_m)
            count += 1
    first, kept = first_of(rank[:count], numbers.most_hypotheses), 0
    for h in range(count):
        near = False
        for camera in cameras_m:
            near |= np.hypot(camera[0] - pose[h, 0], camera[1] - pose[h, 1]) < numbers.largest_shift_m
        if first[h] and near:
            for axis in range(3):
                pose[kept, axis] = pose[h, axis]
            kept += 1
    return pose[:kept]


@_compile
def _most_support(query, of, origin_m, pair, worth, logit, numbers, poses, best):  # type: ignore[no-untyped-def]
    """Fill in the poses (refined, 3) under which alike pairs, sorted by query object, bring most to the score, best
    first; how many there are. Single precision."""
    count = len(pair)
    of_pair = np.empty((5, count), np.float32)
    x_there, y_there, peak, by_along, by_across = of_pair[0], of_pair[1], of_pair[2], of_pair[3], of_pair[4]
    rest, support, held = np.zeros(count + 1), np.full(len(best), -np.inf), 0
    for p in range(count):
        i, j = pair[p]
        across = of[VARIANCE, j] + numbers.position_variance
        along = across + query.range_variance[i]
        x_there[p], y_there[p] = of[X, j] - origin_m[0], of[Y, j] - origin_m[1]
        peak[p] = worth[p] + logit[j] - numbers.clutter + numbers.area - 0.5 * log(along * across)
        by_along[p], by_across[p] = -0.5 / along, -0.5 / across
    for p in range(count - 1, -1, -1):  # one by one pairs bring no less than together
        rest[p] = rest[p + 1] + log(_F4(1) + exp(min(max(peak[p], _NONE), _F4(numbers.most_log))))
    for pose in poses:
        c, s = _F4(np.cos(pose[2])), _F4(np.sin(pose[2]))
        x_pose, y_pose = _F4(pose[0] - origin_m[0]), _F4(pose[1] - origin_m[1])
        total, odds = 0.0, 0.0
        for p in range(count):
            i = pair[p, 0]
            east, north = x_there[p] - x_pose, y_there[p] - y_pose
            x = c * east + s * north - _F4(query.xy_m[i, 0])
            y = c * north - s * east - _F4(query.xy_m[i, 1])
            x_ray, y_ray = _F4(query.ray[i, 0]), _F4(query.ray[i, 1])
            forth, side = x * x_ray + y * y_ray, y * x_ray - x * y_ray
            exponent = forth * forth * by_along[p] + side * side * by_across[p] + peak[p]
            if exponent > _NONE:
                odds += exp(min(_F4(exponent), _F4(numbers.most_log)))
            if p + 1 == count or pair[p + 1, 0] != i:
                total, odds = total + log(1 + odds), 0.0
                if total + rest[p + 1] < support[-1] - 1e-3:
                    break
        row = held
        while row > 0 and total > support[row - 1]:
            row -= 1
        held = min(held + (row < len(best)), len(best))
        for later in range(held - 1, row, -1):
            support[later] = support[later - 1]
            for axis in range(3):
                best[later, axis] = best[later - 1, axis]
        if row < len(best):
            support[row] = total
            for axis in range(3):
                best[row, axis] = pose[axis]
    return held
