"""TODO."""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from salframe.evaluation.run import Outcome, Row, RowWriter, Run
from salframe.framework.cache import Cache
from salframe.framework.errors import DataError, InputMissing, RequirementMissing, SalframeError, WeightsMissing
from salframe.framework.registry import registry
from salframe.localization.answers import Localization
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, Frame
from salframe.panoramas.opening import open_dataset

TOP_PLACES = 10


FRAME_ERRORS = (DataError, InputMissing)
"""What is wrong with a frame, not with the method."""


def predict(directory: Path, label: str) -> None:
    """Ask the method `label` of a run every query that has no answer yet; answers, costs and how it ended go to the run
    folder."""
    conclude(Run.load(directory), label, _answer)


def conclude(run: Run, label: str, work: Callable[[Run, str], Outcome]) -> None:
    """Do a method's work and keep how it ended, whatever it raises."""
    try:
        outcome = work(run, label)
    except (RequirementMissing, WeightsMissing, InputMissing) as error:
        outcome = Outcome("unavailable", str(error))
    except Exception as error:  # a method is somebody else's code: whatever it raises costs its own row only
        log_crash(run, label, "the method")
        outcome = Outcome("crashed", describe_error(error))
    run.end(label, outcome)


def describe_error(error: BaseException) -> str:
    """An exception in one line."""
    text = str(error) if isinstance(error, SalframeError) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())


def log_crash(run: Run, label: str, where: str) -> None:
    """Keep the traceback of the exception that is being handled in the method's folder."""
    with (run.folder(label) / "crash.log").open("a") as file:
        file.write(f"{where}\n{traceback.format_exc()}\n")


def open_method(run: Run, label: str) -> tuple[Localizer, Dataset]:
    """A run's method and dataset. Raises InputMissing where the dataset lacks what the method needs,
    RequirementMissing, WeightsMissing."""
    localizer: Localizer = registry().build("localizer", run.method(label))
    dataset = open_dataset(run.dataset())
    absent = sorted(localizer.needs - dataset.provides)
    if absent:
        raise InputMissing(f"needs {' and '.join(absent)}, which {dataset.name} does not have")
    return localizer, dataset


def _answer(run: Run, label: str) -> Outcome:
    """Answer the open queries, with a warning where mapping frames were left out or queries could not be used."""
    localizer, dataset = open_method(run, label)
    answered = {key for key, row in run.predictions(label).items() if row["status"] != "crashed"}
    work = [
        (fold, [query for query in fold.queries if (fold.id, query.id) not in answered]) for fold in dataset.folds()
    ]
    work = [(fold, queries) for fold, queries in work if queries]
    folder = run.folder(label)
    uses = Counter(frame.id for fold, queries in work for frame in (*fold.mapping, *queries))
    left_out: dict[str, str] = {}
    with RowWriter(folder / "descriptions.jsonl") as costs, RowWriter(folder / "predictions.jsonl") as answers:
        descriptions = _Descriptions(localizer, dataset.fingerprint, uses, costs, set(run.descriptions(label)))
        for fold, queries in work:
            _take_map(localizer, fold, descriptions, left_out)
            for query in queries:
                try:
                    answers.append(_ask(localizer, fold, query, descriptions))
                except Exception as error:  # a query that breaks the method must not take the other queries with it
                    log_crash(run, label, f"query {query.id} of fold {fold.id}")
                    answers.append(_row(fold, query, "crashed", error=describe_error(error)))
    unusable = [row["error"] for row in run.predictions(label).values() if row["status"] == "error"]
    problems = {"mapping frame(s) left out": list(left_out.values()), "query frame(s) that cannot be used": unusable}
    warning = "; ".join(
        f"{len(reasons)} {what}, the first: {reasons[0]}" for what, reasons in problems.items() if reasons
    )
    return Outcome("done", warning or None)


class _Descriptions:
    """Describes each frame once, keeps it in memory until its last use, and records what it cost."""

    def __init__(
        self, localizer: Localizer, dataset: str, uses: Counter[str], costs: RowWriter, recorded: set[str]
    ) -> None:
        self._localizer, self._dataset, self._cache = localizer, dataset, Cache()
        self._uses, self._costs, self._recorded = uses, costs, recorded
        self._found: dict[str, tuple[Description, float] | Exception] = {}

    def take(self, frame: Frame) -> tuple[Description, float]:
        """The description and the milliseconds it took when it was computed. Raises one of FRAME_ERRORS on a frame that
        cannot be used."""
        if frame.id not in self._found:
            try:
                self._found[frame.id] = self._describe(frame)
            except FRAME_ERRORS as error:
                self._found[frame.id] = error
        self._uses[frame.id] -= 1
        found = self._found[frame.id] if self._uses[frame.id] else self._found.pop(frame.id)
        if isinstance(found, Exception):
            raise found
        return found

    def _describe(self, frame: Frame) -> tuple[Description, float]:
        description, seconds = self._localizer.describe_frame(frame, self._cache, self._dataset)
        if frame.id not in self._recorded:
            self._recorded.add(frame.id)
            self._costs.append(
                {"frame": frame.id, "ms": seconds * 1e3, "bytes": self._localizer.scene_bytes(description)}
            )
        return description, seconds * 1e3


def _take_map(localizer: Localizer, fold: Fold, descriptions: _Descriptions, left_out: dict[str, str]) -> None:
    """Index the fold's mapping frames; those that cannot be used are left out and said so in `left_out`."""
    known, frames = [], []
    for frame in fold.mapping:
        try:
            mapped, (description, _) = frame.mapped(), descriptions.take(frame)
        except FRAME_ERRORS as error:
            left_out[frame.id] = str(error)
        else:
            known.append(description)
            frames.append(mapped)
    if not frames:
        raise DataError(
            "; ".join([f"fold {fold.id} has no mapping frame that can be used", *list(left_out.values())[:1]])
        )
    localizer.take_map(known, frames)


def _ask(localizer: Localizer, fold: Fold, query: Frame, descriptions: _Descriptions) -> Row:
    try:
        description, describe_ms = descriptions.take(query)
    except FRAME_ERRORS as error:
        return _row(fold, query, "error", error=str(error))
    start = time.perf_counter()
    answer = localizer.match(description)
    query_ms = (time.perf_counter() - start) * 1e3
    return _row(fold, query, answer.status, answer, describe_ms, query_ms)


def _row(
    fold: Fold,
    query: Frame,
    status: str,
    answer: Localization | None = None,
    describe_ms: float | None = None,
    query_ms: float | None = None,
    error: str | None = None,
) -> Row:
    """One line of predictions.jsonl; `pose` is T_world_query, 16 numbers row by row."""
    places = answer.places[:TOP_PLACES] if answer else ()
    pose = answer.T_world_query if answer else None
    covariance = answer.covariance if answer else None
    return {
        "query": query.id,
        "fold": fold.id,
        "status": status,
        "places": [[place.frame, place.place, place.score] for place in places],
        "pose": None if pose is None else pose.ravel().tolist(),
        "covariance": None if covariance is None else covariance.tolist(),
        "query_ms": query_ms,
        "describe_ms": describe_ms,
        "peak_memory_mb": peak_memory_mb(),
        "error": error,
    }


def peak_memory_mb() -> float | None:
    """Most memory (1e6 bytes) that this process has held so far; None in a process shared with other work."""
    if multiprocessing.parent_process() is None:
        return None
    status = Path("/proc/self/status")
    if status.exists():  # on Linux, ru_maxrss of a started process begins at its parent's peak
        kib = next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(kib) * 1024 / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6
