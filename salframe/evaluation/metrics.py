"""From answers and truth to the numbers of a comparison (method.md, Metrics). Nothing here runs a method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.evaluation.run import PieceStatus, Row
from salframe.localization.answers import LocalizationStatus
from salframe.panoramas.frames import Truth
from salframe.panoramas.geometry import pose_errors, pose_yaw, wrap_angle

PLACED = tuple(status for status in LocalizationStatus if status.names_a_place)
RESAMPLES = 2000
RECALLS = {"recall_025m_2deg": (0.25, 2.0), "recall_05m_5deg": (0.5, 5.0), "recall_1m_10deg": (1.0, 10.0)}
"""Pose recalls by their column: translation in metres, rotation in degrees."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A method's answers against the truth, one entry a query, in the order of the dataset.

    correct (Q,) bool: the first place is the true one; in_top_5 (Q,) bool; translation_m, rotation_deg (Q,) float64,
    infinite where there is no pose or the method failed, NaN where the truth has no pose; heading_deg (Q,) float64, the
    same of the heading, which may be known without a pose; statuses: Q words, "crashed" where no answer was recorded.
    """

    correct: np.ndarray
    in_top_5: np.ndarray
    translation_m: np.ndarray
    rotation_deg: np.ndarray
    heading_deg: np.ndarray
    statuses: tuple[str, ...]


def judge(answers: Sequence[Row | None], truths: Sequence[Truth]) -> Judged:
    """Compare each query's answer (a row of rows.jsonl, or None) with its truth. A failure's places and pose do
    not count."""
    correct, in_top_5 = np.zeros((2, len(truths)), bool)
    errors = np.full((len(truths), 3), np.inf)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.T_world_pano is None:
            errors[i] = np.nan
        if answer is None or answer["status"] not in PLACED:
            continue
        places = list(dict.fromkeys(place for _, place, _ in answer["places"]))
        correct[i] = places[:1] == [truth.place]
        in_top_5[i] = truth.place in places[:5]
        if answer["pose"] is not None and truth.T_world_pano is not None:
            errors[i, :2] = pose_errors(np.reshape(answer["pose"], (4, 4)), truth.T_world_pano)
        if answer.get("heading") is not None and truth.T_world_pano is not None:
            errors[i, 2] = np.abs(wrap_angle(answer["heading"] - pose_yaw(truth.T_world_pano)))
    statuses = tuple(str(PieceStatus.CRASHED) if answer is None else answer["status"] for answer in answers)
    rotation_deg, heading_deg = np.degrees(errors[:, 1:]).T
    return Judged(correct, in_top_5, errors[:, 0], rotation_deg, heading_deg, statuses)


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


def bootstrap_interval(values: np.ndarray, seed: int) -> tuple[float, float]:
    """95 % interval of the mean of (N,) values over draws of N of them with replacement."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(len(values), size=(RESAMPLES, len(values)))].mean(1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def pose_recalls(judged: Judged) -> dict[str, float | None]:
    """Shares of all queries whose true pose is known that are localized within the bounds of RECALLS, by column."""
    posed = ~np.isnan(judged.translation_m)
    recalls: dict[str, float | None] = dict.fromkeys(RECALLS)
    for column, (translation_m, rotation_deg) in RECALLS.items() if posed.any() else ():
        near = (judged.translation_m <= translation_m) & (judged.rotation_deg <= rotation_deg)
        recalls[column] = float(near.sum() / posed.sum())
    return recalls


def median(values: Sequence[float] | np.ndarray) -> float | None:
    """The median, None of nothing."""
    return float(np.median(values)) if len(values) else None
