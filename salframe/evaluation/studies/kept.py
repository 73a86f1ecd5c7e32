"""Results of experiments as files that last."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.run_folder import MethodStatus, Run
from salframe.evaluation.studies.study import Study, StudyResult, leading_columns
from salframe.evaluation.tables.table import Table
from salframe.framework.files.reading import read_model
from salframe.framework.validation import Settings
from salframe.framework.version import __version__

KEPT_FORMAT: Literal[1] = 1
DIGITS = 6
"""Number of significant digits that are kept."""
NOT_KEPT = frozenset({"errors", "reason", "classes", "joined"})
"""Fields of rows that may name what is in the data."""


class Kept(Settings):
    """What came of a table. known_by: the hash of its settings and of the versions of its components; rows: the fields
    of each row that name nothing of the data; settings: what varied for it; seconds: how long the work of all methods
    took, None where some of it was resumed."""

    known_by: str
    date: str
    version: str
    machine: str
    settings: tuple[dict[str, Any], ...]
    rows: tuple[dict[str, Any], ...]
    seconds: float | None = None


class Results(Settings):
    """The file of an experiment's results: tables by name, of the whole measurement and of the quick one."""

    format: Literal[1] = KEPT_FORMAT
    whole: dict[str, Kept] = Field({})
    quick: dict[str, Kept] = Field({})


def keep(result: StudyResult, known_by: str) -> Kept:
    """What is kept of a table: numbers and what they are of, but no word of the data."""
    rows = []
    for row in result.rows:
        content = {key: _short(value) for key, value in row.to_json().items() if key not in NOT_KEPT}
        rows.append({**content, "measured": row.measured})
    machine = f"{os.cpu_count()} cores, {platform.machine()}"
    told = tuple(dict(given) for given in result.settings)
    today = date.today().isoformat()
    return Kept(
        known_by=known_by,
        date=today,
        version=__version__,
        machine=machine,
        settings=told,
        rows=tuple(rows),
        seconds=_short(_spent(result.runs)),
    )


def _spent(directories: Sequence[Path]) -> float | None:
    """How long the work of all methods of some runs took; None where some of it was resumed, or has not ended."""
    runs = [Run.load(directory) for directory in directories]
    outcomes = [run.outcome(label) for run in runs for label in run.labels]
    spent = [outcome.seconds for outcome in outcomes if outcome and outcome.seconds is not None]
    return sum(spent) if len(spent) == len(outcomes) else None


def _short(value: Any) -> Any:
    """A value with its numbers to DIGITS."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, dict):
        return {key: _short(one) for key, one in value.items()}
    return [_short(one) for one in value] if isinstance(value, list | tuple) else value


def kept_rows(study: Study, kept: Kept) -> list[MethodRow]:
    """Return the lines of methods that were kept. Raises DataError."""
    return [study.kind.line.from_json(row, f"the kept row of {row.get('method')}") for row in kept.rows]


def has_ended(study: Study, kept: Kept) -> bool:
    """Return whether every method did what it was asked; what crashed, or lacked something, is measured again."""
    return all(row.ended is MethodStatus.DONE and not row.crashed for row in kept_rows(study, kept))


def kept_tables(study: Study, kept: Kept, columns: Sequence[str] = ()) -> list[Table]:
    """Return the tables of what was kept; `columns`: names of those to show, by default the usual ones."""
    rows = kept_rows(study, kept)
    return study.kind.tables(rows, columns, leading_columns(study.kind, rows, kept.settings))


def read_results(file: Path) -> Results:
    """The results in a file, none where there is no such file. Raises DataError on another content."""
    return read_model(file, Results) if file.exists() else Results()
