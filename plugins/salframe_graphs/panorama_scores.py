"""Scores of the reference frames of a map: a query graph is matched with the graph of each frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatcher
from salframe.graphs.packing import graph_from_arrays
from salframe.graphs.table import MappedGraphs
from salframe.localization.answers import NodeMatches
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe_graphs.agreement import add_agreement

_MATCHER = "matcher"
"""Name under which the index of the matcher is stored in the folder of the map's index."""


class PanoramaScoresConfig(ComponentConfig):
    """Settings of the comparison of a query with each single reference frame."""

    matcher: slot(  # type: ignore[valid-type]
        "matcher",
        "geometric",
        match_only=True,
        description="matcher, which compares the graph of a query with the graphs of the map",
    )
    top_k: int = match_only(
        20, ge=1, description="maximum number of graphs of the map that the matcher returns for a query, best first"
    )
    agreement: float = match_only(
        0.5,
        ge=0,
        description="weight of agreement between matches. Matches with different reference frames agree if they give "
        "similar poses of the query. The score of a match increases by this weight times the scores of the matches "
        "that agree with it; 0: no increase",
    )
    agreement_radius_m: float = match_only(
        1.5, gt=0, description="maximum distance (m) between the query poses of two matches that agree"
    )
    nearest_scene: bool = match_only(
        True,
        description="place of the best match, if its reference frame is in a doorway. true: the room of the "
        "reference frame that is nearest to the estimated pose, among those in rooms; false: the doorway. "
        "`saliency-graph` answers with this place. For `saliency-places`, the match is evidence for this place",
    )


class PanoramaScores:
    """A graph matcher on the graphs of the reference frames of a map.

    Attributes:
        graphs: The graphs, after `index` or `open_index`.
        labels: The labels of the graphs, after `index` or `open_index`.
        frames: The reference frames of the graphs, after `index` or `open_index`.
    """

    graphs: Sequence[SaliencyGraph]
    labels: frozenset[str]
    frames: Sequence[ReferenceFrame]

    def __init__(self, config: PanoramaScoresConfig) -> None:
        self._config = config
        self._matcher: GraphMatcher = registry().build("matcher", config.matcher)

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

    def place_scores(self, query: SaliencyGraph) -> dict[str, float]:
        """Return the best score of the reference frames of each place, by place name. Places without a match are
        omitted."""
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

    def _scene_near(self, matched: ReferenceFrame, T_world_query: np.ndarray) -> int | None:
        """Return the index of the scene frame nearest to a query whose match is a transition frame.

        None if the match is a scene frame, the pose is unknown, or the map has no scene frame.
        """
        is_doorway = matched.kind is FrameKind.TRANSITION and len(self._scenes_at)
        if not is_doorway or not np.isfinite(T_world_query).all():
            return None
        return int(self._scenes_at[self._scene_tree.query(T_world_query[:3, 3])[1]])
