"""Initial poses of a query in each place. A pose follows from two pairs of a query object and a similar map object,
if the distance between the two query objects equals the distance between the two map objects."""

from __future__ import annotations

import numpy as np

from salframe.graphs.segments import Segments, pairs_within, ranges, run_starts, starts, top_per_group
from salframe.panoramas.geometry import as_complex
from salframe_graphs.places.likelihood import PlaceLikelihood
from salframe_graphs.places.observations import MAX_LOG_RATIO, PairPoints
from salframe_graphs.places.poses import PoseColumns, Poses

MAX_PAIRS, MAX_HYPOTHESES = 40, 100
"""Maximum number of pairs of similar objects in each place, and maximum number of hypotheses in each place. A
hypothesis consists of two pairs."""
MIN_LOG_RATIO = -2.0
"""Minimum log ratio of label, height and size of a pair of objects."""
MIN_BASE_M, MAX_BASE_M, BASE_WEIGHT = 0.3, 4.0, 0.3
"""Base: the distance between the two objects of a hypothesis. Minimum base (m), maximum base that increases the rank of
a hypothesis (m), and the value of one metre of base (in log ratio) when hypotheses are ranked."""
MAX_SHIFT_M = 6.0
"""Maximum distance in metres of a query from the nearest scene frame of its place."""
SLACK_SIGMAS = 2.0
"""Maximum difference, in standard deviations, of two distances that are considered equal."""
RAISED_SIGMAS = (-1.5, 0.0, 1.5)
"""Camera heights for which hypotheses are made if objects have no range. They are offsets from the expected height, in
standard deviations of the height."""


def best_poses(scorer: PlaceLikelihood, max_poses: int) -> Poses:
    """Return at most `max_poses` poses of each place, sorted by place, then best first.

    Each hypothesis gives one pose. Its score uses all pairs of similar objects of the place. The probability of
    detecting an object is approximated by the probability of detecting it from the place's first camera.
    """
    index = scorer.index
    i, j = np.nonzero(scorer.same_label & (scorer.log_ratio > MIN_LOG_RATIO))
    if not len(i):
        return Poses(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0))
    value, place = _points(scorer, i, j, 0.0).value, index.place[j]
    order = np.lexsort((j, i, place))
    if np.bincount(place, minlength=1).max() > MAX_PAIRS:
        order = order[np.sort(top_per_group(value[order], place[order], MAX_PAIRS))]
    i, j = i[order], j[order]
    first, second = pairs_within(starts(np.bincount(place[order], minlength=len(index))))
    is_base = (i[first] != i[second]) & (j[first] != j[second])
    first, second = first[is_base], second[is_base]
    heights_m = np.multiply(RAISED_SIGMAS, scorer.likelihood.camera_height_error_m) if scorer.has_bearings else [0.0]
    poses = Poses.concatenate(
        [_hypotheses(scorer, i, j, first, second, camera_height_offset_m) for camera_height_offset_m in heights_m]
    )
    poses = poses.take(np.argsort(poses.place, kind="stable"))
    return poses.take(top_per_group(_support(scorer, i, j, poses), poses.place, max_poses))


def _hypotheses(
    scorer: PlaceLikelihood,
    i: np.ndarray,
    j: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    camera_height_offset_m: float,
) -> Poses:
    """Return at most MAX_HYPOTHESES poses of each place, sorted by place.

    Args:
        scorer: The likelihood of the query.
        i: (P,) query object of each pair of similar objects.
        j: (P,) map object of each pair.
        first: (H,) index of the first pair of each hypothesis.
        second: (H,) index of the second pair of each hypothesis, in the same place.
        camera_height_offset_m: Height of the camera above its expected height, in metres.
    """
    index = scorer.index
    points, place = _points(scorer, i, j, camera_height_offset_m), index.place[j]
    map_point, variance = index.position[j], index.variance_m2[j]
    base, map_base = points.position[second] - points.position[first], map_point[second] - map_point[first]
    length, map_length = np.abs(base), np.abs(map_base)
    direction = base / np.maximum(length, 1e-9)
    error_m2 = sum(
        points.across_m2[row]
        + (points.along_m2 - points.across_m2)[row] * (direction * points.ray[row].conj()).real ** 2
        + variance[row]
        for row in (first, second)
    )
    scales = points.has_scale[first] & points.has_scale[second]
    scale_error = np.where(scales, scorer.likelihood.scale_error, 0.0)
    slack = SLACK_SIGMAS * np.sqrt(error_m2 + (scale_error * length) ** 2)
    fits = (np.abs(length - map_length) < slack) & (np.minimum(length, map_length) > MIN_BASE_M)
    rank = points.value[first] + points.value[second] + BASE_WEIGHT * np.minimum(map_length, MAX_BASE_M)
    rank -= np.where(scales, 0, 0.5 * (length - map_length) ** 2 / error_m2 + 0.5 * np.log(error_m2))
    rows = np.sort(top_per_group(np.where(fits, rank, -np.inf), place[first], MAX_HYPOTHESES))
    first, second, length = first[rows], second[rows], length[rows]
    turn = map_base[rows] * base[rows].conj()
    turn /= np.maximum(np.abs(turn), 1e-9)
    precision = scale_error[rows] ** 2 / error_m2[rows]  # of the lengths, relative to the prior of the scale
    scale = (1 + precision * length * map_length[rows]) / (1 + precision * length * length)
    middle = (points.position[first] + points.position[second]) / 2
    shift = (map_point[first] + map_point[second]) / 2 - scale * turn * middle
    shift_m = np.array([shift.real, shift.imag]).T
    poses = Poses(place[first], shift_m, np.angle(turn), np.full(len(shift), camera_height_offset_m), scale)
    camera_offset = as_complex(index.cameras_m)[poses.place] - shift[:, None]
    return poses.take(np.flatnonzero(np.abs(camera_offset).min(1, initial=np.inf) < MAX_SHIFT_M))


def _points(scorer: PlaceLikelihood, i: np.ndarray, j: np.ndarray, camera_height_offset_m: float) -> PairPoints:
    """Return the positions of query objects i (P,), each paired with one of the map objects j (P,).

    The camera is `camera_height_offset_m` metres above its expected height.
    """
    parts = scorer.rows_of(i)
    points = [part.pair_points(row, j[position], camera_height_offset_m) for part, position, row in parts]
    if len(points) == 1:
        return points[0]
    order = np.argsort(np.concatenate([np.arange(len(i))[position] for _, position, _ in parts]))
    return PairPoints.concatenate(points).take(order)


def _support(scorer: PlaceLikelihood, i: np.ndarray, j: np.ndarray, poses: Poses) -> np.ndarray:
    """Return the contribution (C,) of the pairs of similar objects to the score of each pose.

    Pairs and poses are sorted by place. To save time, each pose is evaluated with the pairs of its place only.
    """
    if not len(poses):
        return np.zeros(0)
    index, place = scorer.index, scorer.index.place[j]
    begin = starts(np.bincount(place, minlength=len(index)))
    count = np.diff(begin)[poses.place]
    pair = ranges(begin[poses.place], count)
    query_object, objects = i[pair], j[pair]
    relative = scorer.relative(poses, PoseColumns(objects, Segments(count)))
    log_odds = scorer.pair_log_odds(query_object, relative) + scorer.first_camera_logit[objects]
    odds = np.exp(np.minimum(log_odds, MAX_LOG_RATIO))
    num_objects = len(scorer.query)
    node = (np.arange(len(poses)) * num_objects).repeat(count) + query_object
    first = run_starts(node)
    explained = np.log1p(np.add.reduceat(odds, first))
    support = Segments(np.bincount(node[first] // num_objects, minlength=len(poses))).sum(explained)
    return support + scorer.log_prior(poses)
