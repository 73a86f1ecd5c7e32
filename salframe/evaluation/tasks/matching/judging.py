"""Matches of two panoramas against their ranges, annotations and true poses."""

from __future__ import annotations

import numpy as np

from salframe.evaluation.runs.rows import Row
from salframe.framework.errors import InputMissing
from salframe.graphs.annotated import annotated_objects
from salframe.localization.answers import NodeMatches, PointMatches
from salframe.panoramas.geometry import sample_nearest, transform_points
from salframe.panoramas.panorama import Panorama

THRESHOLDS_PX = (1, 3, 5)
PIXEL_RAD = 2 * np.pi / 1024
"""Errors of points are great-circle angles in pixels of a panorama 1024 pixels wide, whatever its own width."""
RANGE_TOLERANCE = 0.05
"""A point is hidden from the reference where the reference sees something at another range, by more than this share."""
NODE_RADIUS_M = 0.5
"""A node belongs to no object whose centroid is further away."""


def check_matches(
    found: PointMatches | NodeMatches, query: Panorama, reference: Panorama, T_reference_query: np.ndarray
) -> Row:
    """What is counted of a pair: "kind", "matches", and for points "judged" and "within_px", a number for each of
    THRESHOLDS_PX; for nodes "correct" and "true", the objects that are nodes of both graphs. Raises InputMissing where
    a panorama lacks what tells.
    """
    if isinstance(found, PointMatches):
        errors_px = point_errors_px(found, query, reference, T_reference_query)
        within = [int((errors_px <= threshold).sum()) for threshold in THRESHOLDS_PX]
        return {"kind": "points", "matches": len(found.query), "judged": len(errors_px), "within_px": within}
    seen, known = own_objects(found.query_m, query), own_objects(found.reference_m, reference)
    matched = seen[found.pairs[:, 0]]
    correct = int(((matched > 0) & (matched == known[found.pairs[:, 1]])).sum())
    return {
        "kind": "nodes",
        "matches": len(found.pairs),
        "correct": correct,
        "true": len(np.intersect1d(seen[seen > 0], known[known > 0])),
    }


def point_errors_px(
    matches: PointMatches, query: Panorama, reference: Panorama, T_reference_query: np.ndarray
) -> np.ndarray:
    """(K,) float64 errors of the K matches that can be judged, great-circle angles in pixels of PIXEL_RAD.

    A query's point is lifted by the range seen there and moved by the true pose (4, 4); its error is the angle between
    that and the matched bearing. Left out are points without range and points that the reference does not see,
    RANGE_TOLERANCE. Raises InputMissing without ranges.
    """
    if query.range_m is None or reference.range_m is None:
        raise InputMissing(
            f"{query.id if query.range_m is None else reference.id} has no range, by which matches are judged"
        )
    range_m = sample_nearest(query.range_m, matches.query)
    points_m = transform_points(T_reference_query, matches.query * range_m[:, None])
    expected_m = np.linalg.norm(points_m, axis=1)
    with np.errstate(invalid="ignore"):  # comparisons with an unknown range are false
        seen = np.isfinite(expected_m)
        seen[seen] = (
            np.abs(sample_nearest(reference.range_m, points_m[seen]) - expected_m[seen])
            <= RANGE_TOLERANCE * expected_m[seen]
        )
    points_m, bearings = points_m[seen], matches.reference[seen]
    angle = np.arctan2(np.linalg.norm(np.cross(points_m, bearings), axis=1), (points_m * bearings).sum(1))
    return angle / PIXEL_RAD


def own_objects(centroid_m: np.ndarray, panorama: Panorama) -> np.ndarray:
    """(N,) int64 instance ids of the annotated objects that nodes (N, 3) stand for, 0 for none.

    An object lies where a detector without error sees it. One to one, the most closeness in all, no pair further than
    NODE_RADIUS_M. Raises InputMissing where the panorama has no instance image or no range.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    if panorama.annotations is None or panorama.annotations.instance_id is None:
        raise InputMissing(f"{panorama.id} has no instance image, by which matched objects are judged")
    objects = annotated_objects(panorama)
    owner_m = np.array([one.points_m.mean(0, dtype=np.float64) for one in objects]).reshape(-1, 3)
    closeness = np.nan_to_num(np.maximum(NODE_RADIUS_M - cdist(centroid_m, owner_m), 0))  # NaN: not known where
    nodes, owners = linear_sum_assignment(closeness, maximize=True)
    near = closeness[nodes, owners] > 0
    own = np.zeros(len(centroid_m), np.int64)
    own[nodes[near]] = np.array([one.key for one in objects], np.int64)[owners[near]]
    return own
