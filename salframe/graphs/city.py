"""Maps of any size, made of the graphs of a few rooms: scenes are rooms furnished anew, queries are scenes seen
again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from salframe.graphs.detections import unit_vectors
from salframe.graphs.graph import REACH_M, SaliencyGraph
from salframe.panoramas.geometry import pose_2d, transform_points

MOVED_M, RAISED_M, RESIZED_LOG = 0.6, 0.08, 0.12
"""Standard deviations of what furnishes a scene anew: along x and y, in height, and of log sizes."""
RENAMED, MISSING = 0.1, 0.15
"""Shares of a room's objects that a scene has under another name, or does not have."""
SHIFT_M, SEEN_M, SEEN_RAISED_M, SEEN_RESIZED_LOG = 0.7, 0.1, 0.08, 0.15
"""Standard deviations of a query: where it stands along x and y, and its detector's errors."""
MISNAMED, UNSEEN = 0.05, 0.2
"""Shares of a scene's objects that a query has under another name, or does not see."""


@dataclass(frozen=True)
class City:
    """Scenes 0, 1, 2, ... of rooms taken in turn. Each is the same in every city of its seed, however many are made."""

    seed: int
    rooms: tuple[SaliencyGraph, ...]

    def scene(self, number: int) -> SaliencyGraph:
        """A scene of the map."""
        rng = np.random.default_rng((self.seed, number, 0))
        room = self.rooms[number % len(self.rooms)]
        return self._resampled(room, rng, MISSING, RENAMED, (MOVED_M, MOVED_M, RAISED_M), RESIZED_LOG)

    def scenes(self, count: int) -> Iterator[SaliencyGraph]:
        """The first scenes, one after the other."""
        return (self.scene(number) for number in range(count))

    def query(self, number: int) -> SaliencyGraph:
        """A scene seen again by a detector, from elsewhere and turned."""
        rng = np.random.default_rng((self.seed, number, 1))
        spread_m = (SEEN_M, SEEN_M, SEEN_RAISED_M)
        seen = self._resampled(self.scene(number), rng, UNSEEN, MISNAMED, spread_m, SEEN_RESIZED_LOG)
        x_m, y_m = rng.normal(0, SHIFT_M, 2).tolist()
        moved = pose_2d(x_m, y_m, rng.uniform(-np.pi, np.pi))
        turn = np.arctan2(moved[1, 0], moved[0, 0])
        centroid_m = transform_points(moved, seen.centroid_m)
        return replace(seen, centroid_m=centroid_m, yaw_rad=seen.yaw_rad + turn, bearing=unit_vectors(centroid_m))

    @cached_property
    def labels(self) -> np.ndarray:
        """(L,) all names, sorted."""
        return np.unique([label for room in self.rooms for label in room.labels])

    def _resampled(
        self,
        graph: SaliencyGraph,
        rng: np.random.Generator,
        missing: float,
        renamed: float,
        spread_m: tuple[float, float, float],
        resized_log: float,
    ) -> SaliencyGraph:
        """A graph with objects missing, at least one left, others renamed, and all of them moved and resized."""
        present = rng.random(len(graph)) >= missing
        present[rng.integers(len(graph))] = True
        kept = np.flatnonzero(present)
        names = np.where(
            rng.random(len(kept)) < renamed, rng.choice(self.labels, len(kept)), np.array(graph.labels)[kept]
        )
        edges = graph.edges[present[graph.edges].all(1)]
        saliency = graph.saliency[kept]
        return SaliencyGraph(
            tuple(names.tolist()),
            graph.scores[kept],
            saliency / saliency.sum(),
            np.clip(graph.centroid_m[kept] + rng.normal(0, spread_m, (len(kept), 3)), -REACH_M, REACH_M),
            graph.size_m[kept] * np.exp(rng.normal(0, resized_log, (len(kept), 3))),
            graph.yaw_rad[kept],
            np.searchsorted(kept, edges),
        )
