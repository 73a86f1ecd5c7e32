"""The runner of all tasks: engines run the methods, their rows go to the run folder and are summarized in a table."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from salframe.evaluation.runs.limits import Death, Limits
from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.records import Part, Record, Survey
from salframe.evaluation.runs.request import Request, Resolved
from salframe.evaluation.runs.rows import DescriptionLine, LineCounter, PieceRow, PieceStatus, Row, RowWriter, read_rows
from salframe.evaluation.runs.run_folder import DESCRIPTIONS, ROWS, MethodStatus, Outcome, Run, identity_of
from salframe.evaluation.runs.shares import Share, join_outcomes, join_shares, share_folders, split_work
from salframe.evaluation.runs.task import AnyTask, Result
from salframe.evaluation.runs.work import work_share
from salframe.evaluation.tables.reported import Reported
from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.engines.engine import Engine
from salframe.framework.errors import ConfigError, MethodFailed, WorkerDied, describe_error
from salframe.framework.files.hashes import digest
from salframe.framework.files.writing import lock_folder, write_json
from salframe.localization.describing import describe_frames
from salframe.localization.map_files import MAP_FORMAT
from salframe.panoramas.data_checks import data_notes
from salframe.panoramas.opening import Progress, open_dataset, reference_frames

_log = logging.getLogger(__name__)
POLL_SECONDS = 0.5
TRIES, DEATHS = 2, 3
"""A piece of work, such as a query, is skipped if TRIES processes died on it, or if one of them exceeded a limit.
DEATHS skipped pieces end a method."""
Key = tuple[Any, ...]
"""Key of a piece of work, such as a query: the values of its key fields."""


def run_task(
    task: AnyTask,
    request: Request,
    resolved: Resolved,
    *,
    progress: Progress | None = None,
    reported: tuple[Reported, ...] = (),
) -> Result[Any]:
    """Run methods on a task and measure them.

    A run that was interrupted is resumed, and answers of other runs are reused. A method that cannot run, crashes or
    returns invalid answers has a row with the reason.

    Args:
        task: The task.
        request: The request. Without a name the run folder is named by the task's prefix and the data set.
        resolved: The configurations of the request.
        progress: Reports the progress.
        reported: Figures of papers to show beside the result.

    Raises:
        SalframeError: The request is wrong, or another process is working on the run.
    """
    identity = {"name": task.name, "version": task.version, "identity": digest(task.identity()), **task.parameters()}
    run = Run.open(request.runs, request.name or task.prefix + resolved.name, identity, resolved, request.seed)
    with lock_folder(run.directory, "give the run another --name"):
        return _resume(task, run, identity, request, resolved, progress, reported)


def _resume(
    task: AnyTask,
    run: Run,
    identity: Row,
    request: Request,
    resolved: Resolved,
    progress: Progress | None,
    reported: tuple[Reported, ...],
) -> Result[Any]:
    engine: Engine = registry().build("engine", resolved.engine)
    dataset = open_dataset(resolved.data, progress and partial(progress, resolved.name), engine)
    run.bind(dataset.query_key)
    for note in resolved.replacements:  # before the run, which may take long
        _log.info(note)
    survey = task.survey(dataset)
    for label, config in resolved.methods.items():
        data = [dataset.content_key, dataset.query_key]
        key = {"task": identity, "data": data, "mode": task.mode(label), "method": identity_of(config)}
        map_format = {"map_format": MAP_FORMAT} if task.maps else {}  # rows hold the size of their maps
        run.reuse(label, digest({**key, **map_format}))
    run.set_notes([*resolved.notes, *data_notes(dataset)])
    if request.limits and not engine.isolates:
        raise ConfigError(
            f"the options --timeout and --memory need worker processes, which the engine {engine.name!r} does not "
            "have: choose another --engine"
        )
    with _watch(task, run, task.total(survey), progress):
        work = _Work(task, run, survey, engine, request.limits)
        for label, config in resolved.methods.items():
            if not _finished(task, run, label, survey):
                begun, start = any((run.folder(label) / name).exists() for name in task.counted), time.perf_counter()
                outcome = work.do(label, config)
                run.end(label, replace(outcome, seconds=None if begun else time.perf_counter() - start))
    return conclude(task, run, survey, reported)


@dataclass(frozen=True, eq=False)
class _Work:
    """The work of methods in a run, and the engine that runs it."""

    task: AnyTask
    run: Run
    survey: Survey[Any]
    engine: Engine
    limits: Limits

    def do(self, label: str, config: ComponentConfig) -> Outcome:
        """Run a method on its remaining pieces of work, such as queries, by one or several workers.

        If a worker dies, the others continue. The piece that the worker worked on is tried once more. It is skipped if
        a worker dies on it again, or if it exceeded a limit. A method with too many skipped pieces ends as crashed.
        """
        folder = self.run.begin(label)
        join_shares(folder)
        outcomes: list[Outcome] = []
        died_of, skipped = Counter[Key | None](), set[Key | None]()
        while True:
            shares = split_work(self._left(label, skipped), self.engine.workers or 1, folder)
            if len(shares) > 1 and self.task.maps and not self.limits:  # limits do not apply to this
                self._describe_maps(config, folder)
            deaths: list[Death] = []
            try:
                for share, answer in zip(shares, self._answers(label, shares), strict=True):
                    if isinstance(answer, WorkerDied):
                        deaths.append(Death.of(share.folder, self.limits, answer))
                    else:
                        outcomes.append(answer)
            finally:
                join_shares(folder)
            for death in deaths:
                key = None if death.piece is None else tuple(death.piece[name] for name in self.task.key_fields)
                died_of[key] += 1
                if death.by_limit or died_of[key] == TRIES:
                    skipped.add(key)
                    if key is not None:
                        self._give_up(key, death, folder)
                    if key is None or len(skipped) == DEATHS:
                        outcomes.append(Outcome(MethodStatus.CRASHED, death.reason))
            if not deaths or any(outcome.status is not MethodStatus.DONE for outcome in outcomes):
                return join_outcomes(outcomes)

    def _left(self, label: str, skipped: Collection[Key | None]) -> list[Key]:
        """Return the keys of the pieces that the method has not done and that are not skipped."""
        rows = _by_key(self.task, self.run, label).items()
        done = {key for key, row in rows if row.status != PieceStatus.CRASHED}
        return [key for key in map(self.task.key, self.survey.pieces) if key not in done and key not in skipped]

    def _answers(self, label: str, shares: Sequence[Share]) -> Iterator[Outcome | WorkerDied]:
        """Yield the outcome of each worker's share of the pieces, or WorkerDied if the worker died."""
        work = partial(work_share, self.task, self.run.directory.absolute(), label, self.limits)
        answers = iter(self.engine.map(work, shares))
        for _ in shares:
            answer = next(
                answers,
                MethodFailed(
                    f"the engine {self.engine.name!r} returned too few results, expected one for each part of the "
                    "work: choose another --engine"
                ),
            )
            if isinstance(answer, BaseException) and not isinstance(answer, WorkerDied):
                answer = Outcome(MethodStatus.CRASHED, describe_error(answer))
            yield answer

    def _describe_maps(self, config: ComponentConfig, folder: Path) -> None:
        """Describe the reference frames that have no recorded description, and record the time of each."""
        described = {row.frame for row in read_rows(folder / DESCRIPTIONS, DescriptionLine)}
        frames = [frame.id for frame in reference_frames(self.survey.dataset) if frame.id not in described]
        with RowWriter(folder / DESCRIPTIONS) as costs:
            for frame, seconds in describe_frames(config, self.run.data(), frames, self.engine):
                costs.append({"frame": frame, "ms": seconds * 1e3})

    def _give_up(self, key: Key, death: Death, folder: Path) -> None:
        """Write a row with the reason, for a piece of work on which the process of the method died."""
        piece = next(one for one in self.survey.pieces if self.task.key(one) == key)
        key_fields = dict(zip(self.task.key_fields, key, strict=True))
        crashed = {"status": PieceStatus.CRASHED, "error": death.reason}
        with RowWriter(folder / ROWS) as rows:
            rows.append({**key_fields, **self.task.failed(piece), **crashed})


def conclude(task: AnyTask, run: Run, survey: Survey[Any], reported: tuple[Reported, ...] = ()) -> Result[Any]:
    """Return the result of a run from its rows, and write its metrics and report. Runs no method.

    If the files cannot be written, the result has a note.
    """
    result, records = measure(task, run, survey, reported)
    try:
        return replace(result, report=_write(task, run, survey, result, records))
    except OSError as error:  # a full disk: the result is returned all the same
        note = f"the metrics and the report of the run {run.directory} could not be written: {error.strerror or error}"
        return replace(result, notes=(*result.notes, note))


def _write(
    task: AnyTask, run: Run, survey: Survey[Any], result: Result[Any], records: Sequence[Record[Any]]
) -> Path | None:
    """Write the metrics and the page of a run, and return the path of the page."""
    for row in result.rows:
        write_json(run.folder(row.method) / "metrics.json", row.to_json())
    task.write_files(run, survey, records)
    return task.write_page(result, records, survey)


def measure(
    task: AnyTask, run: Run, survey: Survey[Any], reported: tuple[Reported, ...] = ()
) -> tuple[Result[Any], list[Record[Any]]]:
    """Return the result of a run and its records. Writes nothing."""
    records = [_record(task, run, label, survey) for label in run.labels]
    rows: Sequence[MethodRow] = task.summarize([(survey, records)], run.seed)
    notes = (*run.notes(), *survey.notes)
    result = Result(type(task), run.directory, run.content, run.environment(), tuple(rows), None, notes, reported)
    return result, records


def pool(task: AnyTask, directories: Sequence[Path]) -> Sequence[MethodRow]:
    """Return the table row of each method, pooled over the runs in several run folders of one task. Runs no method."""
    return task.summarize(records_of(task, directories), Run.load(directories[-1]).seed)


def records_of(task: AnyTask, directories: Sequence[Path]) -> list[Part[Any, Any]]:
    """Return, for each of several runs of a task, a `Survey` (data set and pieces of work) and the records of the
    methods.

    No method is run.
    """
    parts: list[Part[Any, Any]] = []
    for run in map(Run.load, directories):
        survey = task.survey(open_dataset(run.data()))
        parts.append((survey, [_record(task, run, label, survey) for label in run.labels]))
    return parts


def _by_key(task: AnyTask, run: Run, label: str) -> dict[Key, PieceRow]:
    """Return the row of each piece of work, by its key. If a piece was repeated, its last row is returned."""
    return {tuple(getattr(row, field) for field in task.key_fields): row for row in run.rows(label, task.row)}


def _finished(task: AnyTask, run: Run, label: str, survey: Survey[Any]) -> bool:
    outcome = run.outcome(label)
    if outcome is None or outcome.status is not MethodStatus.DONE:
        return False
    rows = _by_key(task, run, label)
    keys = map(task.key, survey.pieces)
    return all(key in rows and rows[key].status != PieceStatus.CRASHED for key in keys)


def _record(task: AnyTask, run: Run, label: str, survey: Survey[Any]) -> Record[Any]:
    rows_by_key, outcome = _by_key(task, run, label), run.outcome(label)
    rows = tuple(rows_by_key.get(task.key(piece)) for piece in survey.pieces)
    answered = len(rows) - rows.count(None)
    if outcome is None or (outcome.status is MethodStatus.DONE and answered < len(rows)):
        parts = outcome.input if outcome else ()
        reason = f"unfinished: {answered} of {len(rows)} {task.counts} done"
        outcome = Outcome(MethodStatus.UNFINISHED, reason, parts)
    elif rows and all(row is not None and row.status == PieceStatus.INPUT_MISSING for row in rows):
        reason = f"all {len(rows)} {task.counts} lack a required input, the first error: {rows[0] and rows[0].error}"
        outcome = Outcome(MethodStatus.UNAVAILABLE, reason, outcome.input)
    return Record(label, outcome, rows, run.folder(label), run.changes(label), run.substitution(label))


@contextmanager
def _watch(task: AnyTask, run: Run, total: int, progress: Progress | None) -> Iterator[None]:
    """Report the progress of each method during the `with` block, from the number of lines in its folder."""
    if progress is None:
        yield
        return
    ended, lines = threading.Event(), LineCounter()

    def report() -> None:
        for label in run.labels:
            folder = run.folder(label)
            files = [*(folder / name for name in task.counted), *(share / ROWS for share in share_folders(folder))]
            progress(label, min(sum(map(lines.count, files)), total), total)

    def poll() -> None:
        while not ended.wait(POLL_SECONDS):
            report()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        report()
