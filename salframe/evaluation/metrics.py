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
DENIALS = tuple(status for status in LocalizationStatus if status.denies_the_map)
KEPT = 0.9
"""The share of right answers that a bound on scores keeps when it is asked how many wrong ones it lets pass."""
BINS = 10
"""Of equal width over [0, 1], to compare probabilities with frequencies."""
RESAMPLES = 2000
RECALLS = {"recall_025m_2deg": (0.25, 2.0), "recall_05m_5deg": (0.5, 5.0), "recall_1m_10deg": (1.0, 10.0)}
"""Pose recalls by their column: translation in metres, rotation in degrees."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A method's answers against the truth, one entry a query, in the order of the dataset.

    present (Q,) bool: the map has the query's place. correct (Q,) bool: the first place is the true one, or the place
    is not in the map and the status denies it; in_top_5 (Q,) bool, likewise. best_place (Q,) bool: the first place is
    the true one, whatever the status. translation_m, rotation_deg (Q,) float64, infinite where there is no pose or the
    method failed, NaN where the truth has no pose or the map lacks the place; heading_deg (Q,) float64, the same of the
    heading, which may be known without a pose. evidence (Q,) float64: how much speaks for the place being in the map:
    the probability of that where the method has one, else the best score; -inf of an answer without places. confidence
    (Q,) float64: the probability of what was answered, a place or that it is not in the map; NaN without. statuses: Q
    words, "crashed" where no answer was recorded.
    """

    present: np.ndarray
    best_place: np.ndarray
    evidence: np.ndarray
    confidence: np.ndarray

    correct: np.ndarray
    in_top_5: np.ndarray
    translation_m: np.ndarray
    rotation_deg: np.ndarray
    heading_deg: np.ndarray
    statuses: tuple[str, ...]


def judge(
    answers: Sequence[Row | None], truths: Sequence[Truth], present: Sequence[bool] | np.ndarray | None = None
) -> Judged:
    """Compare each query's answer (a row of rows.jsonl, or None) with its truth; `present`: whether its map has the
    query's place, None: every one has. A failure's places and pose do not count."""
    present = np.ones(len(truths), bool) if present is None else np.asarray(present, bool)
    correct, in_top_5 = np.zeros((2, len(truths)), bool)
    errors = np.full((len(truths), 3), np.inf)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.T_world_pano is None or not present[i]:
            errors[i] = np.nan
        if answer is not None and not present[i]:
            correct[i] = in_top_5[i] = answer["status"] in DENIALS
        if answer is None or answer["status"] not in PLACED or not present[i]:
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
    first = [answer["places"][0][1] if answer and answer["places"] else None for answer in answers]
    best_place = [place == truth.place for place, truth in zip(first, truths, strict=True)]
    return Judged(
        present=present,
        best_place=np.array(best_place, bool),
        evidence=_evidence(answers),
        confidence=np.array([_confidence(answer) for answer in answers], float),
        correct=correct,
        in_top_5=in_top_5,
        translation_m=errors[:, 0],
        rotation_deg=rotation_deg,
        heading_deg=heading_deg,
        statuses=statuses,
    )


def _evidence(answers: Sequence[Row | None]) -> np.ndarray:
    """(Q,) as in Judged: of the probabilities of a method that gives any, otherwise of its scores."""
    scores = [answer["places"][0][2] if answer and answer["places"] else None for answer in answers]
    not_here = [answer.get("not_here") if answer else None for answer in answers]
    if any(value is not None for value in not_here):
        scores = [None if value is None else 1 - value for value in not_here]
    return np.array([-np.inf if value is None else value for value in scores], float)


def _confidence(answer: Row | None) -> float:
    """As in Judged."""
    if answer is None or answer.get("not_here") is None:
        return np.nan
    if answer["status"] == LocalizationStatus.NOT_HERE:
        return float(answer["not_here"])
    return float(answer["probabilities"][0]) if answer["status"] in PLACED else np.nan


def roc_area(present: np.ndarray, absent: np.ndarray) -> float | None:
    """The chance that a value of (P,) is above one of (A,), equal ones counted half: the area below the curve of
    receiver operating characteristic. None where either is empty."""
    if not len(present) or not len(absent):
        return None
    from scipy.stats import rankdata

    ranks = rankdata(np.concatenate([present, absent]))[: len(present)]
    return float((ranks.mean() - (len(present) + 1) / 2) / len(absent))


def accepted_though_absent(right: np.ndarray, absent: np.ndarray, kept: float = KEPT) -> float | None:
    """The share of (A,) values of queries whose place is not in the map that pass the highest bound which this share of
    the (R,) values of right answers passes. None where either is empty."""
    if not len(right) or not len(absent):
        return None
    bound = np.sort(right)[::-1][int(np.ceil(kept * len(right) - 1e-9)) - 1]
    return float((absent >= bound).mean())


@dataclass(frozen=True, eq=False)
class Reliability:
    """Probabilities beside frequencies, in the BINS bins of equal width that hold any answer: confidence and frequency
    (B,), their means, and count (B,)."""

    confidence: np.ndarray
    frequency: np.ndarray
    count: np.ndarray

    @property
    def expected_error(self) -> float:
        """The expected calibration error: the mean difference of the two, weighted by the bins' counts."""
        return float(np.abs(self.confidence - self.frequency) @ self.count / self.count.sum())


def reliability(judged: Judged) -> Reliability | None:
    """How often answers are right beside how probable they said they were; None where no answer has a probability."""
    known = np.isfinite(judged.confidence)
    if not known.any():
        return None
    confidence, right = judged.confidence[known], judged.correct[known]
    bin = np.minimum((confidence * BINS).astype(int), BINS - 1)
    count = np.bincount(bin, minlength=BINS)
    used = count > 0
    sums = [np.bincount(bin, values, BINS)[used] for values in (confidence, right.astype(float))]
    return Reliability(sums[0] / count[used], sums[1] / count[used], count[used])


def accuracy_interval(correct: np.ndarray, seed: int) -> tuple[float, float]:
    """Bootstrap 95 % interval of the mean of (Q,) bool over queries.

    Q draws with replacement from right and wrong answers hold a binomial number of right ones, so that is drawn.
    """
    rng = np.random.default_rng(seed)
    means = rng.binomial(len(correct), correct.mean(), RESAMPLES) / len(correct)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def paired_test(first: np.ndarray, second: np.ndarray, cluster: Sequence[str]) -> float:
    """Two-sided exact test of two methods that were right on (Q,) bool queries each, clustered: the chance that they
    differ by so many right answers or more, were the methods swapped in each cluster by the toss of a coin.

    Queries of one place tell less than as many of different places. Where each is a cluster of its own this is
    McNemar's exact test.
    """
    _, number = np.unique(np.asarray(cluster, np.str_), return_inverse=True)
    difference = np.bincount(number, first.astype(float) - second).astype(int)
    chance = np.ones(1)  # of each sum of the differences, from the least possible to the largest, in steps of one
    for size in np.abs(difference[difference != 0]):
        swapped = np.zeros(len(chance) + 2 * size)
        swapped[: len(chance)] += chance / 2
        swapped[2 * size :] += chance / 2
        chance = swapped
    sums = np.arange(len(chance)) - len(chance) // 2
    return float(min(chance[np.abs(sums) >= abs(difference.sum())].sum(), 1.0))


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
