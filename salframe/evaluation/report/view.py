"""Data of a run for the HTML page of a report: its result and its records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic

from salframe.evaluation.runs.records import PieceRowT, Record
from salframe.evaluation.runs.task import LineT, Result


@dataclass(frozen=True, eq=False)
class RunView(Generic[PieceRowT, LineT]):
    """Data of a run of any task for the HTML page. `records` are in the order of the result's rows."""

    result: Result[LineT]
    records: Sequence[Record[PieceRowT]]

    @property
    def name(self) -> str:
        """Name of the run folder."""
        return self.result.run.name

    @property
    def data(self) -> Mapping[str, Any]:
        """Settings of the data set."""
        settings: Mapping[str, Any] = self.result.request["data"]
        return settings
