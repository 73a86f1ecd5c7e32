"""What a page shows of a run of the task `localization`."""

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
    """What was asked: ids, what is true of each, and the floors that they lie on."""

    ids: Sequence[str]
    truths: Sequence[Truth]
    floors: Sequence[FloorMasks]


@dataclass(frozen=True, eq=False)
class LocalizationView(RunView[AnswerRow, LocalizationRow]):
    """A comparison: its queries, and each method's answers to them, judged."""

    survey: LocalizationSurvey
    queries: Queries
    judged: Sequence[Judged]
