"""The task `scale`: cost and recall of matching in a map of many scenes (graphs of panoramas), compared with exhaustive
matching."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.memory import peak_memory_mb
from salframe.evaluation.runs.records import Part, Survey, by_method
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.run_folder import REQUEST, Run
from salframe.evaluation.runs.task import Task, TaskOptions, Worker
from salframe.evaluation.tasks.scale.measures import summarize_queries
from salframe.evaluation.tasks.scale.rows import SceneRow
from salframe.evaluation.tasks.scale.table import COLUMNS, DEFAULT_COLUMNS, ScaleRow
from salframe.framework.component import ComponentConfig, components_in
from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, MethodUnavailable
from salframe.framework.files.cache import Cache
from salframe.framework.files.columns import read_columns
from salframe.framework.files.reading import check_as
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatch, GraphMatcher
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays, pack_graph
from salframe.graphs.scene_index import SceneCandidates
from salframe.graphs.synthetic_map import SyntheticMap
from salframe.graphs.table import MappedGraphs, write_graphs
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Localizer
from salframe.localization.map_files import INDEX, SCENES, MapParts, read_map, write_map
from salframe.localization.references import complete_references
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d

QUERIES, EXHAUSTIVE = 200, 50
"""Number of queries, and number of these queries that are also matched with all scenes (graphs) of the map."""
SEED = 3
"""Seed of the generated scenes (`SyntheticMap`)."""
MIN_OBJECTS = 3
"""Minimum number of objects of a room from which scenes (graphs of the map) are generated."""
WINDOW = 2000
"""Number of scenes (graphs of the map) that exhaustive matching reads and matches at once."""
NumScenes = Annotated[int, Field(ge=1, le=10_000_000)]
"""Number of scenes (graphs) of a map."""


class ScaleOptions(TaskOptions):
    """Options of a scale study."""

    scenes: tuple[NumScenes, ...] = Field(
        min_length=1, description="list of map sizes, in numbers of reference frames; each size is a row of the table"
    )


@dataclass(frozen=True)
class ScaleTask(Task[int, Survey[int], SceneRow, ScaleRow]):
    """The task `scale`: which of many scenes (graphs of panoramas) of a map does a query show?

    The scenes are generated from the rooms of a data set (`SyntheticMap`). A piece of work is one query. It is
    identified by the index of the scene that it shows. The evaluated method does not receive this index.
    """

    scenes: int

    name = "scale"
    prefix = "scale-"
    counts = "queries"
    key_fields = ("query",)
    row = SceneRow
    line = ScaleRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS
    Options = ScaleOptions

    @classmethod
    def vary(cls, options: TaskOptions) -> list[tuple[dict[str, Any], TaskOptions]]:
        scenes = options.scenes if isinstance(options, ScaleOptions) else ()
        return [({"scenes": count}, ScaleOptions(scenes=(count,))) for count in scenes]

    @classmethod
    def plan(cls, request: Request, options: TaskOptions) -> tuple[ScaleTask, Resolved]:
        if not isinstance(options, ScaleOptions):
            raise TypeError(f"the argument options has the type {type(options).__name__}, expected ScaleOptions")
        if len(options.scenes) != 1:
            raise TypeError(
                f"options.scenes is {list(options.scenes)}, expected a list of one number of panoramas, such as [100]"
            )
        return cls(options.scenes[0]), resolve(request)

    def parameters(self) -> dict[str, Any]:
        return {"scenes": self.scenes}

    @classmethod
    def from_run(cls, run: Run) -> ScaleTask:
        return cls(check_as(run.task.get("scenes"), NumScenes, f"{run.directory / REQUEST}: task.scenes"))

    def survey(self, dataset: Dataset) -> Survey[int]:
        numbers = np.random.default_rng(SEED).permutation(self.scenes)[:QUERIES]
        return Survey(dataset, numbers.tolist())

    def key(self, piece: int) -> tuple[int]:
        return (piece,)

    def open(
        self, label: str, method: Localizer, survey: Survey[int], todo: Sequence[int], folder: Path
    ) -> Worker[int]:
        check_needs(method, survey.dataset)
        exhaustive = set(survey.pieces[:EXHAUSTIVE])
        return _ScaleWorker(method, _matcher_config(method), survey.dataset, self.scenes, exhaustive, folder)

    def summarize(self, parts: Sequence[Part[Survey[int], SceneRow]], seed: int) -> tuple[ScaleRow, ...]:
        return tuple(summarize_queries(records, self.scenes) for records in by_method(parts))


def _matcher_config(method: Localizer) -> ComponentConfig:
    """Return the settings of a localizer's graph matcher. Raises MethodUnavailable without one that uses a scene
    index."""
    for _, config in components_in(method.config):
        if issubclass(config.component, GraphMatcher) and config.component.uses_scene_index:
            return config
    raise MethodUnavailable(
        "the method has no scene index (search over reference frames), expected a method with a scene index, such as "
        "'proposed'"
    )


class _ScaleWorker(Worker[int]):
    """Runs the matcher of a localizer on a map on disk."""

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
        self._map = SyntheticMap(SEED, rooms_of(self._method, self._dataset))
        write_graphs(self._map.scenes(self._count), self._folder / "stream")
        built = self._folder / "map"
        start = time.perf_counter()
        self._build(MappedGraphs(read_columns(self._folder / "stream")), built)
        build_s, memory_mb = time.perf_counter() - start, peak_memory_mb()
        shutil.rmtree(self._folder / "stream")
        read_map(built, self._open)
        self._query(self._index, self._map.query(0))  # imports what the first query imports
        del self._index, self._frames
        built = built.rename(self._folder / "moved")  # so that cached hashes are computed again
        start = time.perf_counter()
        read_map(built, self._open)
        open_s = time.perf_counter() - start
        self._window = _SceneWindow(np.arange(0))
        self._all = read_map(built, self._open_window)
        self._costs = {"build_s": build_s, "build_memory_mb": memory_mb, "bytes": folder_bytes(built), "open_s": open_s}

    def work(self, piece: int) -> Row:
        query = self._map.query(piece)
        start = time.perf_counter()
        best, _ = self._query(self._index, query)
        query_ms = (time.perf_counter() - start) * 1e3
        exhaustive = self._best_of_all(query) == piece if piece in self._exhaustive else None
        result = {"right": best == piece, "right_exhaustive": exhaustive, "query_ms": query_ms}
        return {**result, **self._costs, "status": PieceStatus.OK, "error": None}

    def close(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def _build(self, graphs: Sequence[SaliencyGraph], folder: Path) -> None:
        """Save the map of the graphs to a new folder."""
        with write_map(folder) as parts:
            parts.write_method(self._method)
            parts.write_scenes((pack_graph(graph_to_arrays(graph)) for graph in graphs), _frames(len(graphs)))
            self._matcher.write_index(MappedGraphs(parts.read_scenes()[0]), parts.folder / INDEX)

    def _open(self, parts: MapParts) -> None:
        """Open the map of these parts."""
        packed, self._frames = parts.read_scenes()
        self._index = self._matcher.open_index(MappedGraphs(packed), parts.folder / INDEX)

    def _open_window(self, parts: MapParts) -> Any:
        """Return an index of the map of these parts. It matches a query with all scenes of the current window."""
        graphs = MappedGraphs(parts.read_table(SCENES), self._window)
        return self._matcher.open_index(graphs, parts.folder / INDEX)

    def _query(self, index: Any, query: SaliencyGraph) -> tuple[int | None, np.ndarray | None]:
        """Return the best scene, and T_world_query (4, 4) if the match has a pose."""
        matches = self._matcher.match(query, index, 1)
        if not matches:
            return None, None
        best = matches[0]
        pose = best.T_scene_query
        return best.scene, None if pose is None else self._frames[best.scene].T_world_pano @ pose

    def _best_of_all(self, query: SaliencyGraph) -> int | None:
        """Return the best of all scenes, matched one window at a time."""
        best = GraphMatch(-1, -np.inf, np.zeros((0, 2), np.int64))
        for low in range(0, self._count, WINDOW):
            self._window.scene = np.arange(low, min(low + WINDOW, self._count))
            best = max([best, *self._matcher.match(query, self._all, 1)], key=lambda match: match.score)
        return best.scene


@dataclass
class _SceneWindow:
    """A scene index that returns the same scenes (W,) as candidates for every query."""

    scene: np.ndarray

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """Return the scenes `scene`, whatever the query is."""
        return SceneCandidates(self.scene, np.zeros(len(self.scene)))


def rooms_of(method: Localizer, dataset: Dataset) -> tuple[SaliencyGraph, ...]:
    """Return the graphs that a localizer computes from the scene frames (reference frames in rooms) of a data set.

    Graphs with fewer than MIN_OBJECTS objects are left out. Raises DataError if no graph remains.
    """
    cache = Cache()
    frames = {frame.id: frame for fold in dataset.folds() for frame in fold.references if frame.kind is FrameKind.SCENE}
    described = [describe_frame(method, frame, cache, dataset.content_key)[0] for frame in frames.values()]
    completed = complete_references(method, described, list(frames.values())).descriptions
    rooms = tuple(graph for one in completed if len(graph := graph_from_arrays(one)) >= MIN_OBJECTS)
    if not rooms:
        raise DataError(
            f"in the dataset {dataset.name}, all panoramas of rooms have fewer than {MIN_OBJECTS} objects, expected at "
            f"least one panorama with {MIN_OBJECTS} or more: choose another dataset or detector"
        )
    return rooms


def _frames(count: int) -> Iterator[ReferenceFrame]:
    """Yield the frames of scenes on a grid, ten metres apart, each a different place."""
    for number in range(count):
        y, x = divmod(number, 1000)
        yield ReferenceFrame(f"frame-{number}", f"room-{number}", pose_2d(10.0 * x, 10.0 * y, 0.0), FrameKind.SCENE)
