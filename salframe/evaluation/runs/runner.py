"""One runner for every task: each method's work goes to an engine, its rows to the run folder, and then to a table."""

from __future__ import annotations

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
from salframe.framework.files.writing import alone, write_json
from salframe.localization.describing import describe_frames
from salframe.localization.map_files import MAP_FORMAT
from salframe.panoramas.camera_height import units_note
from salframe.panoramas.opening import Progress, mapping_frames, open_dataset

POLL_SECONDS = 0.5
TRIES, DEATHS = 2, 3
"""A piece is given up of which a process dies so often, and a method that so many pieces are given up of."""
Key = tuple[Any, ...]
"""What a piece is known by."""


def run_task(
    task: AnyTask,
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
    task: AnyTask,
    run: Run,
    known_as: Row,
    request: Request,
    resolved: Resolved,
    progress: Progress | None,
    reported: tuple[Reported, ...],
) -> Result[Any]:
    engine: Engine = registry().build("engine", resolved.engine)
    dataset = open_dataset(resolved.data, progress and partial(progress, resolved.name), engine)
    run.bind(dataset.question_key)
    survey = task.survey(dataset)
    for label, config in resolved.methods.items():
        data = [dataset.content_key, dataset.question_key]
        key = {"task": known_as, "data": data, "mode": task.mode(label), "method": identity_of(config)}
        map_format = {"map_format": MAP_FORMAT} if task.maps else {}  # rows have the bytes of their maps
        run.reuse(label, digest({**key, **map_format}))
    units = units_note(mapping_frames(dataset))
    run.set_notes([*resolved.notes, *([units] if units else [])])
    if request.limits and not engine.isolates:
        raise ConfigError(f"the engine {engine.name!r} has no process a method, which a limit could end")
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
    """What methods have to do in a run, and what has it done."""

    task: AnyTask
    run: Run
    survey: Survey[Any]
    engine: Engine
    limits: Limits

    def do(self, label: str, config: ComponentConfig) -> Outcome:
        """Have a method do what it has not done yet: by one worker, or in shares by several.

        Where one dies of a piece, the others go on; the piece is tried once more, unless a limit ended it, and then
        given up, as is a method that has died of too many.
        """
        folder = self.run.begin(label)
        join_shares(folder)
        outcomes: list[Outcome] = []
        died_of, given_up = Counter[Key | None](), set[Key | None]()
        while True:
            shares = split_work(self._left(label, given_up), self.engine.workers or 1, folder)
            if len(shares) > 1 and self.task.maps and not self.limits:  # no limit would hold for what is described here
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
                    given_up.add(key)
                    if key is not None:
                        self._give_up(key, death, folder)
                    if key is None or len(given_up) == DEATHS:
                        outcomes.append(Outcome(MethodStatus.CRASHED, death.reason))
            if not deaths or any(outcome.status is not MethodStatus.DONE for outcome in outcomes):
                return join_outcomes(outcomes)

    def _left(self, label: str, given_up: Collection[Key | None]) -> list[Key]:
        """What the pieces are known by that the method has not done and that are not given up."""
        rows = _by_key(self.task, self.run, label).items()
        done = {key for key, row in rows if row.status != PieceStatus.CRASHED}
        return [key for key in map(self.task.key, self.survey.pieces) if key not in done and key not in given_up]

    def _answers(self, label: str, shares: Sequence[Share]) -> Iterator[Outcome | WorkerDied]:
        """How each share ended."""
        work = partial(work_share, self.task, self.run.directory.absolute(), label, self.limits)
        answers = iter(self.engine.map(work, shares))
        for _ in shares:
            answer = next(answers, MethodFailed(f"the engine {self.engine.name!r} gave no answer for it"))
            if isinstance(answer, BaseException) and not isinstance(answer, WorkerDied):
                answer = Outcome(MethodStatus.CRASHED, describe_error(answer))
            yield answer

    def _describe_maps(self, config: ComponentConfig, folder: Path) -> None:
        """Have the mapping frames described that are not known to be, and keep what each cost."""
        known = {row.frame for row in read_rows(folder / DESCRIPTIONS, DescriptionLine)}
        frames = [frame.id for frame in mapping_frames(self.survey.dataset) if frame.id not in known]
        with RowWriter(folder / DESCRIPTIONS) as costs:
            for frame, seconds in describe_frames(config, self.run.data(), frames, self.engine):
                costs.append({"frame": frame, "ms": seconds * 1e3})

    def _give_up(self, key: Key, death: Death, folder: Path) -> None:
        """Give the piece that a method's process died of a row that says so."""
        piece = next(one for one in self.survey.pieces if self.task.key(one) == key)
        known_by = dict(zip(self.task.key_fields, key, strict=True))
        crashed = {"status": PieceStatus.CRASHED, "error": death.reason}
        with RowWriter(folder / ROWS) as rows:
            rows.append({**known_by, **self.task.failed(piece), **crashed})


def conclude(task: AnyTask, run: Run, survey: Survey[Any], reported: tuple[Reported, ...] = ()) -> Result[Any]:
    """The result of a run from its rows; writes its metrics and report, or notes that they cannot be written. Runs no
    method."""
    result, records = measure(task, run, survey, reported)
    try:
        return replace(result, report=_write(task, run, survey, result, records))
    except OSError as error:  # a full disk: what was measured is told all the same
        told = f"metrics and report could not be written: {error.strerror or error}"
        return replace(result, notes=(*result.notes, told))


def _write(
    task: AnyTask, run: Run, survey: Survey[Any], result: Result[Any], records: Sequence[Record[Any]]
) -> Path | None:
    """Write the metrics of a run and its page; the path of the page."""
    for row in result.rows:
        write_json(run.folder(row.method) / "metrics.json", row.to_json())
    task.write_files(run, survey, records)
    return task.write_page(result, records, survey)


def measure(
    task: AnyTask, run: Run, survey: Survey[Any], reported: tuple[Reported, ...] = ()
) -> tuple[Result[Any], list[Record[Any]]]:
    """The result of a run from its rows, and these. Writes nothing."""
    records = [_record(task, run, label, survey) for label in run.labels]
    rows: Sequence[MethodRow] = task.summarize([(survey, records)], run.seed)
    told = (*run.notes(), *survey.notes)
    return Result(type(task), run.directory, run.content, run.environment(), tuple(rows), None, told, reported), records


def pool(task: AnyTask, directories: Sequence[Path]) -> Sequence[MethodRow]:
    """The rows of several runs of a task as of one. Runs no method."""
    return task.summarize(records_of(task, directories), Run.load(directories[-1]).seed)


def records_of(task: AnyTask, directories: Sequence[Path]) -> list[Part[Any, Any]]:
    """What several runs of a task hold. Runs no method."""
    parts: list[Part[Any, Any]] = []
    for run in map(Run.load, directories):
        survey = task.survey(open_dataset(run.data()))
        parts.append((survey, [_record(task, run, label, survey) for label in run.labels]))
    return parts


def _by_key(task: AnyTask, run: Run, label: str) -> dict[Key, PieceRow]:
    """Rows by what their piece is known by; of a piece asked again, the last."""
    return {tuple(getattr(row, field) for field in task.key_fields): row for row in run.rows(label, task.row)}


def _finished(task: AnyTask, run: Run, label: str, survey: Survey[Any]) -> bool:
    outcome = run.outcome(label)
    if outcome is None or outcome.status is not MethodStatus.DONE:
        return False
    rows = _by_key(task, run, label)
    keys = map(task.key, survey.pieces)
    return all(key in rows and rows[key].status != PieceStatus.CRASHED for key in keys)


def _record(task: AnyTask, run: Run, label: str, survey: Survey[Any]) -> Record[Any]:
    known, outcome = _by_key(task, run, label), run.outcome(label)
    rows = tuple(known.get(task.key(piece)) for piece in survey.pieces)
    answered = len(rows) - rows.count(None)
    if outcome is None or (outcome.status is MethodStatus.DONE and answered < len(rows)):
        given = outcome.given if outcome else ()
        reason = f"unfinished: {answered} of {len(rows)} {task.counts} done"
        outcome = Outcome(MethodStatus.UNFINISHED, reason, given)
    return Record(label, outcome, rows, run.folder(label))


@contextmanager
def _watch(task: AnyTask, run: Run, total: int, progress: Progress | None) -> Iterator[None]:
    """Tell the progress of each method while the block runs, by the lines in its folder: whatever engine runs it."""
    if progress is None:
        yield
        return
    ended, lines = threading.Event(), LineCounter()

    def tell() -> None:
        for label in run.labels:
            folder = run.folder(label)
            files = [*(folder / name for name in task.counted), *(share / ROWS for share in share_folders(folder))]
            progress(label, min(sum(map(lines.count, files)), total), total)

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
