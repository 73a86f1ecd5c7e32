"""Compare the matches of two panoramas with their ranges, annotations and true poses."""

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
"""Unit of the errors of points in radians: the width of a pixel of a panorama that is 1024 pixels wide."""
RANGE_TOLERANCE = 0.05
"""Relative difference of ranges above which a point is occluded in the reference."""
NODE_RADIUS_M = 0.5
"""Maximum distance between a node (object of a graph) and the centroid of the annotated object that it represents."""


def check_matches(
    matches: PointMatches | NodeMatches, query: Panorama, reference: Panorama, T_reference_query: np.ndarray
) -> Row:
    """Return the counts of a pair of panoramas as a row.

    Keys: "kind" ("points" or "nodes") and "matches" (number of matches). For points also "judged" (number of matches
    that can be judged) and "within_px" (number of these within each of THRESHOLDS_PX). For nodes also "correct" (number
    of matches of the same object) and "true" (number of objects that are nodes of both graphs). Raises InputMissing
    if a panorama lacks range or annotations.
    """
    if isinstance(matches, PointMatches):
        errors_px = point_errors_px(matches, query, reference, T_reference_query)
        within = [int((errors_px <= threshold).sum()) for threshold in THRESHOLDS_PX]
        return {"kind": "points", "matches": len(matches.query), "judged": len(errors_px), "within_px": within}
    query_objects, reference_objects = (
        objects_of_nodes(matches.query_m, query),
        objects_of_nodes(matches.reference_m, reference),
    )
    matched = query_objects[matches.pairs[:, 0]]
    correct = int(((matched > 0) & (matched == reference_objects[matches.pairs[:, 1]])).sum())
    return {
        "kind": "nodes",
        "matches": len(matches.pairs),
        "correct": correct,
        "true": len(np.intersect1d(query_objects[query_objects > 0], reference_objects[reference_objects > 0])),
    }


def point_errors_px(
    matches: PointMatches, query: Panorama, reference: Panorama, T_reference_query: np.ndarray
) -> np.ndarray:
    """Return the errors (K,) float64 of the K matches that can be judged, as great-circle angles in units of PIXEL_RAD.

    A point of the query is placed at its range and transformed by the true pose (4, 4). Its error is the angle between
    the result and the matched bearing. Points without range and points that are occluded in the reference (see
    RANGE_TOLERANCE) are left out. Raises InputMissing without ranges.
    """
    if query.range_m is None or reference.range_m is None:
        raise InputMissing(
            f"the panorama {query.id if query.range_m is None else reference.id} has no range image, which the check "
            "of matches needs"
        )
    range_m = sample_nearest(query.range_m, matches.query)
    points_m = transform_points(T_reference_query, matches.query * range_m[:, None])
    expected_m = np.linalg.norm(points_m, axis=1)
    with np.errstate(invalid="ignore"):  # comparisons with an unknown range are false
        visible = np.isfinite(expected_m)
        visible[visible] = (
            np.abs(sample_nearest(reference.range_m, points_m[visible]) - expected_m[visible])
            <= RANGE_TOLERANCE * expected_m[visible]
        )
    points_m, bearings = points_m[visible], matches.reference[visible]
    angle = np.arctan2(np.linalg.norm(np.cross(points_m, bearings), axis=1), (points_m * bearings).sum(1))
    return angle / PIXEL_RAD


def objects_of_nodes(centroid_m: np.ndarray, panorama: Panorama) -> np.ndarray:
    """Return the instance ids (N,) int64 of the annotated objects that belong to nodes at positions (N, 3); 0 for none.

    The position of an object is the centroid of its visible points. The assignment is one to one and maximizes the
    total closeness. Nodes and objects that are more than NODE_RADIUS_M apart are not paired. Raises InputMissing if the
    panorama has no instance image or no range.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    if panorama.annotations is None or panorama.annotations.instance_id is None:
        raise InputMissing(
            f"the panorama {panorama.id} has no instance image, which the check of matched objects needs"
        )
    objects = annotated_objects(panorama)
    owner_m = np.array([one.points_m.mean(0, dtype=np.float64) for one in objects]).reshape(-1, 3)
    closeness = np.nan_to_num(np.maximum(NODE_RADIUS_M - cdist(centroid_m, owner_m), 0))  # NaN: unknown position
    nodes, owners = linear_sum_assignment(closeness, maximize=True)
    near = closeness[nodes, owners] > 0
    object_ids = np.zeros(len(centroid_m), np.int64)
    object_ids[nodes[near]] = np.array([one.key for one in objects], np.int64)[owners[near]]
    return object_ids
