"""The role `matcher`: matches the graph of a query with the graphs of a map
(docs/explanation/single-panoramas.md#matching-with-single-panoramas). A scene is the graph of one reference frame."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from salframe.framework.component import Role
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.table import MappedGraphs


@dataclass(frozen=True)
class GraphMatch:
    """A match of a query graph with a graph of the map.

    Attributes:
        scene: Index of the scene (the graph of one reference frame) in the map.
        score: Score of the match, larger is better.
        pairs: (M, 2) int64, index of the query node and index of the scene node of each matched pair.
        T_scene_query: (4, 4) pose of the query relative to the panorama of the scene; None for matchers that estimate
            no pose.
        scale: Factor from the ranges of the query to true ranges; 1 for matchers that estimate no scale.
    """

    scene: int
    score: float
    pairs: np.ndarray
    T_scene_query: np.ndarray | None = None
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class RankedGraphs:
    """Matches of a query graph with graphs of a map (scenes), without the matched nodes, best first.

    Attributes:
        scene: (T,) int64, indices of the scenes in the map.
        score: (T,) float64, larger is better.
        T_scene_query: (T, 4, 4) float64, as in GraphMatch, NaN for a match without a pose.
    """

    scene: np.ndarray
    score: np.ndarray
    T_scene_query: np.ndarray


class GraphMatcher(Role):
    """Finds the graphs of a map that are most similar to the graph of a query."""

    role = "matcher"
    uses_scene_index: ClassVar[bool] = False
    """Whether the matcher takes its candidates from a scene index (which selects the graphs of a large map that are
    matched). If the graphs have an open index (`GraphTable.scenes`), the matcher uses it."""

    @abstractmethod
    def index(self, graphs: Sequence[SaliencyGraph]) -> Any:
        """Return an index of these graphs: an object of any type, which is passed to `match`."""

    def write_index(self, graphs: Sequence[SaliencyGraph], folder: Path) -> None:
        """Write the index of these graphs to a new folder, for `open_index`.

        Optional; override it together with `open_index`. The default writes nothing.
        """

    def open_index(self, graphs: MappedGraphs, folder: Path) -> Any:
        """Return the same index as `index`, from packed graphs on disk.

        Args:
            graphs: The packed graphs.
            folder: Folder with the files of `write_index`, if it wrote any. It may be removed while the index is in
                use.
        """
        return self.index(list(graphs))

    @abstractmethod
    def match(self, query: SaliencyGraph, index: Any, top_k: int) -> list[GraphMatch]:
        """Return at most `top_k` matches, best first. Graphs without a matched object are left out.

        Args:
            query: Graph of the query. If it has no range, the sizes and centroids of its objects are NaN (see
                SaliencyGraph).
            index: The result of `index` or `open_index`.
            top_k: Maximum number of matches.
        """

    def rank(self, query: SaliencyGraph, index: Any, top_k: int) -> RankedGraphs:
        """Return the matches of `match` without their pairs.

        Optional: override it if computing the pairs takes time.
        """
        matches = self.match(query, index, top_k)
        poses = [np.full((4, 4), np.nan) if match.T_scene_query is None else match.T_scene_query for match in matches]
        return RankedGraphs(
            np.array([match.scene for match in matches], np.int64),
            np.array([match.score for match in matches], np.float64),
            np.array(poses, np.float64).reshape(-1, 4, 4),
        )
