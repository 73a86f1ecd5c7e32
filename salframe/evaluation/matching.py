"""Matching accuracy: are the points, or the objects, that a method matches the same ones? Independent of retrieval
(method.md, Metrics)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.compare import Progress, choose_runnable, configure_methods, open_run, watch, work_through
from salframe.evaluation.metrics import count_statuses
from salframe.evaluation.predict import FRAME_ERRORS, conclude, describe_error, log_crash, open_method
from salframe.evaluation.run import Outcome, Row, RowWriter, Run, read_rows
from salframe.framework.cache import Cache
from salframe.framework.errors import DataError, InputMissing
from salframe.framework.presets import configure
from salframe.framework.registry import registry
from salframe.graphs.detector import Detector
from salframe.localization.answers import NodeMatches, PointMatches
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Frame
from salframe.panoramas.geometry import invert_pose, sample_nearest, transform_points
from salframe.panoramas.panorama import Panorama

THRESHOLDS_PX = (1, 3, 5)
PIXEL_RAD = 2 * np.pi / 1024
"""Errors of points are great-circle angles in pixels of a panorama 1024 pixels wide, whatever its own width."""
RANGE_TOLERANCE = 0.05
"""A point is hidden from the reference where the reference sees something at another range, by more than this share."""
NODE_RADIUS_M = 0.5
"""A node belongs to no object whose centroid is further away."""

COLUMNS = (
    "method",
    "kind",
    "pairs",
    "matches_per_pair",
    "mma_1",
    "mma_3",
    "mma_5",
    "pairs_without_match",
    "precision",
    "recall",
    "true_per_pair",
    "available",
    "reason",
    "status",
)


@dataclass(frozen=True)
class Matching:
    """A run and its table: a row a method with the keys of COLUMNS, None where a number is absent.

    `kind` is "points" (mma_1, mma_3, mma_5: mean matching accuracy; pairs_without_match) or "nodes" (precision, recall,
    true_per_pair): the two are different quantities. All are means over the pairs of panoramas. `left_out`: queries
    whose place has no scene frame in the map; `notes`: which method ran instead of one that was asked for, and why, a
    line each.
    """

    run: Path
    rows: tuple[dict[str, Any], ...]
    left_out: int
    notes: tuple[str, ...] = ()

    @property
    def measured(self) -> bool:
        """Whether some method was measured."""
        return any(row["kind"] is not None for row in self.rows)

    @property
    def crashed(self) -> bool:
        """Whether some method raised or died, on a pair or altogether."""
        return any("crashed" in row["status"] for row in self.rows)

    def to_json(self) -> dict[str, Any]:
        """{"run": path, "rows": [...], "left_out": number, "notes": [...]}."""
        return {"run": str(self.run), "rows": list(self.rows), "left_out": self.left_out, "notes": list(self.notes)}


def measure_matching(
    methods: Sequence[str],
    data: str = "house-12",
    *,
    data_dir: Path | None = None,
    overrides: Sequence[str] = (),
    name: str | None = None,
    runs: Path = Path("runs"),
    engine: str = "processes",
    progress: Progress | None = None,
) -> Matching:
    """Match each query with the scene frame of its own place that is nearest to it; a run that was begun is resumed.

    Arguments as for `compare`. Raises SalframeError on names and settings that are wrong, and where the data set tells
    no ranges or poses.
    """
    configs, given = configure_methods(methods, overrides)
    configs, notes = choose_runnable(configs, given)
    run, dataset, runner = open_run(
        configs, data, data_dir, given, name, runs, engine, 0, progress, "matching-", {"task": "matching"}
    )
    if "range" not in dataset.provides:
        raise InputMissing(f"matching accuracy needs panoramas with range, which {dataset.name} does not have")
    pairs = choose_pairs(dataset)
    todo = [label for label in run.labels if not _finished(run, label, pairs)]
    with watch(run, lambda label: len(_rows(run, label)), len(pairs), progress):
        work_through(run, runner, match_pairs, todo)
    left_out = sum(len(fold.queries) for fold in dataset.folds()) - len(pairs)
    return Matching(run.directory, tuple(_summarize(run, label, len(pairs)) for label in run.labels), left_out, notes)


@dataclass(frozen=True, eq=False)
class FramePair:
    """A query of a fold, a mapping frame of the same place, and the true pose of the query in the frame's axes,
    T_reference_query (4, 4)."""

    fold: str
    query: Frame
    reference: Frame
    T_reference_query: np.ndarray

    @property
    def key(self) -> tuple[str, str]:
        """What the pair is known by in a run."""
        return self.fold, self.query.id


def choose_pairs(dataset: Dataset) -> list[FramePair]:
    """Each query with the nearest scene frame of its place. Raises DataError where there is none, or a query's true
    pose is not known."""
    pairs = []
    for fold in dataset.folds():
        scenes: dict[str, list[tuple[Frame, np.ndarray]]] = {}
        for frame in fold.mapping:
            mapped = frame.mapped()
            if mapped.kind == "scene":
                scenes.setdefault(mapped.place, []).append((frame, mapped.T_world_pano))
        for query in fold.queries:
            truth = dataset.truth(query.id)
            if truth.T_world_pano is None:
                raise DataError(f"the true pose of {query.id} is not known, expected one for every query")
            if truth.place in scenes:
                at_m = truth.T_world_pano[:3, 3]
                distances_m = [float(np.linalg.norm(pose[:3, 3] - at_m)) for _, pose in scenes[truth.place]]
                reference, pose = scenes[truth.place][int(np.argmin(distances_m))]
                pairs.append(FramePair(fold.id, query, reference, invert_pose(pose) @ truth.T_world_pano))
    if not pairs:
        raise DataError(f"{dataset.name} has no query whose place has a scene frame, expected at least one")
    return pairs


def match_pairs(directory: Path, label: str) -> None:
    """Match the pairs of a run that the method `label` has not matched yet; what was right goes to the run folder."""
    conclude(Run.load(directory), label, _match_pairs)


def _match_pairs(run: Run, label: str) -> Outcome:
    localizer, dataset = open_method(run, label)
    rows, cache = _rows(run, label), Cache()
    with RowWriter(_path(run, label)) as writer:
        for pair in choose_pairs(dataset):
            if pair.key in rows and rows[pair.key]["status"] != "crashed":
                continue
            row: Row = {"fold": pair.fold, "query": pair.query.id, "reference": pair.reference.id, "status": "ok"}
            try:
                query, reference = (
                    localizer.describe_frame(frame, cache, dataset.fingerprint)[0]
                    for frame in (pair.query, pair.reference)
                )
                found = localizer.correspond(query, reference)
                if found is None:
                    return Outcome("unavailable", "matches neither points nor objects")
                row |= check_matches(found, pair.query.load(), pair.reference.load(), pair.T_reference_query)
            except FRAME_ERRORS as error:
                row |= {"status": "error", "error": str(error)}
            except Exception as error:  # a pair that breaks the method must not take the others with it
                log_crash(run, label, f"query {pair.query.id} with {pair.reference.id}")
                row |= {"status": "crashed", "error": describe_error(error)}
            writer.append(row)
    return Outcome("done")


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
    detector: Detector = registry().build("detector", configure("detector", "annotations", {"noise": "none"}))
    objects = detector.detect(panorama)
    first = np.array([points[0] for points in objects.points_m or ()]).reshape(-1, 3)
    ids = sample_nearest(panorama.annotations.instance_id, first)
    closeness = np.maximum(NODE_RADIUS_M - cdist(centroid_m, objects.centroid_m), 0)
    nodes, owners = linear_sum_assignment(closeness, maximize=True)
    near = closeness[nodes, owners] > 0
    own = np.zeros(len(centroid_m), np.int64)
    own[nodes[near]] = ids[owners[near]]
    return own


def _path(run: Run, label: str) -> Path:
    return run.folder(label) / "pairs.jsonl"


def _rows(run: Run, label: str) -> dict[tuple[str, str], Row]:
    return {(row["fold"], row["query"]): row for row in read_rows(_path(run, label))}


def _finished(run: Run, label: str, pairs: Sequence[FramePair]) -> bool:
    outcome, rows = run.outcome(label), _rows(run, label)
    return (
        outcome is not None
        and outcome.status == "done"
        and all(pair.key in rows and rows[pair.key]["status"] != "crashed" for pair in pairs)
    )


def _summarize(run: Run, label: str, pairs: int) -> dict[str, Any]:
    """A method's row. A pair that failed counts as one in which nothing was right."""
    outcome, rows = run.outcome(label) or Outcome("unfinished", "unfinished"), list(_rows(run, label).values())
    row: dict[str, Any] = {**dict.fromkeys(COLUMNS), "method": label, "status": {}}
    row["available"], row["reason"] = outcome.status != "unavailable", outcome.reason
    if outcome.status == "crashed":
        row["status"] = {"crashed": pairs}
    if outcome.status != "done":
        return row
    row["status"] = count_statuses(known["status"] for known in rows)
    good, failed = ([known for known in rows if (known["status"] == "ok") == ok] for ok in (True, False))
    if failed:
        row["reason"] = f"{len(failed)} pair(s) failed, the first: {failed[0]['error']}"
    if good:
        row |= {
            "kind": good[0]["kind"],
            "pairs": pairs,
            "matches_per_pair": sum(known["matches"] for known in good) / pairs,
        }
        row |= _points(good, pairs) if row["kind"] == "points" else _nodes(good, pairs)
    return row


def _points(rows: Sequence[Row], pairs: int) -> dict[str, Any]:
    """Accuracy of a pair: the share of its judged matches within a threshold, 0 where there is none."""
    judged = np.array([row["judged"] for row in rows])
    within = np.array([row["within_px"] for row in rows]) / np.maximum(judged, 1)[:, None]
    accuracy = {
        f"mma_{threshold}": float(share) for threshold, share in zip(THRESHOLDS_PX, within.sum(0) / pairs, strict=True)
    }
    return {**accuracy, "pairs_without_match": pairs - int((judged > 0).sum())}


def _nodes(rows: Sequence[Row], pairs: int) -> dict[str, Any]:
    """Precision of a pair: the share of its matches that are right, 0 where there is none. Recall: the share of the
    objects in both graphs that were matched; pairs whose graphs share no object have none.
    """
    matches, correct, true = (np.array([row[name] for row in rows]) for name in ("matches", "correct", "true"))
    precision, recall = correct / np.maximum(matches, 1), correct / np.maximum(true, 1)
    shared = pairs - int((true == 0).sum())
    return {
        "precision": float(precision.sum() / pairs),
        "recall": float(recall.sum() / shared) if shared else None,
        "true_per_pair": float(true.mean()),
    }
