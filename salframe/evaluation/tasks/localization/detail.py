"""Details of each query: the objects that a method described, its matches with reference frames, and the terms of its
scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import numpy as np
from pydantic import BaseModel

from salframe.evaluation.report.arms import Arm, Entry
from salframe.evaluation.report.page import numbers
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.tasks.localization.queries import xy_yaw
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.view import LocalizationView
from salframe.framework.components.registry import registry
from salframe.framework.errors import FRAME_ERRORS, SalframeError
from salframe.framework.files.cache import Cache
from salframe.framework.files.hashes import digest
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import GRAPH_ARRAYS, graph_from_arrays
from salframe.localization.answers import NodeMatches, PointMatches
from salframe.localization.described_query import describe_view
from salframe.localization.describing import describe_frame
from salframe.localization.evidence import Evidence
from salframe.localization.level_frames import correspond
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.references import complete_references
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.opening import Progress

MAX_POINTS = 60
"""Maximum number of point matches that are drawn of a pair of panoramas, spread evenly over all."""
Json = dict[str, Any]


@dataclass(frozen=True, eq=False)
class QuerySet:
    """A data set and its queries. A query is a pair of its fold (which contains the map) and its frame. The order is
    the order of `LocalizationView.queries`."""

    dataset: Dataset
    queries: Sequence[tuple[Fold, QueryFrame]]


@dataclass(eq=False)
class Details:
    """Details of the queries of one data set.

    Attributes:
        queries: For each query, the objects that methods detected in it, and details of the answer of each arm (a
            method with its settings). A describer is a hash that identifies how a method describes panoramas. The
            objects are stored by describer.
        frames: For each reference frame that the details refer to, by id: its objects by describer, for JSON.
        map_frames: The ReferenceFrame of each entry of `frames`, by id.
        notes: Notes on details that are missing.
    """

    queries: list[Json]
    frames: dict[str, Json] = field(default_factory=dict)
    map_frames: dict[str, ReferenceFrame] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def find_details(
    query_set: QuerySet,
    group: Sequence[int],
    arms: Sequence[Arm],
    views: Sequence[LocalizationView],
    progress: Progress | None = None,
) -> Details:
    """Return details of the answers of all arms (methods with their settings) to the queries of runs on the same data.
    `group` contains the indices of these runs in `views`."""
    details = Details([{"objects": {}, "arms": {}} for _ in query_set.queries])
    for number, arm in enumerate(arms):
        for entry in arm.entries:
            if entry.run in group and views[entry.run].records[entry.method].done:
                try:
                    _look(details, query_set, number, arm, entry, views[entry.run], progress)
                except SalframeError as error:
                    details.notes.append(f"{arm.name}: the report has no details of the answers: {error}")
    return details


def _look(
    details: Details,
    query_set: QuerySet,
    number: int,
    arm: Arm,
    entry: Entry,
    view: LocalizationView,
    progress: Progress | None,
) -> None:
    localizer: Localizer = registry().build("localizer", Run.load(view.result.run).method(arm.label, "localizer"))
    method = _Method(localizer, query_set.dataset, details)
    rows, truths, judged = view.records[entry.method].rows, view.queries.truths, view.judged[entry.method]
    numbered = enumerate(query_set.queries)
    for _, queries in groupby(numbered, key=lambda one: one[1][0].id):
        fold: Fold | None = None
        for i, (fold_of_query, frame) in queries:
            if progress:
                progress(arm.name, i, len(rows))
            if fold is None:
                fold = fold_of_query
                method.take(fold)
            try:
                details.queries[i]["arms"][str(number)] = method.look(
                    details.queries[i], frame, rows[i], truths[i], bool(judged.correct[i])
                )
            except FRAME_ERRORS:
                continue
    if progress:
        progress(arm.name, len(rows), len(rows))


class _Method:
    """A localizer and its descriptions of the frames of a data set."""

    def __init__(self, localizer: Localizer, dataset: Dataset, details: Details) -> None:
        self._localizer, self._dataset, self._details = localizer, dataset, details
        self._cache, self._descriptions = Cache(), dict[str, Description]()
        self._describer = digest(localizer.describe_identity())[:8]
        weights = getattr(localizer.config, "weights", None)
        self._weights: dict[str, float] = dict(weights) if isinstance(weights, BaseModel | Mapping) else {}
        self._frames: dict[str, ReferenceFrame] = {}

    def take(self, fold: Fold) -> None:
        """Describe the reference frames of a fold (compute their features).

        If the localizer explains its scores by evidence, also build its map of the frames.
        """
        usable = {}
        for frame in fold.references:
            try:
                self._describe(frame)
            except FRAME_ERRORS:
                continue
            usable[frame.id] = frame
        described = [self._descriptions[id] for id in usable]
        references = complete_references(self._localizer, described, list(usable.values()))
        self._frames = {frame.id: frame for frame in references.frames}
        self._descriptions.update(zip(self._frames, references.descriptions, strict=True))
        if self._weights and self._frames:
            floors = self._dataset.floors()
            self._localizer = LocalizationMap.from_descriptions(
                self._localizer, references.descriptions, references.frames, floors
            ).localizer

    def look(self, query: Json, frame: QueryFrame, row: AnswerRow | None, truth: Truth, correct: bool) -> Json:
        """Return the details of an answer.

        Also add the objects of the query to `query`. Add the frame of the answer and, if the answer is wrong, a frame
        of the true place to the frames of the report, with their objects.
        """
        description = self._describe_query(frame, row)
        objects = describe_objects(description)
        if objects is not None:
            query["objects"][self._describer] = objects
        pairs = []
        for kind, reference in self._references(row, truth, correct):
            matches = correspond(self._localizer, description, self._descriptions[reference.id])
            pairs.append({"kind": kind, "frame": reference.id, **_matched(matches)})
            self._show(reference)
            if isinstance(matches, NodeMatches) and objects is None:
                query["objects"][self._describer] = _points(matches.query_m, description)
                frame_objects = self._details.frames[reference.id]["objects"]
                frame_objects[self._describer] = _points(matches.reference_m, self._descriptions[reference.id])
        evidence = self._localizer.evidence(description) if self._weights else None
        return {
            "describer": self._describer,
            "references": pairs,
            "evidence": None if evidence is None or row is None else self._weigh(evidence, row, truth, correct),
        }

    def _describe_query(self, frame: QueryFrame, row: AnswerRow | None) -> Description:
        """Return the description that gave the answer. If the camera hangs upside down in the answer, this is the
        description of the turned panorama."""
        view = describe_view(self._localizer, frame, self._cache, self._dataset.content_key)
        pose = None if row is None else row.pose_matrix
        is_turned = pose is not None and pose[2, 2] < 0 and self._localizer.level != "off"
        return view.describe_turned()[0] if is_turned else view.description

    def _describe(self, frame: ReferenceFrame) -> Description:
        if frame.id not in self._descriptions:
            self._descriptions[frame.id] = describe_frame(
                self._localizer, frame, self._cache, self._dataset.content_key
            )[0]
        return self._descriptions[frame.id]

    def _references(self, row: AnswerRow | None, truth: Truth, correct: bool) -> Iterator[tuple[str, ReferenceFrame]]:
        """Yield the frame that the answer ranks first and, if the answer is wrong, a frame of the true place.

        The frame of the true place is the one that the answer ranks best. If the answer ranks none of them, the frame
        nearest to the true pose is used.
        """
        places = row.places if row is not None else ()
        if places and places[0].frame in self._frames:
            yield "answer", self._frames[places[0].frame]
        frames_of_place = [frame for frame in self._frames.values() if frame.place == truth.place]
        if correct or not frames_of_place:
            return
        ranked = [self._frames[one.frame] for one in places if one.place == truth.place and one.frame in self._frames]
        if not ranked and truth.T_world_pano is not None:
            position_m = truth.T_world_pano[:3, 3]
            frames_of_place.sort(key=lambda frame: float(np.linalg.norm(frame.T_world_pano[:3, 3] - position_m)))
        yield "truth", (ranked or frames_of_place)[0]

    def _show(self, frame: ReferenceFrame) -> None:
        shown = self._details.frames.setdefault(
            frame.id, {"id": frame.id, "place": frame.place, "pose": xy_yaw(frame.T_world_pano), "objects": {}}
        )
        self._details.map_frames[frame.id] = frame
        objects = describe_objects(self._descriptions[frame.id])
        if objects is not None:
            shown["objects"][self._describer] = objects

    def _weigh(self, evidence: Evidence, row: AnswerRow, truth: Truth, correct: bool) -> Json | None:
        """Return the evidence for the answered place and for the true place, each by its best hypothesis.

        If the answer is correct, the second place of the answer replaces the true place.
        """
        scores = evidence.place_scores(self._weights)
        answer = row.places[0].place if row.places else None
        other_place = truth.place if not correct else row.places[1].place if len(row.places) > 1 else None
        shown = [name for name in dict.fromkeys((answer, other_place)) if name in scores]
        if not shown:
            return None
        values = evidence.scores(self._weights)
        places = []
        for name in shown:
            best = max((k for k, place in enumerate(evidence.places) if place == name), key=lambda k: values[k])
            parts = numbers(np.array([evidence.values[name][best] for name in self._weights]), 3)
            places.append({"place": name, "values": parts, "score": round(scores[name], 3)})
        return {"parts": [*self._weights], "weights": numbers(np.array([*self._weights.values()]), 3), "places": places}


def describe_objects(description: Mapping[str, np.ndarray]) -> Json | None:
    """Return the objects of a described saliency graph for JSON; None if the description holds no graph.

    The keys are "labels", "saliency", "edges" and "box": x, y, z, length, width, height in metres and yaw in radians.
    If only bearings are known, "bearing" replaces "box".
    """
    if not description.keys() >= GRAPH_ARRAYS:
        return None
    graph: SaliencyGraph = graph_from_arrays(description)
    objects = {"labels": list(graph.labels), "saliency": numbers(graph.saliency), "edges": graph.edges.tolist()}
    if graph.bearings_only:
        return {**objects, "bearing": numbers(graph.bearing)}
    return {**objects, "box": numbers(np.column_stack([graph.centroid_m, graph.size_m, graph.yaw_rad]), 2)}


def _points(centroid_m: np.ndarray, description: Mapping[str, np.ndarray]) -> Json:
    """Return objects for JSON of which only the positions are known. They have labels if the description has a label
    for each object."""
    names = [str(name) for name in description.get("labels", ())]
    if len(names) != len(centroid_m):
        names = [""] * len(centroid_m)
    nowhere = np.zeros((len(centroid_m), 4))
    return {"labels": names, "saliency": None, "edges": [], "box": numbers(np.column_stack([centroid_m, nowhere]), 2)}


def _matched(matches: NodeMatches | PointMatches | None) -> Json:
    """Return matches for JSON: pairs of object indices, or azimuth and elevation of points in both panoramas."""
    if isinstance(matches, NodeMatches):
        return {"pairs": matches.pairs.tolist()}
    if matches is None:
        return {}
    selected = np.unique(np.linspace(0, len(matches.query) - 1, MAX_POINTS).astype(int))[: len(matches.query)]
    angles = [angle[selected] for one in (matches.query, matches.reference) for angle in _angles(one)]
    return {"points": numbers(np.column_stack(angles)), "matched": len(matches.query)}


def _angles(bearing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.arctan2(bearing[:, 1], bearing[:, 0]), np.arcsin(np.clip(bearing[:, 2], -1, 1))
