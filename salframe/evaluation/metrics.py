"""From answers and truth to the numbers of a comparison (method.md, Metrics). Nothing here runs a method."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from salframe.evaluation.run import Row
from salframe.panoramas.frames import Truth
from salframe.panoramas.geometry import pose_errors

RESAMPLES = 2000
RECALLS = {"recall_025m_2deg": (0.25, 2.0), "recall_05m_5deg": (0.5, 5.0), "recall_1m_10deg": (1.0, 10.0)}
"""Pose recalls by their column: translation in metres, rotation in degrees."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A method's answers against the truth, one entry a query, in the order of the dataset.

    correct (Q,) bool: the first place is the true one; in_top_5 (Q,) bool; translation_m, rotation_deg (Q,) float64,
    infinite where there is no pose or the method failed, NaN where the truth has no pose; statuses: Q words, "crashed"
    where no answer was recorded.
    """

    correct: np.ndarray
    in_top_5: np.ndarray
    translation_m: np.ndarray
    rotation_deg: np.ndarray
    statuses: tuple[str, ...]


def judge(answers: Sequence[Row | None], truths: Sequence[Truth]) -> Judged:
    """Compare each query's answer (a row of predictions.jsonl, or None) with its truth. A failure's places and pose do
    not count."""
    correct, in_top_5 = np.zeros((2, len(truths)), bool)
    errors = np.full((len(truths), 2), np.inf)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.T_world_pano is None:
            errors[i] = np.nan
        if answer is None or answer["status"] not in ("ok", "no-pose"):
            continue
        places = list(dict.fromkeys(place for _, place, _ in answer["places"]))
        correct[i] = places[:1] == [truth.place]
        in_top_5[i] = truth.place in places[:5]
        if answer["pose"] is not None and truth.T_world_pano is not None:
            errors[i] = pose_errors(np.reshape(answer["pose"], (4, 4)), truth.T_world_pano)
    statuses = tuple("crashed" if answer is None else answer["status"] for answer in answers)
    return Judged(correct, in_top_5, errors[:, 0], np.degrees(errors[:, 1]), statuses)


def accuracy_interval(correct: np.ndarray, seed: int) -> tuple[float, float]:
    """Bootstrap 95 % interval of the mean of (Q,) bool over queries.

    Q draws with replacement from right and wrong answers hold a binomial number of right ones, so that is drawn.
    """
    rng = np.random.default_rng(seed)
    means = rng.binomial(len(correct), correct.mean(), RESAMPLES) / len(correct)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def mcnemar_exact(first: np.ndarray, second: np.ndarray) -> float:
    """Two-sided exact McNemar test: the chance of so uneven a split of the queries that only one of two methods, (Q,)
    bool each, got right."""
    from scipy.stats import binomtest

    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    if only_first + only_second == 0:
        return 1.0
    return float(binomtest(only_first, only_first + only_second, 0.5).pvalue)


def summarize(
    judged: Judged, answers: Iterable[Row | None], descriptions: Mapping[str, Row], map_frames: Iterable[str], seed: int
) -> dict[str, Any]:
    """The measured columns of a method's row; null where there is nothing to measure.

    descriptions: rows of descriptions.jsonl by frame; map_frames: ids of the frames that any map holds.
    """
    posed = ~np.isnan(judged.translation_m)
    located = judged.correct & np.isfinite(judged.translation_m)
    low, high = accuracy_interval(judged.correct, seed)
    rows = [answer for answer in answers if answer is not None]
    row: dict[str, Any] = {
        "accuracy": float(judged.correct.mean()),
        "accuracy_low": low,
        "accuracy_high": high,
        "recall_at_5": float(judged.in_top_5.mean()),
        "median_translation_m": _median(judged.translation_m[located]),
        "median_rotation_deg": _median(judged.rotation_deg[located]),
    }
    for column, (translation_m, rotation_deg) in RECALLS.items():
        near = (judged.translation_m <= translation_m) & (judged.rotation_deg <= rotation_deg)
        row[column] = float(near.sum() / posed.sum()) if posed.any() else None
    sizes = [descriptions[frame]["bytes"] for frame in map_frames if frame in descriptions]
    peaks = [answer["peak_memory_mb"] for answer in rows if answer["peak_memory_mb"] is not None]
    row["bytes_per_scene"] = float(np.mean(sizes)) if sizes else None
    row["describe_ms"] = _median([description["ms"] for description in descriptions.values()])
    row["query_ms"] = _median([answer["query_ms"] for answer in rows if answer["query_ms"] is not None])
    row["peak_memory_mb"] = max(peaks, default=None)
    return row


def count_statuses(statuses: Iterable[str]) -> dict[str, int]:
    """How often each status occurred, "ok" first, then by frequency."""
    counts = Counter(statuses)
    return dict(sorted(counts.items(), key=lambda entry: (entry[0] != "ok", -entry[1], entry[0])))


def _median(values: Sequence[float] | np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) else None
