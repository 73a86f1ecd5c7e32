"""The work of one method on its share of a task, in a worker process."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from contextlib import chdir
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from salframe.evaluation.runs.limits import Guard, Limits
from salframe.evaluation.runs.rows import PieceStatus, Row, RowWriter
from salframe.evaluation.runs.run_folder import CRASH_LOG, ROWS, MethodStatus, Outcome, Run
from salframe.evaluation.runs.shares import Share
from salframe.evaluation.runs.task import AnyTask
from salframe.framework.components.auto import Choice
from salframe.framework.components.registry import registry
from salframe.framework.errors import (
    FRAME_ERRORS,
    InputMissing,
    MethodFailed,
    MethodUnavailable,
    RequirementMissing,
    WeightsError,
    describe_error,
)
from salframe.panoramas.opening import open_dataset, provided


def work_share(task: AnyTask, directory: Path, label: str, limits: Limits, share: Share) -> Outcome:
    """Run one method of a run on its share of the pieces, and write a row for each piece.

    Returns:
        The outcome. Exceptions of the method are caught and reported there.
    """
    run = Run.load(directory.absolute())  # a plugin may change the working folder
    share = replace(share, folder=share.folder.absolute())
    share.folder.mkdir(parents=True, exist_ok=True)
    parts: tuple[str, ...] = ()
    guard = Guard(share.folder, limits)
    try:
        data = run.data()
        config = run.method(label, task.role, Choice(data.kind, partial(provided, data)))
        with guard.watch(), chdir("."):
            method = registry().build(task.role, config)
        survey = task.survey(open_dataset(data))
        parts = task.input(label, method, survey.dataset)
        keys = set(share.keys)
        todo = [piece for piece in survey.pieces if task.key(piece) in keys]
        with task.open(label, method, survey, todo, share.folder) as worker, RowWriter(share.folder / ROWS) as rows:
            for piece in todo:
                key_fields = dict(zip(task.key_fields, task.key(piece), strict=True))
                worker.prepare(piece)
                with guard.watch(key_fields), chdir("."):  # returns to the working folder if the method changes it
                    row = _attempt(task, worker.work, piece, share.folder)
                rows.append({**key_fields, **row})
            outcome = Outcome(MethodStatus.DONE, worker.warning, parts)
    except (RequirementMissing, WeightsError, InputMissing, MethodUnavailable) as error:
        return Outcome(MethodStatus.UNAVAILABLE, str(error), parts)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a method may be third-party code: its exceptions must not affect other methods
        log_crash(share.folder, "the method")
        return Outcome(MethodStatus.CRASHED, describe_error(error), parts)
    finally:
        guard.close()
    return outcome


def _attempt(task: AnyTask, work: Callable[[Any], Row], piece: Any, folder: Path) -> Row:
    try:
        return work(piece)
    except MethodFailed:
        raise
    except FRAME_ERRORS as error:
        status = PieceStatus.INPUT_MISSING if isinstance(error, InputMissing) else PieceStatus.ERROR
        return {**task.failed(piece), "status": status, "error": str(error)}
    except Exception as error:  # an exception on one piece must not affect the others
        log_crash(folder, " ".join(map(str, task.key(piece))))
        return {**task.failed(piece), "status": PieceStatus.CRASHED, "error": describe_error(error)}


def log_crash(folder: Path, where: str) -> None:
    """Append the traceback of the current exception to the crash log in the folder of a method or a share."""
    with (folder / CRASH_LOG).open("a", encoding="utf-8") as file:
        file.write(f"{where}\n{traceback.format_exc()}\n")
