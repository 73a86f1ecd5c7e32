"""The task `scale`: what matching costs in a map of many scenes, and whether it finds what matching all of them
does."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.runs.rows import ScaleLine
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
from salframe.evaluation.statistics import proportion_interval
from salframe.evaluation.tasks.localization.answering import peak_memory_mb
from salframe.framework.cache import Cache
from salframe.framework.columns import read_columns
from salframe.framework.config import ComponentConfig, components_in
from salframe.framework.errors import DataError, MethodUnavailable
from salframe.framework.installation import folder_bytes
from salframe.framework.registry import registry
from salframe.graphs.city import City
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatch, GraphMatcher
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays, pack_graph
from salframe.graphs.scene_index import SceneCandidates
from salframe.graphs.table import MappedGraphs, write_graphs
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Localizer
from salframe.localization.map_files import INDEX, SCENES, MapParts, read_map, write_map
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import FrameKind, MapFrame
from salframe.panoramas.geometry import pose_2d

QUERIES, EXHAUSTIVE = 200, 50
"""So many scenes are asked for, and so many of them of all scenes one by one as well."""
SEED = 3
"""Of the city."""
LEAST_OBJECTS = 3
"""A room with fewer furnishes no scene."""
WINDOW = 2000
"""So many scenes are matched at once where all are."""


@dataclass(frozen=True, kw_only=True)
class ScaleRow(MethodRow):
    """A method's line: seconds to save the map of scenes on disk and to open it, most memory while saving (1e6 bytes,
    None where the process is shared), bytes a scene of the saved map, milliseconds of a query with the best's pose, the
    share of queries whose scene is the best match, and of those that were also matched with all scenes, both shares,
    each with Wilson's 95 % interval."""

    scenes: int
    build_s: float | None = None
    build_memory_mb: float | None = None
    bytes_per_scene: float | None = None
    open_s: float | None = None
    query_median_ms: float | None = None
    query_p95_ms: float | None = None
    recall_at_1: float | None = None
    recall_at_1_low: float | None = None
    recall_at_1_high: float | None = None
    recall_at_1_both: float | None = None
    recall_at_1_both_low: float | None = None
    recall_at_1_both_high: float | None = None
    recall_at_1_exhaustive: float | None = None
    recall_at_1_exhaustive_low: float | None = None
    recall_at_1_exhaustive_high: float | None = None

    @property
    def measured(self) -> bool:
        return self.query_median_ms is not None


@dataclass(frozen=True)
class ScaleTask(Task[int, Survey[int]]):
    """Which of many scenes was seen again? They are made of the rooms of a data set (`City`); a piece is a scene's
    number."""

    scenes: int

    name = "scale"
    prefix = "scale-"
    counts = "queries"
    key_fields = ("query",)
    row = ScaleLine

    def asks(self) -> dict[str, Any]:
        return {"scenes": self.scenes}

    @classmethod
    def from_run(cls, run: Run) -> ScaleTask:
        return cls(int(run.task["scenes"]))

    def survey(self, dataset: Dataset) -> Survey[int]:
        numbers = np.random.default_rng(SEED).permutation(self.scenes)[:QUERIES]
        return Survey(dataset, numbers.tolist())

    def key(self, piece: int) -> tuple[int]:
        return (piece,)

    def open(
        self, label: str, method: Localizer, survey: Survey[int], todo: Sequence[int], folder: Path
    ) -> Worker[int]:
        check_needs(method, survey.dataset)
        alone = set(survey.pieces[:EXHAUSTIVE])
        return _Asking(method, _matcher_config(method), survey.dataset, self.scenes, alone, folder)

    def summarize(self, parts: Sequence[Part[Survey[int]]], seed: int) -> tuple[ScaleRow, ...]:
        return tuple(_summarize(records, self.scenes) for records in by_method(parts))


def _matcher_config(method: Localizer) -> ComponentConfig:
    """Return the settings of a localizer's graph matcher. Raises MethodUnavailable without one that uses a scene
    index."""
    for _, config in components_in(method.config):
        if issubclass(config.component, GraphMatcher) and config.component.uses_scene_index:
            return config
    raise MethodUnavailable("has no matcher that looks scenes up in an index")


class _Asking(Worker[int]):
    """A localizer's matcher on a map on disk."""

    def __init__(
        self,
        method: Localizer,
        matcher: ComponentConfig,
        dataset: Dataset,
        scenes: int,
        exhaustive: set[int],
        folder: Path,
    ) -> None:
        self._method, self._dataset, self._count, self._exhaustive = method, dataset, scenes, exhaustive
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = Path(tempfile.mkdtemp(prefix="map-", dir=folder))
        self._matcher: GraphMatcher = registry().build(GraphMatcher.role, matcher)
        self._costs: Row = {}

    def prepare(self, piece: int) -> None:
        if self._costs:
            return
        self._city = City(SEED, rooms_of(self._method, self._dataset))
        write_graphs(self._city.scenes(self._count), self._folder / "stream")
        built = self._folder / "map"
        start = time.perf_counter()
        self._build(MappedGraphs(read_columns(self._folder / "stream")), built)
        build_s, memory_mb = time.perf_counter() - start, peak_memory_mb()
        shutil.rmtree(self._folder / "stream")
        read_map(built, self._open)
        self._ask(self._index, self._city.query(0))  # imports what the first query imports
        del self._index, self._frames
        built = built.rename(self._folder / "moved")  # so that hashes that are remembered are computed again
        start = time.perf_counter()
        read_map(built, self._open)
        open_s = time.perf_counter() - start
        self._window = _Window(np.arange(0))
        self._all = read_map(built, self._open_window)
        self._costs = {"build_s": build_s, "build_memory_mb": memory_mb, "bytes": folder_bytes(built), "open_s": open_s}

    def work(self, piece: int) -> Row:
        query = self._city.query(piece)
        start = time.perf_counter()
        best, _ = self._ask(self._index, query)
        query_ms = (time.perf_counter() - start) * 1e3
        exhaustive = self._best_of_all(query) == piece if piece in self._exhaustive else None
        found = {"right": best == piece, "right_exhaustive": exhaustive, "query_ms": query_ms}
        return {**found, **self._costs, "status": PieceStatus.OK, "error": None}

    def close(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def _build(self, graphs: Sequence[SaliencyGraph], folder: Path) -> None:
        """Save the map of graphs on disk to a new folder."""
        with write_map(folder) as parts:
            parts.write_method(self._method)
            parts.write_scenes((pack_graph(graph_to_arrays(graph)) for graph in graphs), _frames(len(graphs)))
            self._matcher.write_index(MappedGraphs(parts.read_scenes()[0]), parts.folder / INDEX)

    def _open(self, parts: MapParts) -> None:
        """Take in the map of these parts."""
        packed, self._frames = parts.read_scenes()
        self._index = self._matcher.open_index(MappedGraphs(packed), parts.folder / INDEX)

    def _open_window(self, parts: MapParts) -> Any:
        """The map of these parts, of which all scenes of a window are matched."""
        graphs = MappedGraphs(parts.read_table(SCENES), self._window)
        return self._matcher.open_index(graphs, parts.folder / INDEX)

    def _ask(self, index: Any, query: SaliencyGraph) -> tuple[int | None, np.ndarray | None]:
        """The scene that is the best match, and T_world_query (4, 4) if that has a pose."""
        matches = self._matcher.match(query, index, 1)
        if not matches:
            return None, None
        best = matches[0]
        seen = best.T_scene_query
        return best.scene, None if seen is None else self._frames[best.scene].T_world_pano @ seen

    def _best_of_all(self, query: SaliencyGraph) -> int | None:
        """The scene that is the best match of all, a window of them at a time."""
        best = GraphMatch(-1, -np.inf, np.zeros((0, 2), np.int64))
        for low in range(0, self._count, WINDOW):
            self._window.scene = np.arange(low, min(low + WINDOW, self._count))
            best = max([best, *self._matcher.match(query, self._all, 1)], key=lambda match: match.score)
        return best.scene


@dataclass
class _Window:
    """Scenes (W,) that are candidates of every query."""

    scene: np.ndarray

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """All of them."""
        return SceneCandidates(self.scene, np.zeros(len(self.scene)))


def rooms_of(method: Localizer, dataset: Dataset) -> tuple[SaliencyGraph, ...]:
    """The graphs of a data set's scene frames as a localizer describes them, of those with LEAST_OBJECTS. Raises
    DataError where there is none."""
    cache = Cache()
    frames = {frame.id: frame for fold in dataset.folds() for frame in fold.mapping if frame.kind is FrameKind.SCENE}
    described = (describe_frame(method, frame, cache, dataset.content_key)[0] for frame in frames.values())
    rooms = tuple(graph for one in described if len(graph := graph_from_arrays(one)) >= LEAST_OBJECTS)
    if not rooms:
        raise DataError(f"{dataset.name} has no scene frame with {LEAST_OBJECTS} objects, expected some")
    return rooms


def _frames(count: int) -> Iterator[MapFrame]:
    """Scenes side by side, ten metres apart, each a place of its own."""
    for number in range(count):
        y, x = divmod(number, 1000)
        yield MapFrame(f"frame-{number}", f"room-{number}", pose_2d(10.0 * x, 10.0 * y, 0.0), FrameKind.SCENE)


def _summarize(records: Sequence[Record], scenes: int) -> ScaleRow:
    line = ScaleRow(**in_common(records), scenes=scenes)
    rows = [row for record in records for row in record.rows if row is not None and row["status"] == PieceStatus.OK]
    if not rows or not all(record.done for record in records):
        return line
    both = [row for row in rows if row["right_exhaustive"] is not None]
    failed = sum(len(record.rows) for record in records) - len(rows)  # which are not right
    median_ms, p95_ms = np.percentile([row["query_ms"] for row in rows], [50, 95])
    return replace(
        line,
        **{name: rows[-1][name] for name in ("build_s", "build_memory_mb", "open_s")},
        bytes_per_scene=rows[-1]["bytes"] / scenes,
        query_median_ms=float(median_ms),
        query_p95_ms=float(p95_ms),
        **_recall("recall_at_1", [row["right"] for row in rows] + [False] * failed),
        **_recall("recall_at_1_both", [row["right"] for row in both]),
        **_recall("recall_at_1_exhaustive", [row["right_exhaustive"] for row in both]),
    )


def _recall(name: str, right: Sequence[bool]) -> dict[str, Any]:
    """The share of queries, each of a scene of its own, that are right, and its interval; nothing of none."""
    if not right:
        return {}
    low, high = proportion_interval(np.array(right), [str(number) for number in range(len(right))])
    return {name: float(np.mean(right)), f"{name}_low": low, f"{name}_high": high}
