"""The localizer `saliency-graph`: detector, saliency, graph, matcher and positioner in a row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from salframe.framework.columns import Columns
from salframe.framework.config import ComponentConfig, match_only
from salframe.framework.registry import registry
from salframe.framework.slots import slot
from salframe.graphs.graph import REACH_M, GraphConfig, SaliencyGraph, build_graph
from salframe.graphs.matcher import GraphMatch
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays, pack_graph, unpack_graph
from salframe.graphs.table import MappedGraphs
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches, RankedPlace
from salframe.localization.localizer import Description, Localizer, posterior_slot, range_slot, rank_places
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.frames import FrameKind, MapFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw, wrap_angle
from salframe.panoramas.panorama import Panorama
from salframe_graphs.agreement import agree

_MATCHER = "matcher"
"""What the matcher writes of a map, in the folder of its index."""


class SaliencyGraphLocalizer(Localizer):
    """Places as 360-degree saliency graphs: matched for the place, aligned for the pose."""

    name = "saliency-graph"
    version = "2"
    uses: ClassVar[frozenset[str]] = frozenset({"range"})

    class Config(ComponentConfig):
        range: range_slot()  # type: ignore[valid-type]
        detector: slot("detector", "auto")  # type: ignore[valid-type]
        saliency: slot("saliency", "volumetric")  # type: ignore[valid-type]
        graph: GraphConfig = GraphConfig.model_validate({})
        matcher: slot("matcher", "triplet", match_only=True)  # type: ignore[valid-type]
        positioner: slot(  # type: ignore[valid-type]
            "positioner",
            "robust",
            match_only=True,
            optional=True,
            description="pose from matched objects; null: place only, the pose of the map frame is the answer",
        )
        top_k: int = match_only(20, ge=1, description="map graphs that the matcher ranks")
        min_score: float = match_only(0.0, ge=0, description="a best match below this score is no answer")
        agreement: float = match_only(
            0.5,
            ge=0,
            description="share of the scores of matches that put the query in the same spot, added to a match's own",
        )
        agreement_radius_m: float = match_only(
            1.5, gt=0, description="distance in the world at which two matches no longer agree"
        )
        nearest_scene: bool = match_only(
            True, description="a match with a transition frame answers with the scene frame nearest to the pose"
        )
        posterior: posterior_slot()  # type: ignore[valid-type]

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._detector = registry().build("detector", self.config.detector)
        self._saliency = registry().build("saliency", self.config.saliency)
        self._matcher = registry().build("matcher", self.config.matcher)
        chosen = self.config.positioner
        self._positioner = None if chosen is None else registry().build("positioner", chosen)

    @property
    def needs(self) -> frozenset[str]:
        return self._detector.needs

    def graph(self, panorama: Panorama) -> SaliencyGraph:
        """The panorama's 360-degree saliency graph, of bearings only where it has no range."""
        detections = self._detector.detect(panorama)
        return build_graph(detections, self._saliency.score(detections), self.config.graph)

    def unfit_for_map(self, description: Description) -> str | None:
        if not graph_from_arrays(description).bearings_only:
            return None
        return (
            "it has no range; build the map from panoramas with range, only queries may lack it, "
            "or use the method 'objects', which needs labels alone"
        )

    def count_objects(self, description: Description) -> int:
        return len(description["labels"])

    def describe(self, panorama: Panorama) -> Description:
        return graph_to_arrays(self.graph(panorama))

    def index(self, descriptions: Sequence[Description], frames: Sequence[MapFrame]) -> None:
        self._graphs: Sequence[SaliencyGraph] = [graph_from_arrays(description) for description in descriptions]
        self._index = self._matcher.index(self._graphs)
        self._take_frames(frames, np.array([frame.kind is FrameKind.SCENE for frame in frames]))

    def write_index(self, folder: Path) -> None:
        folder.mkdir()
        self._matcher.write_index(self._graphs, folder / _MATCHER)

    def open_index(self, folder: Path, packed: Columns, frames: SavedFrames) -> None:
        self._graphs = graphs = MappedGraphs(packed)
        self._index = self._matcher.open_index(graphs, folder / _MATCHER)
        self._take_frames(frames, frames.is_scene)

    def match(self, description: Description) -> Localization:
        query = graph_from_arrays(description)
        if not len(query):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        matches = self._matcher.match(query, self._index, self.config.top_k)
        if not matches:
            return Localization((), None, LocalizationStatus.NO_MATCH)
        if matches[0].score < self.config.min_score:
            return Localization((), None, LocalizationStatus.LOW_SCORE)
        matches = self._agreed(matches)
        best = matches[0]
        T_world_scene = self._map_frames[best.scene].T_world_pano
        if self._positioner is None:
            return Localization(self._rank(matches), T_world_scene, LocalizationStatus.OK)
        nodes, reference = best.pairs[:, 0], self._graphs[best.scene]
        there = reference.centroid_m[best.pairs[:, 1]]
        if query.bearings_only:
            pose = self._positioner.resect(query.bearing[nodes], there)
        else:
            pose = self._positioner.solve(best.scale * query.centroid_m[nodes], there, query.saliency[nodes])
        if pose.T_reference_query is None:
            heading = None if pose.yaw_rad is None else float(wrap_angle(pose_yaw(T_world_scene) + pose.yaw_rad))
            return Localization(self._rank(matches), None, LocalizationStatus.NO_POSE, heading_rad=heading)
        T_world_query = T_world_scene @ pose.T_reference_query
        places = self._rank(matches, T_world_query if self.config.nearest_scene else None)
        covariance = None if pose.covariance is None else _in_world(pose.covariance, T_world_scene)
        return Localization(places, T_world_query, LocalizationStatus.OK, covariance)

    def _take_frames(self, frames: Sequence[MapFrame], is_scene: np.ndarray) -> None:
        """Lay out the map's frames (S), and which of them are scene frames."""
        self._map_frames, self._scenes_at = frames, np.flatnonzero(is_scene)
        if not is_scene.all():  # only doorways ask which scene frame is near
            from scipy.spatial import KDTree

            if isinstance(frames, SavedFrames):
                T_world_pano = frames.poses()
            else:
                T_world_pano = np.array([frame.T_world_pano[:3] for frame in frames])
            self._scene_tree = KDTree(T_world_pano[self._scenes_at, :, 3])

    def _agreed(self, matches: Sequence[GraphMatch]) -> Sequence[GraphMatch]:
        """Matches after their agreement, best first."""
        if not self.config.agreement:
            return matches
        return agree(matches, self._map_frames, self.config.agreement, self.config.agreement_radius_m)

    def _rank(self, matches: Sequence[GraphMatch], T_world_query: np.ndarray | None = None) -> tuple[RankedPlace, ...]:
        """As `rank_places` of all frames, of those that match and, where that counts, the scene nearest to the pose."""
        score = {match.scene: match.score for match in matches}
        best = min(score, key=lambda scene: (-score[scene], scene))
        near = None if T_world_query is None else self._scene_near(self._map_frames[best], T_world_query)
        if near is not None:
            score.setdefault(near, -np.inf)
        numbers = sorted(score)
        frames = [self._map_frames[number] for number in numbers]
        return rank_places(frames, np.array([score[number] for number in numbers]), T_world_query)

    def _scene_near(self, matched: MapFrame, T_world_query: np.ndarray) -> int | None:
        """The scene frame nearest to a query that matches a doorway; None where it matches another frame, its pose is
        not known, or the map has doorways only."""
        at_door = matched.kind is FrameKind.TRANSITION and len(self._scenes_at)
        if not at_door or not np.isfinite(T_world_query).all():
            return None
        return int(self._scenes_at[self._scene_tree.query(T_world_query[:3, 3])[1]])

    def correspond(self, query: Description, reference: Description) -> NodeMatches:
        """The node alignment of the two graphs, in a map of this one reference."""
        asked, known = graph_from_arrays(query), graph_from_arrays(reference)
        matches = self._matcher.match(asked, self._matcher.index([known]), 1)
        pairs = matches[0].pairs if matches else np.zeros((0, 2), int)
        return NodeMatches(asked.centroid_m, known.centroid_m, pairs)

    def note(self, description: Description) -> str | None:
        count = graph_from_arrays(description).out_of_reach
        return f"{count} object(s) further than {REACH_M} m left out" if count else None

    def pack(self, description: Description) -> Description:
        return pack_graph(description)

    def unpack(self, packed: Description) -> Description:
        return unpack_graph(packed)


def _in_world(covariance: np.ndarray, T_world_scene: np.ndarray) -> np.ndarray:
    """A covariance as in PoseEstimate, in the world's axes instead of a map frame's."""
    turn = np.eye(len(covariance))
    if len(covariance) == 6:
        turn[:3, :3] = turn[3:, 3:] = T_world_scene[:3, :3]
    else:
        turn[:2, :2] = pose_2d(0, 0, pose_yaw(T_world_scene))[:2, :2]
    return turn @ covariance @ turn.T  # type: ignore[no-any-return]
