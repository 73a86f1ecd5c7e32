"""The task `matching`: are the points, or the objects, that a method matches the same ones? Independent of retrieval
(method.md, Metrics).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.result import Result
from salframe.evaluation.runs.rows import PairRow
from salframe.evaluation.runs.run_folder import PieceStatus, Row, Run
from salframe.evaluation.runs.runner import run_task
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
from salframe.evaluation.statistics import bootstrap_interval
from salframe.framework.cache import Cache
from salframe.framework.errors import DataError, InputMissing, InvalidAnswer, MethodUnavailable
from salframe.graphs.annotated import annotated_objects
from salframe.localization.answers import NodeMatches, PointMatches
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import FrameKind, MapFrame, QueryFrame
from salframe.panoramas.geometry import invert_pose, sample_nearest, transform_points
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama

THRESHOLDS_PX = (1, 3, 5)
PIXEL_RAD = 2 * np.pi / 1024
"""Errors of points are great-circle angles in pixels of a panorama 1024 pixels wide, whatever its own width."""
RANGE_TOLERANCE = 0.05
"""A point is hidden from the reference where the reference sees something at another range, by more than this share."""
NODE_RADIUS_M = 0.5
"""A node belongs to no object whose centroid is further away."""


@dataclass(frozen=True, kw_only=True)
class MatchingRow(MethodRow):
    """A method's line. `kind` is "points" (mma_1, mma_3, mma_5: mean matching accuracy; pairs_without_match) or "nodes"
    (precision, recall, true_per_pair): the two are different quantities. All are means over the pairs of panoramas;
    `_low` and `_high`: 95 % intervals, of pairs clustered by place.
    """

    pairs: int
    kind: str | None = None
    matches_per_pair: float | None = None
    mma_1: float | None = None
    mma_1_low: float | None = None
    mma_1_high: float | None = None
    mma_3: float | None = None
    mma_3_low: float | None = None
    mma_3_high: float | None = None
    mma_5: float | None = None
    mma_5_low: float | None = None
    mma_5_high: float | None = None
    pairs_without_match: int | None = None
    precision: float | None = None
    precision_low: float | None = None
    precision_high: float | None = None
    recall: float | None = None
    recall_low: float | None = None
    recall_high: float | None = None
    true_per_pair: float | None = None

    @property
    def measured(self) -> bool:
        return self.kind is not None


@dataclass(frozen=True, eq=False)
class FramePair:
    """A query of a fold, a mapping frame of the same place, and the true pose of the query in the frame's axes,
    T_reference_query (4, 4).
    """

    fold: str
    query: QueryFrame
    reference: MapFrame
    T_reference_query: np.ndarray


def measure_matching(request: Request, *, progress: Progress | None = None) -> Result[MatchingRow]:
    """Match each query with the scene frame of its own place that is nearest to it; a run that was begun is resumed.

    Raises SalframeError on names and settings that are wrong, and where the data set tells no ranges or poses.
    """
    return run_task(MatchingTask(), request, resolve(request), progress=progress)


@dataclass(frozen=True)
class MatchingTask(Task[FramePair, Survey[FramePair]]):
    """What is the same in a query and in the nearest frame of its place?"""

    name = "matching"
    prefix = "matching-"
    counts = "pairs"
    key_fields = ("fold", "query")
    row = PairRow

    @classmethod
    def from_run(cls, run: Run) -> MatchingTask:
        return cls()

    def survey(self, dataset: Dataset) -> Survey[FramePair]:
        if "range" not in dataset.provides:
            raise InputMissing(f"matching accuracy needs panoramas with range, which {dataset.name} does not have")
        pairs = choose_pairs(dataset)
        left_out = sum(len(fold.queries) for fold in dataset.folds()) - len(pairs)
        note = f"{left_out} queries left out: their place has no scene frame in the map"
        return Survey(dataset, pairs, (note,) if left_out else ())

    def key(self, piece: FramePair) -> tuple[str, str]:
        return piece.fold, piece.query.id

    def open(
        self, label: str, method: Localizer, survey: Survey[FramePair], todo: Sequence[FramePair], folder: Path
    ) -> Worker[FramePair]:
        check_needs(method, survey.dataset)
        return _Matching(method, survey.dataset.content_key)

    def summarize(self, parts: Sequence[Part[Survey[FramePair]]], seed: int) -> tuple[MatchingRow, ...]:
        places = [f"{part}: {pair.reference.place}" for part, (survey, _) in enumerate(parts) for pair in survey.pieces]
        return tuple(_summarize(records, places, seed) for records in by_method(parts))


class _Matching(Worker[FramePair]):
    """A localizer that matches pairs of panoramas."""

    def __init__(self, localizer: Localizer, dataset: str) -> None:
        self._localizer, self._dataset, self._cache = localizer, dataset, Cache()
        self._kind: type[PointMatches | NodeMatches] | None = None

    def work(self, piece: FramePair) -> Row:
        query, reference = (
            describe_frame(self._localizer, frame, self._cache, self._dataset)[0]
            for frame in (piece.query, piece.reference)
        )
        found = self._localizer.correspond(query, reference)
        if found is None:
            raise MethodUnavailable("matches neither points nor objects")
        if not isinstance(found, PointMatches | NodeMatches):
            raise InvalidAnswer(f"correspond gave {type(found).__name__}, expected PointMatches, NodeMatches or None")
        if self._kind not in (None, type(found)):
            raise InvalidAnswer(f"correspond gave {type(found).__name__}, expected one kind of matches for all pairs")
        self._kind = type(found)
        row = check_matches(found, piece.query.load(), piece.reference.load(), piece.T_reference_query)
        return {"reference": piece.reference.id, **row, "status": PieceStatus.OK, "error": None}


def choose_pairs(dataset: Dataset) -> list[FramePair]:
    """Each query with the nearest scene frame of its place. Raises DataError where there is none, or a query's true
    pose is not known.
    """
    pairs = []
    for fold in dataset.folds():
        scenes: dict[str, list[MapFrame]] = {}
        for frame in fold.mapping:
            if frame.kind is FrameKind.SCENE:
                scenes.setdefault(frame.place, []).append(frame)
        for query in fold.queries:
            truth = dataset.truth(query.id)
            if truth.T_world_pano is None:
                raise DataError(f"the true pose of {query.id} is not known, expected one for every query")
            if truth.place in scenes:
                at_m, near = truth.T_world_pano[:3, 3], scenes[truth.place]
                distances_m = [float(np.linalg.norm(frame.T_world_pano[:3, 3] - at_m)) for frame in near]
                reference = near[int(np.argmin(distances_m))]
                T_reference_query = invert_pose(reference.T_world_pano) @ truth.T_world_pano
                pairs.append(FramePair(fold.id, query, reference, T_reference_query))
    if not pairs:
        raise DataError(f"{dataset.name} has no query whose place has a scene frame, expected at least one")
    return pairs


def check_matches(
    found: PointMatches | NodeMatches, query: Panorama, reference: Panorama, T_reference_query: np.ndarray
) -> Row:
    """What is counted of a pair: "kind", "matches", and for points "judged" and "within_px", a number for each of
    THRESHOLDS_PX; for nodes "correct" and "true", the objects that are nodes of both graphs. Raises InputMissing where
    a panorama lacks what tells.
    """
    if isinstance(found, PointMatches):
        errors_px = point_errors_px(found, query, reference, T_reference_query)
        within = [int((errors_px <= threshold).sum()) for threshold in THRESHOLDS_PX]
        return {"kind": "points", "matches": len(found.query), "judged": len(errors_px), "within_px": within}
    seen, known = own_objects(found.query_m, query), own_objects(found.reference_m, reference)
    matched = seen[found.pairs[:, 0]]
    correct = int(((matched > 0) & (matched == known[found.pairs[:, 1]])).sum())
    return {
        "kind": "nodes",
        "matches": len(found.pairs),
        "correct": correct,
        "true": len(np.intersect1d(seen[seen > 0], known[known > 0])),
    }


def point_errors_px(
    matches: PointMatches, query: Panorama, reference: Panorama, T_reference_query: np.ndarray
) -> np.ndarray:
    """(K,) float64 errors of the K matches that can be judged, great-circle angles in pixels of PIXEL_RAD.

    A query's point is lifted by the range seen there and moved by the true pose (4, 4); its error is the angle between
    that and the matched bearing. Left out are points without range and points that the reference does not see,
    RANGE_TOLERANCE. Raises InputMissing without ranges.
    """
    if query.range_m is None or reference.range_m is None:
        raise InputMissing(
            f"{query.id if query.range_m is None else reference.id} has no range, by which matches are judged"
        )
    range_m = sample_nearest(query.range_m, matches.query)
    points_m = transform_points(T_reference_query, matches.query * range_m[:, None])
    expected_m = np.linalg.norm(points_m, axis=1)
    with np.errstate(invalid="ignore"):  # comparisons with an unknown range are false
        seen = np.isfinite(expected_m)
        seen[seen] = (
            np.abs(sample_nearest(reference.range_m, points_m[seen]) - expected_m[seen])
            <= RANGE_TOLERANCE * expected_m[seen]
        )
    points_m, bearings = points_m[seen], matches.reference[seen]
    angle = np.arctan2(np.linalg.norm(np.cross(points_m, bearings), axis=1), (points_m * bearings).sum(1))
    return angle / PIXEL_RAD


def own_objects(centroid_m: np.ndarray, panorama: Panorama) -> np.ndarray:
    """(N,) int64 instance ids of the annotated objects that nodes (N, 3) stand for, 0 for none.

    An object lies where a detector without error sees it. One to one, the most closeness in all, no pair further than
    NODE_RADIUS_M. Raises InputMissing where the panorama has no instance image or no range.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    if panorama.annotations is None or panorama.annotations.instance_id is None:
        raise InputMissing(f"{panorama.id} has no instance image, by which matched objects are judged")
    objects = annotated_objects(panorama)
    owner_m = np.array([one.points_m.mean(0, dtype=np.float64) for one in objects]).reshape(-1, 3)
    closeness = np.nan_to_num(np.maximum(NODE_RADIUS_M - cdist(centroid_m, owner_m), 0))  # NaN: not known where
    nodes, owners = linear_sum_assignment(closeness, maximize=True)
    near = closeness[nodes, owners] > 0
    own = np.zeros(len(centroid_m), np.int64)
    own[nodes[near]] = np.array([one.key for one in objects], np.int64)[owners[near]]
    return own


def _summarize(records: Sequence[Record], places: Sequence[str], seed: int) -> MatchingRow:
    """A method's line; places (P,): those of the pairs. A pair that failed counts as one in which nothing was right."""
    pairs = len(places)
    line = MatchingRow(**in_common(records), pairs=pairs)
    if not all(record.done for record in records):
        return line
    rows = [row for record in records for row in record.rows]
    known = [row for row in rows if row is not None]
    good, failed = ([row for row in known if (row["status"] == PieceStatus.OK) == ok] for ok in (True, False))
    if failed:
        line = replace(line, reason=f"{len(failed)} pair(s) failed, the first: {failed[0]['error']}")
    if not good:
        return line
    if len({row["kind"] for row in good}) > 1:
        return replace(line, reason="matched points in some pairs and nodes in others")
    kind, matches = good[0]["kind"], sum(row["matches"] for row in good) / pairs
    done = np.array([row is not None and row["status"] == PieceStatus.OK for row in rows])
    shares, others = (_points if kind == "points" else _nodes)(good, done)
    means = {key: value for name, share in shares.items() for key, value in _mean(name, *share, places, seed).items()}
    return replace(line, kind=kind, matches_per_pair=matches, **others, **means)


Share = tuple[np.ndarray, np.ndarray]
"""Of each of P pairs, failures among them, a share (P,) float64, and (P,) bool whether it counts."""


def _points(rows: Sequence[Row], done: np.ndarray) -> tuple[dict[str, Share], dict[str, Any]]:
    """Accuracy of a pair: the share of its judged matches within a threshold, 0 where there is none. done (P,) bool:
    which pairs the rows are of."""
    judged = np.array([row["judged"] for row in rows])
    within = np.zeros((len(done), len(THRESHOLDS_PX)))
    within[done] = np.array([row["within_px"] for row in rows]) / np.maximum(judged, 1)[:, None]
    shares = {f"mma_{px}": (share, np.ones(len(done), bool)) for px, share in zip(THRESHOLDS_PX, within.T, strict=True)}
    return shares, {"pairs_without_match": len(done) - int((judged > 0).sum())}


def _nodes(rows: Sequence[Row], done: np.ndarray) -> tuple[dict[str, Share], dict[str, Any]]:
    """Precision of a pair: the share of its matches that are right, 0 where there is none. Recall: the share of the
    objects in both graphs that were matched; pairs whose graphs share no object have none. done (P,) bool: which pairs
    the rows are of.
    """
    matches, correct, true = (np.array([row[name] for row in rows]) for name in ("matches", "correct", "true"))
    precision, recall = np.zeros((2, len(done)))
    precision[done], recall[done] = correct / np.maximum(matches, 1), correct / np.maximum(true, 1)
    shared = np.ones(len(done), bool)
    shared[done] = true > 0
    shares = {"precision": (precision, np.ones(len(done), bool)), "recall": (recall, shared)}
    return shares, {"true_per_pair": float(true.sum() / len(done))}


def _mean(name: str, share: np.ndarray, counts: np.ndarray, places: Sequence[str], seed: int) -> dict[str, Any]:
    """The mean of the shares that count, and its interval; nothing where none does."""
    if not counts.any():
        return {}
    chosen = np.flatnonzero(counts).tolist()
    low, high = bootstrap_interval(share[chosen], [places[i] for i in chosen], seed)
    return {name: float(share[chosen].mean()), f"{name}_low": low, f"{name}_high": high}
