"""The task `running`: what a saved map costs a program that opens it once and asks it again and again."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.runs.rows import RunningLine
from salframe.evaluation.runs.run_folder import PieceStatus, Row, Run
from salframe.evaluation.runs.task import (
    MethodRow,
    Part,
    Record,
    Survey,
    Task,
    Worker,
    by_method,
    check_needs,
    in_common,
)
from salframe.evaluation.tasks.localization.answering import memory_mb
from salframe.framework.cache import Cache
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import DataError, MethodFailed
from salframe.framework.installation import folder_bytes
from salframe.framework.processes import ProcessPool
from salframe.framework.registry import registry
from salframe.localization.describing import describe_frame, read_config
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap, open_map
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, QueryFrame
from salframe.panoramas.opening import open_dataset

QUERIES = 100
"""So many are asked at most, evenly spread over the fold's."""


@dataclass(frozen=True, kw_only=True)
class RunningRow(MethodRow):
    """A method's line: of the saved map of the first fold, scenes, bytes_per_scene with its index and open_s, seconds
    to open it in a process that has only imported salframe; opened_mb, 1e6 bytes of memory that this brings, and
    asked_mb with the first query (None elsewhere than on Linux); first_ms, describing and answering the first query; of
    all later ones, medians to describe and to answer, and the 95th percentile of the latter."""

    queries: int
    scenes: int | None = None
    bytes_per_scene: float | None = None
    open_s: float | None = None
    opened_mb: float | None = None
    asked_mb: float | None = None
    first_ms: float | None = None
    describe_ms: float | None = None
    query_median_ms: float | None = None
    query_p95_ms: float | None = None

    @property
    def measured(self) -> bool:
        return self.query_median_ms is not None


@dataclass(frozen=True, eq=False, kw_only=True)
class RunningSurvey(Survey[QueryFrame]):
    """Queries of a data set's first fold that has some."""

    fold: Fold


@dataclass(frozen=True)
class RunningTask(Task[QueryFrame, RunningSurvey]):
    """How long do opening a map and asking it take, and how much memory?"""

    name = "running"
    prefix = "running-"
    counts = "queries"
    key_fields = ("query",)
    row = RunningLine

    @classmethod
    def from_run(cls, run: Run) -> RunningTask:
        return cls()

    def survey(self, dataset: Dataset) -> RunningSurvey:
        fold = next((fold for fold in dataset.folds() if fold.queries), None)
        if fold is None:
            raise DataError(f"{dataset.name} has no query, expected at least one")
        step = -(-len(fold.queries) // QUERIES)
        return RunningSurvey(dataset, fold.queries[::step], fold=fold)

    def key(self, piece: QueryFrame) -> tuple[str]:
        return (piece.id,)

    def open(
        self, label: str, method: Localizer, survey: RunningSurvey, todo: Sequence[QueryFrame], folder: Path
    ) -> Worker[QueryFrame]:
        check_needs(method, survey.dataset)
        return _Asking(method.config, survey, folder)

    def summarize(self, parts: Sequence[Part[RunningSurvey]], seed: int) -> tuple[RunningRow, ...]:
        queries = sum(len(survey.pieces) for survey, _ in parts)
        return tuple(_summarize(records, queries) for records in by_method(parts))


class _Asking(Worker[QueryFrame]):
    """A map that one process saves, and another opens and asks, which has done nothing before."""

    def __init__(self, method: ComponentConfig, survey: RunningSurvey, folder: Path) -> None:
        self._contents = tuple(config.model_dump_json() for config in (method, survey.dataset.config))
        self._scenes = len(survey.fold.mapping)
        folder.mkdir(parents=True, exist_ok=True)
        for left in folder.glob("map-*"):  # of a process that was killed
            shutil.rmtree(left, ignore_errors=True)
        self._folder = Path(tempfile.mkdtemp(prefix="map-", dir=folder))
        self._program = ProcessPool(1)
        self._costs: Row = {}

    def prepare(self, piece: QueryFrame) -> None:
        if self._costs:
            return
        saved, data = self._folder / "map", self._contents[1]
        with ProcessPool(1) as builder:
            _result(builder.submit(save_first_map, *self._contents, str(saved)))
        opened = _result(self._program.submit(_open_program, data, str(saved)))
        self._costs = {"scenes": self._scenes, "bytes": folder_bytes(saved), **opened}

    def work(self, piece: QueryFrame) -> Row:
        asked = _result(self._program.submit(_ask_program, piece.id))
        return {**self._costs, **asked, "status": PieceStatus.OK, "error": None}

    def close(self) -> None:
        self._program.stop()
        shutil.rmtree(self._folder, ignore_errors=True)


def _result(future: Future[Any]) -> Any:
    """What a process made of its work, or what it raised. Raises MethodFailed where it died."""
    try:
        return future.result()
    except BrokenProcessPool:
        raise MethodFailed("the process that had its map died") from None


def save_first_map(method: str, data: str, output: str) -> None:
    """Save the map of a data set's first fold that has queries. method, data: configurations as JSON. Raises
    SalframeError as building and saving a map do."""
    dataset = open_dataset(read_config("dataset", data))
    localizer: Localizer = registry().build("localizer", read_config("localizer", method))
    fold = RunningTask().survey(dataset).fold
    built = LocalizationMap.build(localizer, fold.mapping, Cache(), dataset.content_key, floors=dataset.floors())
    built.save(output)


@dataclass
class _Program:
    """What a program holds that asks a map: the map, the queries by id, its memory before (1e6 bytes), whether it has
    answered."""

    opened: LocalizationMap
    queries: Mapping[str, QueryFrame]
    before_mb: float | None
    asked: bool = False


_programs: list[_Program] = []
"""Of this process, the one there is."""


def _open_program(data: str, saved: str) -> Row:
    """Open a saved map; what that costs."""
    queries = {query.id: query for query in RunningTask().survey(open_dataset(read_config("dataset", data))).pieces}
    before_mb, start = memory_mb("VmRSS"), time.perf_counter()
    opened = open_map(saved)
    open_s = time.perf_counter() - start
    _programs[:] = [_Program(opened, queries, before_mb)]
    return {"open_s": open_s, "opened_mb": _more(before_mb)}


def _ask_program(query: str) -> Row:
    """Ask the map; what that costs. Memory counts the panorama that is asked."""
    (program,) = _programs
    panorama = program.queries[query].load()
    description, seconds = describe_frame(program.opened.localizer, QueryFrame(query, lambda: panorama))
    start = time.perf_counter()
    program.opened.answer(description)
    query_ms = 1e3 * (time.perf_counter() - start)
    first, program.asked = not program.asked, True
    cost = {"first": first, "describe_ms": 1e3 * seconds, "query_ms": query_ms}
    return {**cost, "asked_mb": _more(program.before_mb)} if first else cost


def _more(before_mb: float | None) -> float | None:
    """Memory (1e6 bytes) that this process holds beyond what it held before."""
    now_mb = memory_mb("VmRSS")
    return None if before_mb is None or now_mb is None else max(now_mb - before_mb, 0.0)


def _summarize(records: Sequence[Record], queries: int) -> RunningRow:
    line = RunningRow(**in_common(records), queries=queries)
    rows = [row for record in records for row in record.rows if row is not None and row["status"] == PieceStatus.OK]
    if not rows or not all(record.done for record in records):
        return line
    if len(rows) < queries:
        first = next(iter(line.errors.values()), "no answer")
        line = replace(line, reason=f"{queries - len(rows)} of {queries} queries failed, the first: {first}")
    later = [row for row in rows if not row["first"]] or rows
    firsts = [row for row in rows if row["first"]]
    return replace(
        line,
        scenes=rows[0]["scenes"],
        bytes_per_scene=rows[0]["bytes"] / rows[0]["scenes"],
        open_s=_median(firsts, "open_s"),
        opened_mb=_median(firsts, "opened_mb"),
        asked_mb=_median(firsts, "asked_mb"),
        first_ms=float(np.median([row["describe_ms"] + row["query_ms"] for row in firsts])) if firsts else None,
        describe_ms=_median(later, "describe_ms"),
        query_median_ms=_median(later, "query_ms"),
        query_p95_ms=float(np.percentile([row["query_ms"] for row in later], 95)),
    )


def _median(rows: Sequence[Row], name: str) -> float | None:
    """Of the rows that have it: one a process."""
    known = [row[name] for row in rows if row.get(name) is not None]
    return float(np.median(known)) if known else None
