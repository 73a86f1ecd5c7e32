"""One runner for every task: each method's work goes to an engine, its rows to the run folder, and then to a table."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from salframe.evaluation.engine import Engine
from salframe.evaluation.guard import Guard, Limits, what_ended
from salframe.evaluation.reported import Reported
from salframe.evaluation.request import Request, Resolved
from salframe.evaluation.result import Result
from salframe.evaluation.run import (
    ROWS,
    LineCounter,
    MethodStatus,
    Outcome,
    PieceStatus,
    Row,
    RowWriter,
    Run,
    identity_of,
)
from salframe.evaluation.task import MethodRow, Record, Survey, Task
from salframe.framework.auto import Choice
from salframe.framework.errors import (
    FRAME_ERRORS,
    ConfigError,
    InputMissing,
    MethodFailed,
    MethodUnavailable,
    RequirementMissing,
    WeightsMissing,
    WorkerDied,
    describe_error,
)
from salframe.framework.files import alone, write_json
from salframe.framework.identity import digest
from salframe.framework.registry import registry
from salframe.panoramas.camera_height import units_note
from salframe.panoramas.opening import Progress, mapping_frames, open_dataset, provided

POLL_SECONDS = 0.5
DEATHS = 3
"""A method whose process dies so often in one run is given up."""


def run_task(
    task: Task[Any, Any],
    request: Request,
    resolved: Resolved,
    *,
    progress: Progress | None = None,
    reported: tuple[Reported, ...] = (),
) -> Result[Any]:
    """Have methods do a task and measure them; a run that was begun is resumed, and what another run knows is reused.

    `resolved`: the configurations of the request. Without a name the run folder has the task's prefix and the data
    set's name. Raises SalframeError where the request is wrong or another process has the run in hand; a method that
    cannot run, crashes or answers nonsense keeps its row, with the reason.
    """
    known_as = {"name": task.name, "version": task.version, "identity": digest(task.identity()), **task.asks()}
    run = Run.open(request.runs, request.name or task.prefix + resolved.name, known_as, resolved, request.seed)
    with alone(run.directory, "give the run another --name"):
        return _resume(task, run, known_as, request, resolved, progress, reported)


def _resume(
    task: Task[Any, Any],
    run: Run,
    known_as: Row,
    request: Request,
    resolved: Resolved,
    progress: Progress | None,
    reported: tuple[Reported, ...],
) -> Result[Any]:
    engine: Engine = registry().build("engine", resolved.engine)
    dataset = open_dataset(resolved.data, progress and partial(progress, resolved.name))
    run.bind(dataset.question_key)
    survey = task.survey(dataset)
    for label, config in resolved.methods.items():
        data = [dataset.content_key, dataset.question_key]
        key = {"task": known_as, "data": data, "mode": task.mode(label), "method": identity_of(config)}
        run.reuse(label, digest(key))
    units = units_note(mapping_frames(dataset))
    run.set_notes([*resolved.notes, *([units] if units else [])])
    if request.limits and not engine.isolates:
        raise ConfigError(f"the engine {engine.name!r} has no process a method, which a limit could end")
    todo = [label for label in run.labels if not _finished(task, run, label, survey)]
    skipped: dict[str, list[tuple[Any, ...]]] = {label: [] for label in todo}
    with _watch(task, run, task.total(survey), progress):
        while todo:
            work = partial(work_method, task, run.directory, request.limits, skipped)
            answers = iter(engine.map(work, todo))
            again = []
            for label in todo:
                ended = next(answers, MethodFailed(f"the engine {engine.name!r} gave no answer for it"))
                if isinstance(ended, WorkerDied):
                    known_by, reason = what_ended(run.folder(label), request.limits)
                    if known_by is not None:
                        skipped[label].append(_skip(task, run, label, survey, known_by, reason))
                    if known_by is not None and len(skipped[label]) < DEATHS:
                        again.append(label)
                        continue
                    ended = WorkerDied(reason)
                if isinstance(ended, BaseException):
                    run.end(label, Outcome(MethodStatus.CRASHED, describe_error(ended)))
            todo = again
    return conclude(task, run, survey, reported)


def conclude(task: Task[Any, Any], run: Run, survey: Survey[Any], reported: tuple[Reported, ...] = ()) -> Result[Any]:
    """The result of a run from its rows; writes its metrics and report, or notes that they cannot be written. Runs no
    method."""
    result, records = measure(task, run, survey, reported)
    try:
        return replace(result, report=_write(task, run, survey, result, records))
    except OSError as error:  # a full disk: what was measured is told all the same
        told = f"metrics and report could not be written: {error.strerror or error}"
        return replace(result, notes=(*result.notes, told))


def _write(
    task: Task[Any, Any], run: Run, survey: Survey[Any], result: Result[Any], records: Sequence[Record]
) -> Path | None:
    """Write the metrics of a run and its page; the path of the page."""
    for row, content in zip(result.rows, result.to_json()["rows"], strict=True):
        write_json(run.folder(row.method) / "metrics.json", content)
    task.write_files(run, survey, records)
    view = task.view(result, records, survey)
    if view is None:
        return None
    from salframe.evaluation.report.content import write_run_page

    return write_run_page(view)


def measure(
    task: Task[Any, Any], run: Run, survey: Survey[Any], reported: tuple[Reported, ...] = ()
) -> tuple[Result[Any], list[Record]]:
    """The result of a run from its rows, and these. Writes nothing."""
    records = [_record(task, run, label, survey) for label in run.labels]
    rows: Sequence[MethodRow] = task.summarize([(survey, records)], run.seed)
    told = (*run.notes(), *survey.notes)
    return Result(task.name, run.directory, run.content, run.environment(), tuple(rows), None, told, reported), records


def pool(task: Task[Any, Any], directories: Sequence[Path]) -> Sequence[MethodRow]:
    """The rows of several runs of a task as of one. Runs no method."""
    parts = []
    for run in map(Run.load, directories):
        survey = task.survey(open_dataset(run.data()))
        parts.append((survey, [_record(task, run, label, survey) for label in run.labels]))
    return task.summarize(parts, run.seed)


def _skip(
    task: Task[Any, Any], run: Run, label: str, survey: Survey[Any], known_by: Row, reason: str
) -> tuple[Any, ...]:
    """Give the piece that a method's process died of a row that says so; the piece's key."""
    key = tuple(known_by[name] for name in task.key_fields)
    piece = next(one for one in survey.pieces if task.key(one) == key)
    with closing(RowWriter(run.folder(label) / ROWS)) as rows:
        rows.append({**known_by, **task.failed(piece), "status": PieceStatus.CRASHED, "error": reason})
    return key


def work_method(
    task: Task[Any, Any],
    directory: Path,
    limits: Limits,
    skipped: Mapping[str, Collection[tuple[Any, ...]]],
    label: str,
) -> None:
    """Have one method of a run do what it has not done yet, and keep how it ended, whatever it raises. `skipped`: the
    pieces by label that a process died of."""
    run = Run.load(directory)
    folder = run.begin(label)
    given: tuple[str, ...] = ()
    guard = Guard(folder, limits)
    try:
        data = run.data()
        config = run.method(label, task.role, Choice(data.kind, partial(provided, data)))
        method = registry().build(task.role, config)
        survey = task.survey(open_dataset(data))
        given = task.given(label, method, survey.dataset)
        done = {key for key, row in _by_key(task, run, label).items() if row["status"] != PieceStatus.CRASHED}
        todo = [piece for piece in survey.pieces if task.key(piece) not in {*done, *skipped[label]}]
        with task.open(label, method, survey, todo, folder) as worker, RowWriter(folder / ROWS) as rows:
            for piece in todo:
                known_by = dict(zip(task.key_fields, task.key(piece), strict=True))
                worker.prepare(piece)
                with guard.watch(known_by):
                    row = _attempt(task, worker.work, piece, folder)
                rows.append({**known_by, **row})
            outcome = Outcome(MethodStatus.DONE, worker.warning, given)
    except (RequirementMissing, WeightsMissing, InputMissing, MethodUnavailable) as error:
        outcome = Outcome(MethodStatus.UNAVAILABLE, str(error), given)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a method is somebody else's code: whatever it raises costs its own row only
        log_crash(folder, "the method")
        outcome = Outcome(MethodStatus.CRASHED, describe_error(error), given)
    finally:
        guard.close()
    run.end(label, outcome)


def _attempt(task: Task[Any, Any], work: Callable[[Any], Row], piece: Any, folder: Path) -> Row:
    try:
        return work(piece)
    except MethodFailed:
        raise
    except FRAME_ERRORS as error:
        return {**task.failed(piece), "status": PieceStatus.ERROR, "error": str(error)}
    except Exception as error:  # a piece that breaks the method must not take the others with it
        log_crash(folder, " ".join(map(str, task.key(piece))))
        return {**task.failed(piece), "status": PieceStatus.CRASHED, "error": describe_error(error)}


def log_crash(folder: Path, where: str) -> None:
    """Keep the traceback of the exception that is being handled in a method's folder."""
    with (folder / "crash.log").open("a", encoding="utf-8") as file:
        file.write(f"{where}\n{traceback.format_exc()}\n")


def _by_key(task: Task[Any, Any], run: Run, label: str) -> dict[tuple[Any, ...], Row]:
    """Rows by what their piece is known by; of a piece asked again, the last."""
    return {tuple(row.get(field) for field in task.key_fields): row for row in run.rows(label, task.row)}


def _finished(task: Task[Any, Any], run: Run, label: str, survey: Survey[Any]) -> bool:
    outcome = run.outcome(label)
    if outcome is None or outcome.status is not MethodStatus.DONE:
        return False
    rows = _by_key(task, run, label)
    keys = map(task.key, survey.pieces)
    return all(key in rows and rows[key]["status"] != PieceStatus.CRASHED for key in keys)


def _record(task: Task[Any, Any], run: Run, label: str, survey: Survey[Any]) -> Record:
    known, outcome = _by_key(task, run, label), run.outcome(label)
    rows = tuple(known.get(task.key(piece)) for piece in survey.pieces)
    answered = len(rows) - rows.count(None)
    if outcome is None or (outcome.status is MethodStatus.DONE and answered < len(rows)):
        given = outcome.given if outcome else ()
        reason = f"unfinished: {answered} of {len(rows)} {task.counts} done"
        outcome = Outcome(MethodStatus.UNFINISHED, reason, given)
    return Record(label, outcome, rows, run.folder(label))


@contextmanager
def _watch(task: Task[Any, Any], run: Run, total: int, progress: Progress | None) -> Iterator[None]:
    """Tell the progress of each method while the block runs, by the lines in its folder: whatever engine runs it."""
    if progress is None:
        yield
        return
    ended, lines = threading.Event(), LineCounter()

    def tell() -> None:
        for label in run.labels:
            done = sum(lines.count(run.folder(label) / name) for name in task.counted)
            progress(label, min(done, total), total)

    def poll() -> None:
        while not ended.wait(POLL_SECONDS):
            tell()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        tell()
