"""The role `matcher`: a query graph among the graphs of a map (docs/explanation/method.md#from-graph-to-panorama)."""

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
    """A map graph's claim to be the query's place: index of the scene, score (larger is better), pairs (M, 2) int64 of
    query and map nodes.

    Matchers that verify geometry give the pose that did: T_scene_query (4, 4), the query's frame in the reference frame's, or
    None; and scale, the factor that puts the query's ranges right, where they do not take them to be.
    """

    scene: int
    score: float
    pairs: np.ndarray
    T_scene_query: np.ndarray | None = None
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class RankedGraphs:
    """What matches claim without their pairs, best first: scene (T,) int64, score (T,) float64, T_scene_query (T, 4, 4)
    float64, NaN of a match without a pose."""

    scene: np.ndarray
    score: np.ndarray
    T_scene_query: np.ndarray


class GraphMatcher(Role):
    """Finds a query graph among the graphs of a map."""

    role = "matcher"
    uses_scene_index: ClassVar[bool] = False
    """Whether it takes candidates from a scene index: that of the graphs (`GraphTable.scenes`) where they have one."""

    @property
    def estimates_scale(self) -> bool:
        """Whether it takes all of a query's ranges to be off by one unknown factor, so that the query's positions are
        not in metres."""
        return False

    @abstractmethod
    def index(self, graphs: Sequence[SaliencyGraph]) -> Any:
        """Whatever makes matching against these graphs fast; handed back to `match`."""

    def write_index(self, graphs: Sequence[SaliencyGraph], folder: Path) -> None:
        """Write to a new folder what it takes to match against these graphs without `index`: an option, to be taken
        together with `open_index`. Unless overridden, nothing."""

    def open_index(self, graphs: MappedGraphs, folder: Path) -> Any:
        """As `index` of the same graphs, which lie on disk as packed, with what `write_index` wrote of them, if
        anything. `folder` may be removed while the index is in use."""
        return self.index(list(graphs))

    @abstractmethod
    def match(self, query: SaliencyGraph, index: Any, top_k: int) -> list[GraphMatch]:
        """At most `top_k` matches, best first; none where the query shares nothing with any graph. A query may have
        bearings only (SaliencyGraph); a map's graphs have range."""

    def rank(self, query: SaliencyGraph, index: Any, top_k: int) -> RankedGraphs:
        """As `match`, for those who do not ask for pairs: an option, where that takes less time."""
        matches = self.match(query, index, top_k)
        poses = [np.full((4, 4), np.nan) if match.T_scene_query is None else match.T_scene_query for match in matches]
        return RankedGraphs(
            np.array([match.scene for match in matches], np.int64),
            np.array([match.score for match in matches], np.float64),
            np.array(poses, np.float64).reshape(-1, 4, 4),
        )
