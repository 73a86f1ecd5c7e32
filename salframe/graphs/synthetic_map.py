"""Synthetic maps of any size from the graphs of a few rooms. A scene is the graph of a room with changed furniture. A
query is a scene that a detector observes with errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from salframe.graphs.detections import unit_vectors
from salframe.graphs.graph import REACH_M, SaliencyGraph
from salframe.panoramas.geometry import pose_2d, transform_points

SCENE_MOVE_M, SCENE_MOVE_Z_M, SCENE_SIZE_LOG = 0.6, 0.08, 0.12
"""Standard deviations of the changes of an object from a room to a scene: along x and y (m), in height (m), and of the
logarithm of its size."""
SCENE_RELABEL_SHARE, SCENE_MISSING_SHARE = 0.1, 0.15
"""Share of a room's objects that get a random label in a scene, and share that is missing in the scene."""
QUERY_OFFSET_M, ERROR_M, ERROR_Z_M, ERROR_SIZE_LOG = 0.7, 0.1, 0.08, 0.15
"""Standard deviations for a query: its position along x and y relative to the scene (m), and the errors of the detector
along x and y (m), in height (m), and of the logarithm of a size."""
MISLABEL_SHARE, MISS_SHARE = 0.05, 0.2
"""Share of a scene's objects that get a random label in a query, and share that the detector misses."""


@dataclass(frozen=True)
class SyntheticMap:
    """A synthetic map of scenes 0, 1, 2, ... that are made from the rooms in turn.

    A scene depends only on the seed, the rooms and its number. It does not depend on the number of scenes.

    Attributes:
        seed: Seed of the random changes.
        rooms: Graphs of the rooms.
    """

    seed: int
    rooms: tuple[SaliencyGraph, ...]

    def scene(self, number: int) -> SaliencyGraph:
        """Return scene `number` of the map: the graph of a room with random changes."""
        rng = np.random.default_rng((self.seed, number, 0))
        room = self.rooms[number % len(self.rooms)]
        return self._resampled(
            room,
            rng,
            SCENE_MISSING_SHARE,
            SCENE_RELABEL_SHARE,
            (SCENE_MOVE_M, SCENE_MOVE_M, SCENE_MOVE_Z_M),
            SCENE_SIZE_LOG,
        )

    def scenes(self, count: int) -> Iterator[SaliencyGraph]:
        """Return an iterator over the first `count` scenes (graphs of the map)."""
        return (self.scene(number) for number in range(count))

    def query(self, number: int) -> SaliencyGraph:
        """Return the graph that a detector with errors observes of scene `number`, from a random position and
        heading."""
        rng = np.random.default_rng((self.seed, number, 1))
        spread_m = (ERROR_M, ERROR_M, ERROR_Z_M)
        observation = self._resampled(self.scene(number), rng, MISS_SHARE, MISLABEL_SHARE, spread_m, ERROR_SIZE_LOG)
        x_m, y_m = rng.normal(0, QUERY_OFFSET_M, 2).tolist()
        T_query_scene = pose_2d(x_m, y_m, rng.uniform(-np.pi, np.pi))
        turn = np.arctan2(T_query_scene[1, 0], T_query_scene[0, 0])
        centroid_m = transform_points(T_query_scene, observation.centroid_m)
        return replace(
            observation, centroid_m=centroid_m, yaw_rad=observation.yaw_rad + turn, bearing=unit_vectors(centroid_m)
        )

    @cached_property
    def labels(self) -> np.ndarray:
        """All labels of the rooms, (L,) str, sorted."""
        return np.unique([label for room in self.rooms for label in room.labels])

    def _resampled(
        self,
        graph: SaliencyGraph,
        rng: np.random.Generator,
        missing_share: float,
        relabel_share: float,
        spread_m: tuple[float, float, float],
        size_log: float,
    ) -> SaliencyGraph:
        """Return a graph with random changes: some objects are missing (at least one remains), some get a random label,
        and all are moved and resized."""
        present = rng.random(len(graph)) >= missing_share
        present[rng.integers(len(graph))] = True
        index = np.flatnonzero(present)
        names = np.where(
            rng.random(len(index)) < relabel_share, rng.choice(self.labels, len(index)), np.array(graph.labels)[index]
        )
        edges = graph.edges[present[graph.edges].all(1)]
        saliency = graph.saliency[index]
        return SaliencyGraph(
            tuple(names.tolist()),
            graph.scores[index],
            saliency / saliency.sum(),
            np.clip(graph.centroid_m[index] + rng.normal(0, spread_m, (len(index), 3)), -REACH_M, REACH_M),
            graph.size_m[index] * np.exp(rng.normal(0, size_log, (len(index), 3))),
            graph.yaw_rad[index],
            np.searchsorted(index, edges),
        )
