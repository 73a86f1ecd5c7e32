"""The task `running`: what a saved map costs a program that opens it once and asks it again and again."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.rows import RunningLine
from salframe.evaluation.run import PieceStatus, Row, Run
from salframe.evaluation.task import MethodRow, Part, Record, Survey, Task, Worker, by_method, check_needs, in_common
from salframe.framework.cache import Cache
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import DataError
from salframe.framework.installation import folder_bytes
from salframe.framework.processes import ProcessPool
from salframe.framework.registry import registry
from salframe.framework.worker import in_worker
from salframe.localization.describing import read_config
from salframe.localization.localizer import Localizer
from salframe.localization.saved_map import open_map
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, QueryFrame

QUERIES = 100
"""So many are asked at most."""
COSTS = ("scenes", "bytes", "open_s", "opened_mb", "asked_mb", "first_ms")
"""What is measured once, and stands in every row."""


@dataclass(frozen=True, kw_only=True)
class RunningRow(MethodRow):
    """A method's line: of the saved map of the first fold, scenes, bytes_per_scene with its index and open_s, seconds
    to open it in a process that never saw it; opened_mb and asked_mb, 1e6 bytes of resident memory that opening it and
    the first query bring (None where the process is shared, and elsewhere than on Linux); first_ms, describing and
    answering the first query; of all later ones, medians to describe and to answer, and the 95th percentile of the
    latter."""

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
    """The first queries of a data set's first fold."""

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
        return RunningSurvey(dataset, fold.queries[:QUERIES], fold=fold)

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
    """A map that is saved by another process, opened by this one, and asked."""

    def __init__(self, method: ComponentConfig, survey: RunningSurvey, folder: Path) -> None:
        self._method, self._survey = method, survey
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = Path(tempfile.mkdtemp(prefix="map-", dir=folder))
        self._costs: Row = {}

    def prepare(self, piece: QueryFrame) -> None:
        if self._costs:
            return
        saved, data = self._folder / "map", self._survey.dataset.config
        with ProcessPool(1) as pool:
            contents = (config.model_dump_json() for config in (self._method, data))
            pool.submit(save_first_map, *contents, str(saved)).result()
        before_mb, start = resident_mb(), time.perf_counter()
        self._map = open_map(saved)
        open_s, opened_mb = time.perf_counter() - start, resident_mb()
        describe_ms, query_ms = self._ask(piece)
        found = (len(self._survey.fold.mapping), folder_bytes(saved), open_s)
        memory_mb = (_more(before_mb, opened_mb), _more(before_mb, resident_mb()))
        self._costs = dict(zip(COSTS, (*found, *memory_mb, describe_ms + query_ms), strict=True))

    def work(self, piece: QueryFrame) -> Row:
        describe_ms, query_ms = self._ask(piece)
        asked = {"describe_ms": describe_ms, "query_ms": query_ms}
        return {**asked, **self._costs, "status": PieceStatus.OK, "error": None}

    def close(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def _ask(self, piece: QueryFrame) -> tuple[float, float]:
        """Milliseconds to describe a query, and to answer it."""
        panorama = piece.load()
        description, seconds = self._map.describe_frame(QueryFrame(piece.id, lambda: panorama))
        start = time.perf_counter()
        self._map.answer(description)
        return 1e3 * seconds, 1e3 * (time.perf_counter() - start)


def save_first_map(method: str, data: str, output: str) -> None:
    """Save the map of a data set's first fold that has queries. method, data: configurations as JSON."""
    dataset: Dataset = registry().build("dataset", read_config("dataset", data))
    dataset.prepare(lambda done, total: None)
    localizer: Localizer = registry().build("localizer", read_config("localizer", method))
    fold = RunningTask().survey(dataset).fold
    localizer.build(fold.mapping, Cache(), dataset.content_key, floors=dataset.floors())
    localizer.save(Path(output))


def resident_mb() -> float | None:
    """Memory (1e6 bytes) that this process holds; None in a process shared with other work, and elsewhere than on
    Linux."""
    status = Path("/proc/self/status")
    if not in_worker() or not status.exists():
        return None
    lines = status.read_text(encoding="utf-8").splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("VmRSS"))) * 1024 / 1e6


def _more(before_mb: float | None, after_mb: float | None) -> float | None:
    return None if before_mb is None or after_mb is None else max(after_mb - before_mb, 0.0)


def _summarize(records: Sequence[Record], queries: int) -> RunningRow:
    line = RunningRow(**in_common(records), queries=queries)
    rows = [row for record in records for row in record.rows if row is not None and row["status"] == PieceStatus.OK]
    if not rows or not all(record.done for record in records):
        return line
    median_ms, p95_ms = np.percentile([row["query_ms"] for row in rows], [50, 95])
    costs: dict[str, Any] = {name: float(np.median(known)) for name in COSTS if (known := _known(rows, name))}
    return replace(
        line,
        scenes=round(costs["scenes"]),
        bytes_per_scene=costs["bytes"] / costs["scenes"],
        **{name: cost for name, cost in costs.items() if name not in ("scenes", "bytes")},
        describe_ms=float(np.median([row["describe_ms"] for row in rows])),
        query_median_ms=float(median_ms),
        query_p95_ms=float(p95_ms),
    )


def _known(rows: Sequence[Row], name: str) -> list[float]:
    return [row[name] for row in rows if row.get(name) is not None]
