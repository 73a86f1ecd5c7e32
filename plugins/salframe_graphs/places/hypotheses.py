"""Poses worth a look: two alike pairs of objects at the same distance give one."""

from __future__ import annotations

import numpy as np

from salframe_graphs.places.likelihood import PlaceLikelihood, Poses
from salframe_graphs.places.place_index import PlaceIndex, QueryObjects
from salframe_graphs.verification import best_per_candidate, two_pairs

MOST_PAIRS, MOST_HYPOTHESES = 40, 100
"""Pairs of alike objects, and hypotheses made of two of them, that are looked at in each place."""
LEAST_ALIKE = -2.0
"""Log ratio of label, height and size below which two objects start no hypothesis."""
LEAST_BASE_M, LONGEST_BASE_M, BASE_WORTH = 0.3, 4.0, 0.3
"""Distance below which two objects say nothing of a heading, that above which more says no more, and what each metre
between is worth beside what the pairs are."""
LARGEST_SHIFT_M = 6.0
"""A query this far from every scene frame of a place was not taken in it."""
SLACK_SIGMAS = 2.0


def best_poses(query: QueryObjects, index: PlaceIndex, scorer: PlaceLikelihood, kept: int) -> Poses:
    """At most `kept` poses a place, sorted by place, then best first: two-point hypotheses scored by all alike pairs,
    each object of the place as likely found as from its first camera."""
    every, rates = np.arange(len(index.label)), scorer.rates
    same = query.label[None, :, None] == index.label[:, None]
    value = np.where(same, scorer.alike, -np.inf)
    k, i, j = np.nonzero(value > LEAST_ALIKE)
    ranked = np.sort(best_per_candidate(value[k, i, j], k, MOST_PAIRS))
    k, i, j = k[ranked], i[ranked], j[ranked]
    worth = value[k, i, j]
    first, second = two_pairs(k, len(every))
    keep = (i[first] != i[second]) & (j[first] != j[second])
    first, second = first[keep], second[keep]
    i1, i2, j1, j2, place = i[first], i[second], j[first], j[second], k[first]
    base, base_there = query.xy_m[i2] - query.xy_m[i1], index.xy_m[place, j2] - index.xy_m[place, j1]
    length, length_there = np.hypot(*base.T), np.hypot(*base_there.T)
    noise = rates.position_error_m**2 + (rates.range_error_share * query.range_m) ** 2
    slack = SLACK_SIGMAS * np.sqrt(noise[i1] + noise[i2] + index.variance_m2[place, j1] + index.variance_m2[place, j2])
    fits = (np.abs(length - length_there) < slack) & (np.minimum(length, length_there) > LEAST_BASE_M)
    rank = np.where(fits, worth[first] + worth[second] + BASE_WORTH * np.minimum(length, LONGEST_BASE_M), -np.inf)
    chosen = np.sort(best_per_candidate(rank, place, MOST_HYPOTHESES))
    place, i1, i2, j1, j2 = (array[chosen] for array in (place, i1, i2, j1, j2))
    yaw = np.arctan2(base_there[chosen, 1], base_there[chosen, 0]) - np.arctan2(base[chosen, 1], base[chosen, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    middle = (query.xy_m[i1] + query.xy_m[i2]) / 2
    turned = np.stack([c * middle[:, 0] - s * middle[:, 1], s * middle[:, 0] + c * middle[:, 1]], 1)
    shift = (index.xy_m[place, j1] + index.xy_m[place, j2]) / 2 - turned
    near = np.sqrt(((index.cameras_m[place] - shift[:, None]) ** 2).sum(2)).min(1, initial=np.inf) < LARGEST_SHIFT_M
    poses = Poses(place[near], shift[near], yaw[near])
    support = _support(query, index, scorer, (k, i, j), poses)
    return poses.take(best_per_candidate(support, poses.place, kept))


def _support(
    query: QueryObjects,
    index: PlaceIndex,
    scorer: PlaceLikelihood,
    pairs: tuple[np.ndarray, np.ndarray, np.ndarray],
    poses: Poses,
) -> np.ndarray:
    """(C,) the part of the score that alike pairs (k, i, j), sorted by place, bring under poses sorted by place.

    Single precision, and laid out (places, hypotheses, pairs): most of a query's time is spent here.
    """
    k, i, j = pairs
    places, rates = len(index.label), scorer.rates
    if not len(poses):
        return np.zeros(0)
    column = np.arange(len(k)) - np.searchsorted(k, k)
    row = np.arange(len(poses)) - np.searchsorted(poses.place, poses.place)
    shape = (places, row.max() + 1, column.max() + 1)

    def beside(values: np.ndarray, fill: float = 0.0) -> np.ndarray:
        """Values of pairs (P,) as (places, 1, pairs)."""
        laid = np.full((places, shape[2]), fill, np.float32)
        laid[k, column] = values
        return laid[:, None]

    def below(values: np.ndarray) -> np.ndarray:
        """Values of poses (C,) as (places, hypotheses, 1)."""
        laid = np.zeros(shape[:2], np.float32)
        laid[poses.place, row] = values
        return laid[..., None]

    across = index.variance_m2[k, j] + rates.position_error_m**2
    along = across + (rates.range_error_share * query.range_m[i]) ** 2
    logit = scorer.found_logit(np.arange(places), index.cameras_m[:, 0])[k, j]
    peak = (
        scorer.alike[k, i, j]
        + logit
        - np.log(rates.clutter)
        + np.log(scorer.likelihood.area_m2 / (2 * np.pi))
        - 0.5 * np.log(along * across)
    )
    origin = index.cameras_m[:, 0]  # single precision needs small numbers
    local, moved = index.xy_m[k, j] - origin[k], poses.shift_m - origin[poses.place]
    c, s = below(np.cos(poses.yaw_rad)), below(np.sin(poses.yaw_rad))
    east, north = beside(local[:, 0]) - below(moved[:, 0]), beside(local[:, 1]) - below(moved[:, 1])
    x = c * east + s * north - beside(query.xy_m[i, 0])
    y = c * north - s * east - beside(query.xy_m[i, 1])
    ray_x, ray_y = beside(query.ray[i, 0]), beside(query.ray[i, 1])
    forth, side = x * ray_x + y * ray_y, y * ray_x - x * ray_y
    exponent = forth * forth * beside(-0.5 / along) + side * side * beside(-0.5 / across)
    odds = np.exp(np.minimum(exponent + beside(peak, -np.inf), 50))
    owner = np.zeros((places, shape[2], len(query)), np.float32)
    owner[k, column, i] = 1
    support = np.log1p(odds @ owner).sum(2)
    return support[poses.place, row]
