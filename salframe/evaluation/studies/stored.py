"""Stored results of experiments."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.run_folder import MethodStatus, Run
from salframe.evaluation.studies.study import Study, StudyResult, leading_columns
from salframe.evaluation.tables.table import Table
from salframe.framework.files.reading import read_model
from salframe.framework.validation import Settings
from salframe.framework.version import __version__

RESULTS_FORMAT: Literal[2] = 2
DIGITS = 6
"""Number of significant digits of stored numbers."""
EXCLUDED_FIELDS = frozenset({"errors", "reason", "classes", "joined"})
"""Fields of rows that are not stored, since they may reveal the content of the data."""


class StoredTable(Settings):
    """The stored result of a table.

    Attributes:
        cache_key: Hash of the settings of the table and of the versions of its components.
        date: Date of the measurement.
        version: Version of salframe.
        machine: Number of cores and architecture.
        settings: The varied settings of each row.
        rows: Fields of each row, without EXCLUDED_FIELDS.
        seconds: Duration of the work of all methods; None if some of it was resumed.
    """

    cache_key: str
    date: str
    version: str
    machine: str
    settings: tuple[dict[str, Any], ...]
    rows: tuple[dict[str, Any], ...]
    seconds: float | None = None

    @model_validator(mode="after")
    def _check_rows(self) -> Self:
        keys = {json.dumps([settings, row.get("method")]) for settings, row in zip(self.settings, self.rows)}  # noqa: B905
        if not len(keys) == len(self.rows) == len(self.settings):
            raise ValueError(
                f"the table has {len(self.rows)} `rows`, {len(self.settings)} `settings` and {len(keys)} different "
                "pairs of settings and method, expected three equal numbers: remove the table from the file, and "
                "measure it again"
            )
        return self


class Results(Settings):
    """The stored results of an experiment: tables by name, of the whole measurement and of the quick one."""

    format: Literal[2] = RESULTS_FORMAT
    whole: dict[str, StoredTable] = Field({})
    quick: dict[str, StoredTable] = Field({})


def store_table(result: StudyResult, cache_key: str) -> StoredTable:
    """Return the result of a study in the stored form: numbers and settings, without names of queries or places."""
    rows = []
    for row in result.rows:
        content = {key: _short(value) for key, value in row.to_json().items() if key not in EXCLUDED_FIELDS}
        rows.append({**content, "measured": row.measured})
    machine = f"{os.cpu_count()} cores, {platform.machine()}"
    settings = tuple(dict(one) for one in result.settings)
    today = date.today().isoformat()
    return StoredTable(
        cache_key=cache_key,
        date=today,
        version=__version__,
        machine=machine,
        settings=settings,
        rows=tuple(rows),
        seconds=_short(_spent(result.runs)),
    )


def _spent(directories: Sequence[Path]) -> float | None:
    """Return the total duration of the work in runs; None if some of it was resumed or has not ended."""
    runs = [Run.load(directory) for directory in directories]
    outcomes = [run.outcome(label) for run in runs for label in run.labels]
    spent = [outcome.seconds for outcome in outcomes if outcome and outcome.seconds is not None]
    return sum(spent) if len(spent) == len(outcomes) else None


def _short(value: Any) -> Any:
    """Return a value with its numbers rounded to DIGITS significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, dict):
        return {key: _short(one) for key, one in value.items()}
    return [_short(one) for one in value] if isinstance(value, list | tuple) else value


def stored_rows(study: Study, stored: StoredTable) -> list[MethodRow]:
    """Return the stored rows of methods. Raises DataError."""
    return [study.kind.line.from_json(row, f"the stored row of {row.get('method')}") for row in stored.rows]


def has_ended(study: Study, stored: StoredTable) -> bool:
    """Return whether every method completed its work. Otherwise the table is measured again."""
    return all(row.ended is MethodStatus.DONE and not row.crashed for row in stored_rows(study, stored))


def stored_tables(study: Study, stored: StoredTable, columns: Sequence[str] = ()) -> list[Table]:
    """Return the stored rows as tables. `columns` are the names of the columns; empty for the default columns."""
    rows = stored_rows(study, stored)
    return study.kind.tables(rows, columns, leading_columns(study.kind, rows, stored.settings, study.set))


def read_results(file: Path) -> Results:
    """Read a file of results; return empty results if it is missing. Raises DataError on invalid content."""
    return read_model(file, Results) if file.exists() else Results()
