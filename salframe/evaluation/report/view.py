"""What a page shows of a run: its result, its records, and what they were measured on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from salframe.evaluation.runs.result import Result
from salframe.evaluation.runs.task import Record
from salframe.evaluation.statistics import Judged
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Truth
from salframe.topology.topological_map import TopologicalMap


@dataclass(frozen=True, eq=False)
class RunView:
    """A run of any task; `records` are in the order of the result's rows."""

    result: Result[Any]
    records: Sequence[Record]

    @property
    def name(self) -> str:
        """The run folder's."""
        return self.result.run.name

    @property
    def data(self) -> Mapping[str, Any]:
        """The settings of the data set."""
        settings: Mapping[str, Any] = self.result.request["data"]
        return settings


@dataclass(frozen=True, eq=False)
class Queries:
    """What was asked: ids, what is true of each, and the floors that they lie on."""

    ids: Sequence[str]
    truths: Sequence[Truth]
    floors: Sequence[FloorMasks]


@dataclass(frozen=True, eq=False)
class LocalizationView(RunView):
    """A comparison: its queries, and each method's answers to them, judged."""

    queries: Queries
    judged: Sequence[Judged]


@dataclass(frozen=True, eq=False)
class NavigationView(RunView):
    """A navigation run: the map of each world by its id."""

    maps: Mapping[str, TopologicalMap]
