"""What the HTML page of a report shows of a run: its result and its records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic

from salframe.evaluation.runs.records import PieceRowT, Record
from salframe.evaluation.runs.task import LineT, Result


@dataclass(frozen=True, eq=False)
class RunView(Generic[PieceRowT, LineT]):
    """What the HTML page shows of a run of any task. `records` are in the order of the result's rows."""

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
