"""Finished runs: compute their metrics again, and write a report that shows several runs side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from salframe.evaluation.report.arms import Entry, find_entries, name_arms
from salframe.evaluation.report.page import write_page
from salframe.evaluation.report.paged_task import PagedTask
from salframe.evaluation.report.view import RunView
from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.records import Survey
from salframe.evaluation.runs.runner import conclude, measure
from salframe.evaluation.runs.task import Result
from salframe.evaluation.tasks.all import open_run
from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas.opening import Progress, open_dataset


def evaluate(directory: str | Path) -> Result[Any]:
    """Compute the metrics of a run again from its stored rows and the ground truth, and write metrics and report.

    No method is run.

    Raises:
        ConfigError: `directory` is not a run.
        DataError: The dataset differs from the one that the run was made on.
    """
    run, task = open_run(directory)
    dataset = open_dataset(run.data())
    run.bind(dataset.query_key)
    return conclude(task, run, task.survey(dataset))


@dataclass(frozen=True, eq=False)
class Report:
    """A written report: its path, the results that it shows, and notes on what could not be drawn."""

    path: Path
    results: tuple[Result[Any], ...]
    notes: tuple[str, ...] = ()


def write_report(
    runs: Sequence[str | Path],
    output: str | Path = "report.html",
    *,
    full: bool = False,
    columns: Sequence[str] = (),
    progress: Progress | None = None,
) -> Report:
    """Write a report of runs of one task to a self-contained HTML file.

    The report shows the runs side by side and every query of a comparison. Runs that differ only in the seed of the
    data are pooled per method. Descriptions of frames that are not in the cache are computed.

    Args:
        runs: Run folders, at least one.
        output: The file to write.
        full: Whether to show panoramas in full resolution instead of thumbnails.
        columns: Names of the columns of the first table. Empty for the default columns.
        progress: Reports the progress.

    Raises:
        ConfigError: A folder is not a run, the runs are of several tasks, or a column is unknown.
        DataError: A dataset differs from the one that a run was made on, or the file cannot be written.
    """
    folders = list(dict.fromkeys(Path(run).resolve() for run in runs))
    if not folders:
        raise ConfigError("received no run folder, expected the path of at least one")
    opened = [_open(folder, progress) for folder in folders]
    views = [one.view for one in opened]
    tasks = sorted({view.result.task for view in views})
    if len(tasks) > 1:
        raise ConfigError(f"received runs of the tasks {' and '.join(tasks)}, expected runs of the same task")
    entries, task = find_entries(views), opened[0].task
    arms = name_arms(views, entries, _pool(opened, entries))
    content = task.content(views, arms, columns)
    islands = task.islands(views, arms, full, progress)
    notes = () if islands is None else islands.notes
    content |= {"pictures": islands is not None, "notes": [*content["notes"], *notes]}
    path = Path(output)
    try:
        write_page(path, content, () if islands is None else islands.parts)
    except OSError as error:
        raise DataError(f"cannot write the report {path}: {error.strerror or error}") from None
    return Report(path, tuple(view.result for view in views), notes)


@dataclass(frozen=True, eq=False)
class _Opened:
    task: PagedTask[Any, Any, Any, Any]
    survey: Survey[Any]
    view: RunView[Any, Any]


def _open(folder: Path, progress: Progress | None) -> _Opened:
    run, task = open_run(folder)
    dataset = open_dataset(run.data(), progress and partial(progress, run.directory.name))
    run.bind(dataset.query_key)
    survey = task.survey(dataset)
    if not isinstance(task, PagedTask):
        raise ConfigError(
            f"the run folder {folder} has the task {task.name!r}, which has no HTML report: print the tables with "
            "salframe evaluate"
        )
    result, records = measure(task, run, survey)
    return _Opened(task, survey, task.view(result, records, survey))


def _pool(opened: Sequence[_Opened], entries: Sequence[tuple[Entry, ...]]) -> list[MethodRow]:
    """Return the row of each arm (a method with its settings, on one dataset). Arms of the same runs are summarized
    together, so that the paired tests compare each arm with the first one."""
    rows: dict[int, MethodRow] = {}
    together: dict[tuple[int, ...], list[int]] = {}
    for number, alike in enumerate(entries):
        together.setdefault(tuple(entry.run for entry in alike), []).append(number)
    for runs, numbers in together.items():
        if len(runs) == 1:
            result_rows = opened[runs[0]].view.result.rows
            rows |= {number: result_rows[entries[number][0].method] for number in numbers}
            continue
        parts = [
            (opened[run].survey, [opened[run].view.records[entries[number][k].method] for number in numbers])
            for k, run in enumerate(runs)
        ]
        seed = opened[runs[0]].view.result.request["seed"]
        rows |= dict(zip(numbers, opened[runs[0]].task.summarize(parts, seed), strict=True))
    return [rows[number] for number in range(len(entries))]
