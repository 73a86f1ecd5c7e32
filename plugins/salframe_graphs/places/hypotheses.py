"""Initial poses of a query in each place, from two pairs of similar objects with equal distances."""

from __future__ import annotations

import numpy as np

from salframe.graphs.segments import Segments, pairs_within, ranges, run_starts, starts, top_per_group
from salframe.panoramas.geometry import as_complex
from salframe_graphs.places.likelihood import PlaceLikelihood, Poses

MAX_PAIRS, MAX_HYPOTHESES = 40, 100
"""Maximum numbers of pairs of similar objects and of hypotheses in each place. A hypothesis consists of two pairs."""
MIN_LOG_RATIO = -2.0
"""Minimum log ratio of label, height and size of a pair of objects."""
MIN_BASE_M, MAX_BASE_M, BASE_WORTH = 0.3, 4.0, 0.3
"""Minimum distance of two objects that give a heading (m), the distance up to which a longer base is preferred (m), and
the value of a metre of base relative to the log ratios of the pairs."""
MAX_SHIFT_M = 6.0
"""Maximum distance in metres of a query from the nearest scene frame of its place."""
SLACK_SIGMAS = 2.0
"""Maximum difference of two equal distances, in standard deviations."""


def best_poses(scorer: PlaceLikelihood, max_poses: int) -> Poses:
    """Return at most `max_poses` poses of each place, sorted by place, then best first.

    All pairs of similar objects score the two-point hypotheses. The probability of detecting an object of the place is
    approximated by the probability of detecting it from the place's first camera.
    """
    index, position, rates = scorer.index, scorer.position, scorer.rates
    i, j = np.nonzero(scorer.same_label & (scorer.log_ratio > MIN_LOG_RATIO))
    value, place = scorer.log_ratio[i, j], index.place[j]
    order = np.lexsort((j, i, place))
    if np.bincount(place, minlength=1).max() > MAX_PAIRS:
        order = order[np.sort(top_per_group(value[order], place[order], MAX_PAIRS))]
    i, j, value, place = i[order], j[order], value[order], place[order]
    first, second = pairs_within(starts(np.bincount(place, minlength=len(index))))
    is_base = (i[first] != i[second]) & (j[first] != j[second])
    first, second = first[is_base], second[is_base]
    i1, i2, j1, j2 = i[first], i[second], j[first], j[second]
    base, map_base = position[i2] - position[i1], index.position[j2] - index.position[j1]
    length, map_length = np.abs(base), np.abs(map_base)
    noise, variance = rates.position_error_m**2 + (rates.range_error_share * scorer.range_m) ** 2, index.variance_m2
    slack = SLACK_SIGMAS * np.sqrt(noise[i1] + noise[i2] + variance[j1] + variance[j2])
    fits = (np.abs(length - map_length) < slack) & (np.minimum(length, map_length) > MIN_BASE_M)
    rank = np.where(fits, value[first] + value[second] + BASE_WORTH * np.minimum(length, MAX_BASE_M), -np.inf)
    rows = np.sort(top_per_group(rank, place[first], MAX_HYPOTHESES))
    i1, i2, j1, j2 = i1[rows], i2[rows], j1[rows], j2[rows]
    turn = map_base[rows] * base[rows].conj()
    turn /= np.abs(turn)
    shift = (index.position[j1] + index.position[j2]) / 2 - turn * (position[i1] + position[i2]) / 2
    poses = Poses(index.place[j1], np.array([shift.real, shift.imag]).T, np.angle(turn))
    camera_offset = as_complex(index.cameras_m)[poses.place] - shift[:, None]
    poses = poses.take(np.flatnonzero(np.abs(camera_offset).min(1, initial=np.inf) < MAX_SHIFT_M))
    return poses.take(top_per_group(_support(scorer, i, j, poses), poses.place, max_poses))


def _support(scorer: PlaceLikelihood, i: np.ndarray, j: np.ndarray, poses: Poses) -> np.ndarray:
    """Return the contribution (C,) of the pairs of similar objects to the score of each pose.

    Pairs and poses are sorted by place. To save time, each pose is evaluated with the pairs of its place only, in
    single precision.
    """
    if not len(poses):
        return np.zeros(0)
    index, place = scorer.index, scorer.index.place[j]
    begin = starts(np.bincount(place, minlength=len(index)))
    count = np.diff(begin)[poses.place]
    pair = ranges(begin[poses.place], count)
    along, across = scorer.exponents
    columns = np.array([along[i, j], across[j], scorer.peak[i, j] + scorer.first_camera_logit[j]])
    origin = as_complex(index.cameras_m[:, 0])  # single precision needs coordinates near 0
    local = (index.position[j] - origin[place]).astype(np.complex64)
    shift = (as_complex(poses.shift_m) - origin[poses.place]).astype(np.complex64)
    rotated_ray = np.exp(1j * poses.yaw_rad).astype(np.complex64)[:, None] * scorer.ray.astype(np.complex64)
    node = (np.arange(len(poses)) * len(scorer.ray)).repeat(count) + i[pair]
    offset = (local[pair] - shift.repeat(count)) * rotated_ray.ravel().take(node).conj()
    along_m, across_m = offset.real - scorer.range_m.astype(np.float32)[i[pair]], offset.imag
    along, across, peak = columns.take(pair, 1)
    odds = np.exp(np.minimum(along_m * along_m * along + across_m * across_m * across + peak, 50))
    first = run_starts(node)
    explained = np.log1p(np.add.reduceat(odds, first))
    return Segments(np.bincount(node[first] // len(scorer.ray), minlength=len(poses))).sum(explained)
