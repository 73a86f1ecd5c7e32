"""Start poses of a query in each place, from two pairs of alike objects at the same distance."""

from __future__ import annotations

import numpy as np

from salframe.graphs.segments import Segments, pairs_within, ranges, run_starts, starts, top_per_group
from salframe_graphs.places.likelihood import PlaceLikelihood, Poses

MAX_PAIRS, MAX_HYPOTHESES = 40, 100
"""Maximum numbers of pairs of alike objects, and of hypotheses made of two pairs, in each place."""
MIN_LOG_RATIO = -2.0
"""Log ratio of label, height and size below which two objects make no pair."""
MIN_BASE_M, MAX_BASE_M, BASE_WORTH = 0.3, 4.0, 0.3
"""Distance below which two objects do not tell a heading, the distance above which more does not help, and the value of
a metre beside the log ratios of the pairs."""
MAX_SHIFT_M = 6.0
"""A query this far from every scene frame of a place was not taken in it."""
SLACK_SIGMAS = 2.0
"""Two distances differ when they are this many standard deviations apart."""


def best_poses(scorer: PlaceLikelihood, max_poses: int) -> Poses:
    """Return at most `max_poses` poses of each place, sorted by place, then best first.

    Two-point hypotheses are scored by all pairs of alike objects; each object of the place counts as if seen from the
    place's first camera.
    """
    index, xy_m, rates = scorer.index, scorer.xy_m, scorer.rates
    i, j = np.nonzero(scorer.same_label & (scorer.log_ratio > MIN_LOG_RATIO))
    worth, place = scorer.log_ratio[i, j], index.place[j]
    order = np.lexsort((j, i, place))
    if np.bincount(place, minlength=1).max() > MAX_PAIRS:
        order = order[np.sort(top_per_group(worth[order], place[order], MAX_PAIRS))]
    i, j, worth, place = i[order], j[order], worth[order], place[order]
    first, second = pairs_within(starts(np.bincount(place, minlength=len(index))))
    is_base = (i[first] != i[second]) & (j[first] != j[second])
    first, second = first[is_base], second[is_base]
    i1, i2, j1, j2 = i[first], i[second], j[first], j[second]
    base, map_base = xy_m[i2] - xy_m[i1], index.xy_m[j2] - index.xy_m[j1]
    length, map_length = np.hypot(*base.T), np.hypot(*map_base.T)
    noise, variance = rates.position_error_m**2 + (rates.range_error_share * scorer.range_m) ** 2, index.variance_m2
    slack = SLACK_SIGMAS * np.sqrt(noise[i1] + noise[i2] + variance[j1] + variance[j2])
    fits = (np.abs(length - map_length) < slack) & (np.minimum(length, map_length) > MIN_BASE_M)
    rank = np.where(fits, worth[first] + worth[second] + BASE_WORTH * np.minimum(length, MAX_BASE_M), -np.inf)
    chosen = np.sort(top_per_group(rank, place[first], MAX_HYPOTHESES))
    i1, i2, j1, j2, base, map_base = (values[chosen] for values in (i1, i2, j1, j2, base, map_base))
    yaw = np.arctan2(map_base[:, 1], map_base[:, 0]) - np.arctan2(base[:, 1], base[:, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    middle = (xy_m[i1] + xy_m[i2]) / 2
    turned = np.array([c * middle[:, 0] - s * middle[:, 1], s * middle[:, 0] + c * middle[:, 1]]).T
    shift = (index.xy_m[j1] + index.xy_m[j2]) / 2 - turned
    poses = Poses(index.place[j1], shift, yaw)
    away = index.cameras_m[poses.place] - shift[:, None]
    near = (away * away).sum(2).min(1, initial=np.inf) < MAX_SHIFT_M**2
    poses = poses.take(np.flatnonzero(near))
    return poses.take(top_per_group(_support(scorer, i, j, poses), poses.place, max_poses))


def _support(scorer: PlaceLikelihood, i: np.ndarray, j: np.ndarray, poses: Poses) -> np.ndarray:
    """The part of the score that pairs of alike objects bring under poses, (C,); both are sorted by place.

    Every pose is evaluated with the pairs of its place alone, in single precision: much of a query's time is spent
    here.
    """
    if not len(poses):
        return np.zeros(0)
    index, place = scorer.index, scorer.index.place[j]
    begin = starts(np.bincount(place, minlength=len(index)))
    count = np.diff(begin)[poses.place]
    pair = ranges(begin[poses.place], count)
    along, across = scorer.exponents
    columns = np.array([along[i, j], across[j], scorer.peak[i, j] + scorer.first_camera_logit[j]])
    origin = index.cameras_m[:, 0]  # single precision needs small numbers
    local = (index.xy_m[j] - origin[place]).astype(np.float32)
    shift = (poses.shift_m - origin[poses.place]).astype(np.float32)
    c, s = np.cos(poses.yaw_rad).astype(np.float32), np.sin(poses.yaw_rad).astype(np.float32)
    ray = scorer.ray.astype(np.float32)
    across_ray = np.array([-ray[:, 1], ray[:, 0]]).T
    turned = (c[:, None, None] * ray + s[:, None, None] * across_ray).reshape(-1, 2)
    node = (np.arange(len(poses)) * len(ray)).repeat(count) + i[pair]
    ray_x, ray_y = turned.take(node, 0).T
    x, y = local.T.take(pair, 1) - shift.T.repeat(count, axis=1)
    along, across, peak = columns.take(pair, 1)
    forth, side = x * ray_x + y * ray_y - scorer.range_m.astype(np.float32)[i[pair]], y * ray_x - x * ray_y
    odds = np.exp(np.minimum(forth * forth * along + side * side * across + peak, 50))
    first = run_starts(node)
    explained = np.log1p(np.add.reduceat(odds, first))
    return Segments(np.bincount(node[first] // len(ray), minlength=len(poses))).sum(explained)
