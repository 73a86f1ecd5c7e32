"""The task `latency`: the latency and memory of a saved map that a program opens once and queries many times."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.memory import memory_mb
from salframe.evaluation.runs.records import Part, Survey, by_method
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.task import Task, Worker
from salframe.evaluation.tasks.latency.measures import summarize_program
from salframe.evaluation.tasks.latency.rows import ProgramRow
from salframe.evaluation.tasks.latency.table import COLUMNS, DEFAULT_COLUMNS, LatencyRow
from salframe.framework.component import ComponentConfig
from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.registry import registry
from salframe.framework.engines.process_pool import ProcessPool
from salframe.framework.errors import DataError, MethodFailed
from salframe.framework.files.cache import Cache
from salframe.localization.described_query import describe_view
from salframe.localization.describing import read_config
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap, open_map
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, QueryFrame
from salframe.panoramas.opening import open_dataset

QUERIES = 100
"""Maximum number of queries, evenly spread over all queries to the map."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LatencySurvey(Survey[QueryFrame]):
    """The queries whose latency is measured, and their fold.

    A fold is a map and its queries. The first fold of the data set that has a query is used.
    """

    fold: Fold


@dataclass(frozen=True)
class LatencyTask(Task[QueryFrame, LatencySurvey, ProgramRow, LatencyRow]):
    """The task `latency`: how much time and memory do opening a map and querying it take?"""

    name = "latency"
    prefix = "latency-"
    counts = "queries"
    key_fields = ("query",)
    row = ProgramRow
    line = LatencyRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS

    def survey(self, dataset: Dataset) -> LatencySurvey:
        fold = next((fold for fold in dataset.folds() if fold.queries), None)
        if fold is None:
            raise DataError(f"the dataset {dataset.name} has no query (panorama to localize), expected at least one")
        step = -(-len(fold.queries) // QUERIES)
        return LatencySurvey(dataset, fold.queries[::step], fold=fold)

    def key(self, piece: QueryFrame) -> tuple[str]:
        return (piece.id,)

    def open(
        self, label: str, method: Localizer, survey: LatencySurvey, todo: Sequence[QueryFrame], folder: Path
    ) -> Worker[QueryFrame]:
        check_needs(method, survey.dataset)
        return _SavedMapWorker(method.config, survey, folder)

    def summarize(self, parts: Sequence[Part[LatencySurvey, ProgramRow]], seed: int) -> tuple[LatencyRow, ...]:
        queries = sum(len(survey.pieces) for survey, _ in parts)
        return tuple(summarize_program(records, queries) for records in by_method(parts))


class _SavedMapWorker(Worker[QueryFrame]):
    """Saves a map in one process, and opens and queries it in another, fresh process."""

    def __init__(self, method: ComponentConfig, survey: LatencySurvey, folder: Path) -> None:
        self._contents = tuple(config.model_dump_json() for config in (method, survey.dataset.config))
        self._scenes = len(survey.fold.references)
        folder.mkdir(parents=True, exist_ok=True)
        for leftover in folder.glob("map-*"):  # of a process that was killed
            shutil.rmtree(leftover, ignore_errors=True)
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
        cost = _result(self._program.submit(_query_program, piece.id))
        return {**self._costs, **cost, "status": PieceStatus.OK, "error": None}

    def close(self) -> None:
        self._program.stop()
        shutil.rmtree(self._folder, ignore_errors=True)


def _result(future: Future[Any]) -> Any:
    """Return the result of work in a process. Raises its exception, or MethodFailed if the process died."""
    try:
        return future.result()
    except BrokenProcessPool:
        raise MethodFailed("the process that opened the map ended before it answered: run the command again") from None


def save_first_map(method: str, data: str, output: str) -> None:
    """Save the map of the first fold (a map and its queries) of a data set that has queries.

    Args:
        method: Configuration of the localizer as JSON.
        data: Configuration of the data set as JSON.
        output: The folder of the map.

    Raises:
        SalframeError: The map cannot be built or saved.
    """
    dataset = open_dataset(read_config("dataset", data))
    localizer: Localizer = registry().build("localizer", read_config("localizer", method))
    fold = LatencyTask().survey(dataset).fold
    built = LocalizationMap.build(localizer, fold.references, Cache(), dataset.content_key, floors=dataset.floors())
    built.save(output)


@dataclass
class _Program:
    """The state of a program: its map, the queries by id, its memory before it opened the map (1e6 bytes), and whether
    it has answered a query."""

    opened: LocalizationMap
    queries: Mapping[str, QueryFrame]
    before_mb: float | None
    has_answered: bool = False


_programs: list[_Program] = []
"""The simulated program of this process that opened the map and queries it; at most one."""


def _open_program(data: str, saved: str) -> Row:
    """Open a saved map in this process. Return the time and the memory that this takes."""
    queries = {query.id: query for query in LatencyTask().survey(open_dataset(read_config("dataset", data))).pieces}
    before_mb, start = memory_mb("VmRSS"), time.perf_counter()
    opened = open_map(saved)
    open_s = time.perf_counter() - start
    _programs[:] = [_Program(opened, queries, before_mb)]
    return {"open_s": open_s, "opened_mb": _more(before_mb)}


def _query_program(query: str) -> Row:
    """Query the map. Return the times and, for the first query, the memory, which includes the query's panorama."""
    (program,) = _programs
    panorama = program.queries[query].load()
    view = describe_view(program.opened.localizer, QueryFrame(query, lambda: panorama))
    described = program.opened.describe_query([view])
    start = time.perf_counter()
    program.opened.answer_query(described)
    query_ms = 1e3 * (time.perf_counter() - start)
    first, program.has_answered = not program.has_answered, True
    cost = {"first": first, "describe_ms": 1e3 * described.seconds, "query_ms": query_ms}
    return {**cost, "queried_mb": _more(program.before_mb)} if first else cost


def _more(before_mb: float | None) -> float | None:
    """Return the increase of the memory of this process (1e6 bytes); None if it is unknown."""
    now_mb = memory_mb("VmRSS")
    return None if before_mb is None or now_mb is None else max(now_mb - before_mb, 0.0)
