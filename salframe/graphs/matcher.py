"""The role `matcher`: a query graph among the graphs of a map (method.md 3)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from salframe.framework.component import Role
from salframe.graphs.graph import SaliencyGraph


@dataclass(frozen=True)
class GraphMatch:
    """A map graph's claim to be the query's place: index of the scene, score (larger is better), pairs (M, 2) int64 of
    query and map nodes.

    Matchers that verify geometry give the pose that did: T_scene_query (4, 4), the query's frame in the map frame's, or
    None; and scale, the factor that puts the query's ranges right, where they do not take them to be.
    """

    scene: int
    score: float
    pairs: np.ndarray
    T_scene_query: np.ndarray | None = None
    scale: float = 1.0


class GraphMatcher(Role):
    """Finds a query graph among the graphs of a map."""

    role = "matcher"

    @abstractmethod
    def index(self, graphs: Sequence[SaliencyGraph]) -> Any:
        """Whatever makes matching against these graphs fast; handed back to `match`."""

    @abstractmethod
    def match(self, query: SaliencyGraph, index: Any, top_k: int) -> list[GraphMatch]:
        """At most `top_k` matches, best first; none where the query shares nothing with any graph. A query may have
        bearings only (SaliencyGraph); a map's graphs have range."""
