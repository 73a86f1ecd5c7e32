"""Data for the HTML page of a report on a run of the task `localization`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from salframe.evaluation.report.view import RunView
from salframe.evaluation.tasks.localization.judging import Judged
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.survey import LocalizationSurvey
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Truth


@dataclass(frozen=True, eq=False)
class Queries:
    """The queries of a run: their ids, the ground truth of each, and the floors of the data set."""

    ids: Sequence[str]
    truths: Sequence[Truth]
    floors: Sequence[FloorMasks]


@dataclass(frozen=True, eq=False)
class LocalizationView(RunView[AnswerRow, LocalizationRow]):
    """Data of a localization run for an HTML page: its queries, and the answers of each method compared with the ground
    truth (`judged`)."""

    survey: LocalizationSurvey
    queries: Queries
    judged: Sequence[Judged]
