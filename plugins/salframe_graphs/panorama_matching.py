"""Matching of a query graph with the graph of each reference frame; the best match gives the place and the pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.component import match_only
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatch
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.positioner import Positioner
from salframe.localization.ranking import rank_places
from salframe.panoramas.geometry import pose_2d, pose_yaw, wrap_angle
from salframe_graphs.agreement import agree
from salframe_graphs.panorama_scores import PanoramaScores, PanoramaScoresConfig


class PanoramaMatchingConfig(PanoramaScoresConfig):
    """Settings of the comparison of a query with each single reference frame, and of its pose."""

    positioner: slot(  # type: ignore[valid-type]
        "positioner",
        "robust",
        match_only=True,
        optional=True,
        description="positioner, which estimates the pose of the query from matched objects; null: the answer has the "
        "pose of the reference frame",
    )
    min_score: float = match_only(
        0.0,
        ge=0,
        description="minimum score of the best match. If the score is lower, the answer names no place and has the "
        "status low-score",
    )


class PanoramaMatching(PanoramaScores):
    """A graph matcher and a positioner on the graphs of the reference frames of a map.

    Attributes:
        positioner: The positioner; None if the answer is the pose of the best reference frame.
    """

    def __init__(self, config: PanoramaMatchingConfig) -> None:
        super().__init__(config)
        self._min_score = config.min_score
        positioner = config.positioner
        self.positioner: Positioner | None = None if positioner is None else registry().build("positioner", positioner)

    @property
    def is_equivariant(self) -> bool:
        """Whether rotating the query panorama changes the estimated heading by the same angle. False without a
        positioner, because the answer then has the pose of a reference frame."""
        return self.positioner is not None and self.positioner.is_equivariant

    def localize(self, query: SaliencyGraph) -> Localization:
        """Return the ranked places of the best matches, and the pose that the best match gives."""
        if not len(query):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        matches: Sequence[GraphMatch] = self._matcher.match(query, self._index, self._config.top_k)
        if not matches:
            return Localization((), None, LocalizationStatus.NO_MATCH)
        if matches[0].score < self._min_score:
            return Localization((), None, LocalizationStatus.LOW_SCORE)
        if self._config.agreement:
            matches = agree(matches, self.frames, self._config.agreement, self._config.agreement_radius_m)
        best = matches[0]
        T_world_scene = self.frames[best.scene].T_world_pano
        if self.positioner is None:
            return Localization(self._rank(matches), T_world_scene, LocalizationStatus.OK)
        nodes, reference = best.pairs[:, 0], self.graphs[best.scene]
        reference_m = reference.centroid_m[best.pairs[:, 1]]
        if query.bearings_only:
            pose = self.positioner.resect(query.bearing[nodes], reference_m)
        else:
            pose = self.positioner.solve(best.scale * query.centroid_m[nodes], reference_m, query.saliency[nodes])
        if pose.T_reference_query is None:
            heading = None if pose.yaw_rad is None else float(wrap_angle(pose_yaw(T_world_scene) + pose.yaw_rad))
            return Localization(self._rank(matches), None, LocalizationStatus.NO_POSE, heading_rad=heading)
        T_world_query = T_world_scene @ pose.T_reference_query
        places = self._rank(matches, T_world_query if self._config.nearest_scene else None)
        covariance = None if pose.covariance is None else _in_world(pose.covariance, T_world_scene)
        return Localization(places, T_world_query, LocalizationStatus.OK, covariance)

    def _rank(self, matches: Sequence[GraphMatch], T_world_query: np.ndarray | None = None) -> tuple[RankedPlace, ...]:
        """Return the ranked places of the matching frames.

        If the best match is a transition frame and `T_world_query` is not None, the scene frame nearest to this pose is
        ranked too.
        """
        score = {match.scene: match.score for match in matches}
        best = min(score, key=lambda scene: (-score[scene], scene))
        nearest = None if T_world_query is None else self._scene_near(self.frames[best], T_world_query)
        if nearest is not None:
            score.setdefault(nearest, -np.inf)
        numbers = sorted(score)
        frames = [self.frames[number] for number in numbers]
        return rank_places(frames, np.array([score[number] for number in numbers]), T_world_query)


def _in_world(covariance: np.ndarray, T_world_scene: np.ndarray) -> np.ndarray:
    """Return the covariance of a PoseEstimate, rotated from the axes of the reference frame to the axes of the
    world."""
    turn = np.eye(len(covariance))
    if len(covariance) == 6:
        turn[:3, :3] = turn[3:, 3:] = T_world_scene[:3, :3]
    else:
        turn[:2, :2] = pose_2d(0, 0, pose_yaw(T_world_scene))[:2, :2]
    return turn @ covariance @ turn.T  # type: ignore[no-any-return]
