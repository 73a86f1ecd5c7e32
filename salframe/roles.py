"""The roles a plugin can fill: abstract classes, one verb each."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from salframe.component import Component
from salframe.errors import InputMissing
from salframe.localizer import Localizer
from salframe.types import (
    Detections,
    FloorMasks,
    Fold,
    GraphMatch,
    Panorama,
    PoseEstimate,
    Route,
    SaliencyGraph,
    TopologicalMap,
    Truth,
)

if TYPE_CHECKING:
    from salframe.navigation.world import World

__all__ = [
    "ROLES", "Component", "Dataset", "Detector", "Engine", "GraphMatcher", "Localizer", "Planner", "Positioner", "SaliencyModel", "Scorer",
]


class Dataset(Component):
    """Panoramas with poses for mapping, panoramas without for queries, and the truth that only the evaluator asks for."""

    role = "dataset"

    @property
    @abstractmethod
    def provides(self) -> frozenset[str]:
        """Which of "rgb", "range", "annotations" its panoramas have."""

    @property
    @abstractmethod
    def fingerprint(self) -> str:
        """Changes whenever any frame's content or any truth does; part of every cache key."""

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Do what takes long and can be resumed (render, index) before the first fold; `progress(done, total)`."""

    @abstractmethod
    def folds(self) -> Sequence[Fold]:
        """Each fold: mapping frames with poses and query frames without. Most sets have one, leave-one-out has many."""

    @abstractmethod
    def truth(self, query_id: str) -> Truth:
        """The pose and place of a query. Only the evaluator calls it."""

    def floors(self) -> Sequence[FloorMasks]:
        """The floors seen from above; none where the set has no masks."""
        return ()

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """The panorama that a query would show at this pose (4, 4), for data sets that can render. Raises InputMissing in those that cannot."""
        raise InputMissing(f"{self.name} cannot render: it has panoramas at its own frames only")

    def worlds(self) -> Sequence[World]:
        """Where an agent can navigate: here the floors of a data set that can render. Raises InputMissing in those that cannot."""
        from salframe.navigation.world import floor_worlds

        if type(self).observe is Dataset.observe:
            raise InputMissing(f"{self.name} cannot render, and navigation needs panoramas from wherever the agent stands")
        return floor_worlds(self)


class Detector(Component):
    """Finds objects in a panorama."""

    role = "detector"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb", "range"})
    column_step: ClassVar[int] = 1
    """Turning the panorama by a multiple of this many columns turns the objects and nothing else; by others, 95 % of them within 2 degrees."""
    turn_tolerance_m: ClassVar[float] = 1e-4
    """How far a centroid may move (metres) and a size change when the panorama turns by a multiple of `column_step`."""

    @abstractmethod
    def detect(self, panorama: Panorama) -> Detections:
        """The objects of a panorama, in its frame. Must not change its input; the same input gives the same output."""


class SaliencyModel(Component):
    """Scores how much an object stands out."""

    role = "saliency"

    @abstractmethod
    def score(self, detections: Detections) -> np.ndarray:
        """(N,) float64, a share: non-negative, summing to 1 where there is any object."""


class GraphMatcher(Component):
    """Finds a query graph among the graphs of a map."""

    role = "matcher"

    @abstractmethod
    def index(self, graphs: Sequence[SaliencyGraph]) -> Any:
        """Whatever makes matching against these graphs fast; handed back to `match`."""

    @abstractmethod
    def match(self, query: SaliencyGraph, index: Any, top_k: int) -> list[GraphMatch]:
        """At most `top_k` matches, best first; none where the query shares nothing with any graph."""


class Positioner(Component):
    """Estimates where one graph's frame lies in another's from matched nodes."""

    role = "positioner"

    @abstractmethod
    def solve(self, query_m: np.ndarray, reference_m: np.ndarray, weights: np.ndarray | None = None) -> PoseEstimate:
        """Pose of the query frame in the reference frame from matched points query_m, reference_m (M, 3) and weights (M,) or None (equal)."""


class Planner(Component):
    """Plans routes on a topological map."""

    role = "planner"

    @abstractmethod
    def prepare(self, map: TopologicalMap) -> None:
        """Take a map in; called once before `route`."""

    @abstractmethod
    def route(self, start: str, goal: str) -> Route:
        """The shortest route between two nodes. Raises NoRoute."""


class Scorer(Component):
    """Scores answers that some other program gave to a published task, by that task's own rules."""

    role = "scorer"

    @abstractmethod
    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """One row a split that the file `answers` belongs to: "split", "episodes" (how many were scored), then the task's metrics by name. `root`
        holds the task's data.

        Raises DataError, in one line, on a file that is no answer to the task.
        """


class Engine(Component):
    """Runs independent pieces of work: in this process, in a pool, on many machines."""

    role = "engine"

    @abstractmethod
    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """function(item) for each item, in order; function and items must be picklable. A worker that dies raises for its own item only:
        the value yielded for it is the exception."""


ROLES: dict[str, type[Component]] = {
    role.role: role for role in (Dataset, Detector, SaliencyModel, GraphMatcher, Positioner, Planner, Scorer, Localizer, Engine)
}
