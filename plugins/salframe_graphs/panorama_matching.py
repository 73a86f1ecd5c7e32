"""Matching of a query graph with the graph of each reference frame; the best match gives the place and the pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatch, GraphMatcher
from salframe.graphs.packing import graph_from_arrays
from salframe.graphs.table import MappedGraphs
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches, RankedPlace
from salframe.localization.positioner import Positioner
from salframe.localization.ranking import rank_places
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw, wrap_angle
from salframe_graphs.agreement import add_agreement, agree

_MATCHER = "matcher"
"""Name of the matcher's files in the folder of the index."""


class PanoramaMatchingConfig(ComponentConfig):
    """Settings of the matching of a query with each reference frame."""

    matcher: slot("matcher", "geometric", match_only=True, description="graph matcher")  # type: ignore[valid-type]
    positioner: slot(  # type: ignore[valid-type]
        "positioner",
        "robust",
        match_only=True,
        optional=True,
        description="positioner, which estimates the query pose from matched objects; null: the answer has the "
        "pose of the reference frame",
    )
    top_k: int = match_only(20, ge=1, description="maximum number of graphs that the matcher returns")
    min_score: float = match_only(
        0.0, ge=0, description="minimum score of the best match; with a lower score, the query has no answer"
    )
    agreement: float = match_only(
        0.5,
        ge=0,
        description="weight of agreeing matches (other reference frames that give a similar query pose), whose "
        "scores are added to the score of a match; 0: scores are not added",
    )
    agreement_radius_m: float = match_only(
        1.5, gt=0, description="maximum distance (m) between the query poses of two agreeing matches"
    )
    nearest_scene: bool = match_only(
        True,
        description="true: if the best match is a transition frame (doorway), the answer is the nearest scene "
        "frame; false: the transition frame itself",
    )


class PanoramaMatching:
    """A graph matcher and a positioner on the graphs of the reference frames of a map.

    Attributes:
        positioner: The positioner; None where the answer is the pose of the best reference frame.
        graphs: The graphs, after `index` or `open_index`.
        labels: The labels of the graphs, after `index` or `open_index`.
        frames: The reference frames of the graphs, after `index` or `open_index`.
    """

    graphs: Sequence[SaliencyGraph]
    labels: frozenset[str]
    frames: Sequence[ReferenceFrame]

    def __init__(self, config: PanoramaMatchingConfig) -> None:
        self._config = config
        self._matcher: GraphMatcher = registry().build("matcher", config.matcher)
        positioner = config.positioner
        self.positioner: Positioner | None = None if positioner is None else registry().build("positioner", positioner)

    @property
    def is_equivariant(self) -> bool:
        """Whether the pose turns with the panorama of the query. Without a positioner it does not: the answer then has
        the pose of a reference frame."""
        return self.positioner is not None and self.positioner.is_equivariant

    @property
    def estimates_scale(self) -> bool:
        """Whether the matcher assumes that the query's ranges have an unknown scale error."""
        return self._matcher.estimates_scale

    def index(self, graphs: Sequence[SaliencyGraph], frames: Sequence[ReferenceFrame]) -> None:
        """Index the graphs of the reference frames."""
        self.graphs, self._index = graphs, self._matcher.index(graphs)
        self.labels = frozenset(label for graph in graphs for label in graph.labels)
        self._take_frames(frames, np.array([frame.kind is FrameKind.SCENE for frame in frames]))

    def write_index(self, folder: Path) -> None:
        """Write the index of the graphs to a new folder."""
        folder.mkdir()
        self._matcher.write_index(self.graphs, folder / _MATCHER)

    def open_index(self, folder: Path, graphs: MappedGraphs, frames: SavedFrames) -> None:
        """Open the index that `write_index` wrote for these graphs."""
        self.graphs, self._index = graphs, self._matcher.open_index(graphs, folder / _MATCHER)
        self.labels = frozenset(graphs.labels)
        self._take_frames(frames, frames.is_scene)

    def _take_frames(self, frames: Sequence[ReferenceFrame], is_scene: np.ndarray) -> None:
        self.frames, self._scenes_at = frames, np.flatnonzero(is_scene)
        if not is_scene.all():  # the nearest scene frame is only needed on maps with transition frames
            from scipy.spatial import KDTree

            if isinstance(frames, SavedFrames):
                T_world_pano = frames.poses()
            else:
                T_world_pano = np.array([frame.T_world_pano[:3] for frame in frames])
            self._scene_tree = KDTree(T_world_pano[self._scenes_at, :, 3])

    def localize(self, query: SaliencyGraph) -> Localization:
        """Return the ranked places of the best matches, and the pose by the best one."""
        if not len(query):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        matches: Sequence[GraphMatch] = self._matcher.match(query, self._index, self._config.top_k)
        if not matches:
            return Localization((), None, LocalizationStatus.NO_MATCH)
        if matches[0].score < self._config.min_score:
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

    def place_scores(self, query: SaliencyGraph) -> dict[str, float]:
        """Return for each place with a match the best score of its reference frames."""
        ranked = self._matcher.rank(query, self._index, self._config.top_k)
        if not len(ranked.scene):
            return {}
        frames = [self.frames[scene] for scene in ranked.scene.tolist()]
        T_world_query = np.array([frame.T_world_pano for frame in frames]) @ ranked.T_scene_query
        score = ranked.score
        if self._config.agreement:
            score = add_agreement(score, T_world_query, self._config.agreement, self._config.agreement_radius_m)
        best = int(np.argmax(score))
        if self._config.nearest_scene:
            nearest = self._scene_near(frames[best], T_world_query[best])
            if nearest is not None:
                frames[best] = self.frames[nearest]  # a transition frame is not an answer
        scores: dict[str, float] = {}
        for frame, value in zip(frames, score.tolist(), strict=True):
            scores[frame.place] = max(value, scores.get(frame.place, value))
        return scores

    def correspond(self, query: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]) -> NodeMatches:
        """Return the node alignment of two graphs, as if `reference` were the only frame of the map."""
        query_graph, map_graph = graph_from_arrays(query), graph_from_arrays(reference)
        matches = self._matcher.match(query_graph, self._matcher.index([map_graph]), 1)
        pairs = matches[0].pairs if matches else np.zeros((0, 2), int)
        return NodeMatches(query_graph.centroid_m, map_graph.centroid_m, pairs)

    def _rank(self, matches: Sequence[GraphMatch], T_world_query: np.ndarray | None = None) -> tuple[RankedPlace, ...]:
        """Return the ranked places of the matching frames and, if needed, of the scene frame nearest to the pose."""
        score = {match.scene: match.score for match in matches}
        best = min(score, key=lambda scene: (-score[scene], scene))
        nearest = None if T_world_query is None else self._scene_near(self.frames[best], T_world_query)
        if nearest is not None:
            score.setdefault(nearest, -np.inf)
        numbers = sorted(score)
        frames = [self.frames[number] for number in numbers]
        return rank_places(frames, np.array([score[number] for number in numbers]), T_world_query)

    def _scene_near(self, matched: ReferenceFrame, T_world_query: np.ndarray) -> int | None:
        """Return the number of the scene frame nearest to a query whose match is a transition frame.

        None where the match is a scene frame, the pose is unknown, or the map has no scene frame.
        """
        is_doorway = matched.kind is FrameKind.TRANSITION and len(self._scenes_at)
        if not is_doorway or not np.isfinite(T_world_query).all():
            return None
        return int(self._scenes_at[self._scene_tree.query(T_world_query[:3, 3])[1]])


def _in_world(covariance: np.ndarray, T_world_scene: np.ndarray) -> np.ndarray:
    """Return the covariance of a PoseEstimate, rotated from the axes of the reference frame to the axes of the
    world."""
    turn = np.eye(len(covariance))
    if len(covariance) == 6:
        turn[:3, :3] = turn[3:, 3:] = T_world_scene[:3, :3]
    else:
        turn[:2, :2] = pose_2d(0, 0, pose_yaw(T_world_scene))[:2, :2]
    return turn @ covariance @ turn.T  # type: ignore[no-any-return]
