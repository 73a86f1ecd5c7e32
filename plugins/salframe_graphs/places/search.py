"""The best pose of a query in each place, and the final pose of the answer (docs/explanation/places.md#pose)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from salframe.graphs.segments import Segments, top_per_group
from salframe_graphs.places.fitting import fit_step
from salframe_graphs.places.hypotheses import best_poses
from salframe_graphs.places.likelihood import PlaceLikelihood
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.poses import PoseColumns, Poses, RefinedPoses
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.rates import Likelihood, Rates
from salframe_graphs.sectors import Sectors

MAX_FIT_STEPS, CONVERGED_M = 6, 5e-4
"""Maximum number of reweighted fits of the final pose. Fitting stops earlier if a step moves the pose less than this
distance in metres."""
MIN_SHARE = 1e-7
"""Minimum probability that a query object is a map object. The final pose is fitted to such pairs only."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best pose of each of C places. Places without a pose are left out.

    Attributes:
        scorer: The likelihood of the query.
        poses: C poses, sorted by place.
        score: (C,) float64 score of each pose.
        refined: All poses of all places after refinement.
        best: (C,) index in `refined` of each pose.
    """

    scorer: PlaceLikelihood
    poses: Poses
    score: np.ndarray
    refined: RefinedPoses
    best: np.ndarray

    def share(self, row: int) -> np.ndarray:
        """Return the probability (n, m) that each query object is each object of the place, under pose `row`."""
        share = self.refined.share_of(int(self.best[row]))
        return self.scorer.score(self.poses.take(np.array([row])))[1] if share is None else share


@dataclass(frozen=True, eq=False)
class Ranking:
    """P ranked places of a query, best first.

    Attributes:
        names: (P,) index in MapPlaces.names of the name of each place.
        score: (P,) score of each place.
        pose_row: (P,) index in `poses` of the pose in each place; -1 for a place without a pose.
        poses: Poses of the query. Their place indices refer to all places of the map.
        search: Result of the search. Its poses are those of `poses`, but its place indices refer to the searched places
            only.
        evidence: The evidence for the first place, by name. Only evidence that the posterior uses.
    """

    names: np.ndarray
    score: np.ndarray
    pose_row: np.ndarray
    poses: Poses
    search: SearchResult
    evidence: Mapping[str, float] = field(default_factory=dict)


def search(
    query: QueryObjects,
    index: PlaceIndex,
    rates: Rates,
    likelihood: Likelihood,
    max_poses: int,
    sectors: Sectors | None = None,
    camera_height_m: float = np.nan,
) -> SearchResult:
    """Return the best pose of a query in each place of an index.

    Args:
        query: The objects of the query.
        index: The places.
        rates: Error rates of the detector.
        likelihood: Constants of the likelihood.
        max_poses: Maximum number of poses to refine in each place.
        sectors: Horizontal sectors that the query shows; None: all.
        camera_height_m: Height of the query's camera above the floor; NaN: unknown.
    """
    scorer = PlaceLikelihood(query, index, rates, likelihood, sectors, camera_height_m)
    refined = scorer.refine(best_poses(scorer, max_poses))
    best = top_per_group(refined.score, refined.poses.place, 1)
    return SearchResult(scorer, refined.poses.take(best), refined.score[best], refined, best)


def refine_final_pose(
    scorer: PlaceLikelihood, pose: Poses, share: np.ndarray, min_deviation_m: float
) -> tuple[Poses, np.ndarray]:
    """Fit one pose to the objects that it explains, by iteratively reweighted least squares.

    Args:
        scorer: Likelihood of the query in the places of an index.
        pose: One pose.
        share: (n, m) probability that each query object is each object of the pose's place.
        min_deviation_m: Standard deviation in metres. Its square is added to the variances of x and y.

    Returns:
        The fitted pose, and its first-order covariance (3, 3) over x, y and yaw in the world frame (m, rad).
    """
    i, j = np.nonzero(share > MIN_SHARE)
    share, objects = share[i, j].astype(np.float64), j + scorer.index.segments.start[pose.place[0]]
    columns = PoseColumns(objects, Segments(np.array([len(objects)])))
    of_first = np.zeros(len(i), int)
    for _ in range(MAX_FIT_STEPS):
        before_m = pose.shift_m
        pose, information = fit_step(scorer, pose, of_first, i, scorer.relative(pose, columns), share)
        if np.abs(pose.shift_m - before_m).max() < CONVERGED_M:
            break
    covariance = np.linalg.inv(information[0])[:3, :3] + np.diag([min_deviation_m**2, min_deviation_m**2, 0.0])
    return pose, covariance
