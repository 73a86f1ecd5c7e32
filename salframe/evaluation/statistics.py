"""From answers and truth to the numbers of a comparison (method.md, Metrics). Nothing here runs a method."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from salframe.evaluation.runs.run_folder import PieceStatus, Row
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
NORMAL_95 = 1.959963984540054
"""Standard deviations on either side of the mean that hold 95 % of a normal distribution."""
AT_RECALLS = (0.5, 0.75, 0.9)
"""Recalls at which the precision of accepted answers is told."""
RECALLS = {"recall_025m_2deg": (0.25, 2.0), "recall_05m_5deg": (0.5, 5.0), "recall_1m_10deg": (1.0, 10.0)}
"""Pose recalls by their column: translation in metres, rotation in degrees."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A method's answers against the truth, one entry a query, in the order of the dataset.

    present (Q,) bool: the map has the query's place. correct (Q,) bool: the first place is the true one, or the place
    is not in the map and the status denies it; in_top_2, in_top_5 (Q,) bool, likewise; correct_scene (Q,) bool: as
    correct, had nobody answered with a doorway. best_place (Q,) bool: the first place is the true one, whatever the
    status. translation_m, rotation_deg (Q,) float64, infinite where there is no pose or the
    method failed, NaN where the truth has no pose or the map lacks the place; heading_deg (Q,) float64, the same of the
    heading, which may be known without a pose. evidence (Q,) float64: how much speaks for the place being in the map:
    the probability of that where the method has one, else the best score; -inf of an answer without places. confidence
    (Q,) float64: the probability of what was answered, a place or that it is not in the map; NaN without. true_place,
    first_place: Q names, the latter None where no place was answered. right_type (Q,) float64: 1 where the first place
    is of the true one's room type, otherwise 0, NaN where that is not known. statuses: Q words, "crashed" where no
    answer was recorded.
    """

    present: np.ndarray
    best_place: np.ndarray
    evidence: np.ndarray
    confidence: np.ndarray
    correct: np.ndarray
    correct_scene: np.ndarray
    in_top_2: np.ndarray
    in_top_5: np.ndarray
    translation_m: np.ndarray
    rotation_deg: np.ndarray
    heading_deg: np.ndarray
    true_place: tuple[str, ...]
    first_place: tuple[str | None, ...]
    right_type: np.ndarray
    statuses: tuple[str, ...]

    @classmethod
    def join(cls, parts: Sequence[Judged]) -> Judged:
        """The queries of several data sets as one; where there are several, places are named by the number of their
        data set too."""
        if len(parts) == 1:
            return parts[0]
        joined: dict[str, Any] = {}
        for field in fields(cls):
            values = [getattr(part, field.name) for part in parts]
            arrays = isinstance(values[0], np.ndarray)
            joined[field.name] = np.concatenate(values) if arrays else tuple(itertools.chain(*values))
        for name in ("true_place", "first_place"):
            named = [(number, place) for number, part in enumerate(parts) for place in getattr(part, name)]
            joined[name] = tuple(None if place is None else f"{number}: {place}" for number, place in named)
        return cls(**joined)


def judge(
    answers: Sequence[Row | None],
    truths: Sequence[Truth],
    present: Sequence[bool] | np.ndarray | None = None,
    doorways: Collection[str] = (),
    room_types: Mapping[str, str] | None = None,
) -> Judged:
    """Compare each query's answer (a row of rows.jsonl, or None) with its truth; `present`: whether its map has the
    query's place, None: every one has; `doorways`: the places of the map that are no scene; `room_types`: of
    places, where they are known. A failure's places and pose do not count."""
    present = np.ones(len(truths), bool) if present is None else np.asarray(present, bool)
    correct, correct_scene, in_top_2, in_top_5 = np.zeros((4, len(truths)), bool)
    errors = np.full((len(truths), 3), np.inf)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.T_world_pano is None or not present[i]:
            errors[i] = np.nan
        if answer is not None and not present[i]:
            correct[i] = correct_scene[i] = in_top_2[i] = in_top_5[i] = answer["status"] in DENIALS
        if answer is None or answer["status"] not in PLACED or not present[i]:
            continue
        places = list(dict.fromkeys(place for _, place, _ in answer["places"]))
        correct[i] = places[:1] == [truth.place]
        correct_scene[i] = [place for place in places if place not in doorways][:1] == [truth.place]
        in_top_2[i], in_top_5[i] = truth.place in places[:2], truth.place in places[:5]
        if answer["pose"] is not None and truth.T_world_pano is not None:
            errors[i, :2] = pose_errors(np.reshape(answer["pose"], (4, 4)), truth.T_world_pano)
        if answer.get("heading") is not None and truth.T_world_pano is not None:
            errors[i, 2] = np.abs(wrap_angle(answer["heading"] - pose_yaw(truth.T_world_pano)))
    statuses = tuple(str(PieceStatus.CRASHED) if answer is None else answer["status"] for answer in answers)
    rotation_deg, heading_deg = np.degrees(errors[:, 1:]).T
    first = [answer["places"][0][1] if answer and answer["places"] else None for answer in answers]
    best_place = [place == truth.place for place, truth in zip(first, truths, strict=True)]
    first_place = [place if status in PLACED else None for place, status in zip(first, statuses, strict=True)]
    return Judged(
        present=present,
        best_place=np.array(best_place, bool),
        evidence=_evidence(answers),
        confidence=np.array([_confidence(answer) for answer in answers], float),
        correct=correct,
        correct_scene=correct_scene,
        in_top_2=in_top_2,
        in_top_5=in_top_5,
        translation_m=errors[:, 0],
        rotation_deg=rotation_deg,
        heading_deg=heading_deg,
        true_place=tuple(truth.place for truth in truths),
        first_place=tuple(first_place),
        right_type=_right_type(answers, truths, room_types or {}),
        statuses=statuses,
    )


def _right_type(answers: Sequence[Row | None], truths: Sequence[Truth], room_types: Mapping[str, str]) -> np.ndarray:
    """(Q,) as in Judged."""
    right = np.full(len(truths), np.nan)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.place in room_types:
            places = answer["places"] if answer and answer["status"] in PLACED else []
            right[i] = bool(places) and room_types.get(places[0][1]) == room_types[truth.place]
    return right


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


def average_precision(evidence: np.ndarray, right: np.ndarray, count: int) -> float | None:
    """The area below precision against recall of (Q,) answers that are accepted above a bound on their evidence: the
    share of accepted ones that are `right`, against the share of the `count` that can be. None where none can."""
    if not count:
        return None
    hits, precision = accepted_above(evidence, right)
    return float(np.diff(hits, prepend=0) @ precision / count)


def precision_at(evidence: np.ndarray, right: np.ndarray, count: int) -> tuple[float | None, ...]:
    """For each of AT_RECALLS the highest precision of (Q,) answers, accepted above a bound on their evidence, that has
    this recall or more: see `average_precision`. None where no bound has."""
    hits, precision = accepted_above(evidence, right)
    reached = [precision[hits >= recall * count - 1e-9] for recall in AT_RECALLS]
    return tuple(float(kept.max()) if count and len(kept) else None for kept in reached)


def accepted_above(evidence: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The number of `right` ones among the (Q,) answers accepted at each different bound, highest first, and their
    share."""
    bounds, number = np.unique(-evidence, return_inverse=True)
    hits = np.bincount(number, right, len(bounds)).cumsum()
    return hits, hits / np.bincount(number, minlength=len(bounds)).cumsum()


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


def proportion_interval(right: np.ndarray, cluster: Sequence[str]) -> tuple[float, float]:
    """95 % interval of the mean of (Q,) bool: Wilson's, of as many queries as they are worth.

    Queries of one cluster, a place, tell less than as many of different places: their number is divided by the design
    effect, the variance of the mean over clusters by that of independent queries, where that is above 1 (Korn and
    Graubard 1998). Where each is a cluster of its own, or all are right or all wrong, this is Wilson's interval.
    """
    count, share = float(len(right)), float(right.mean())
    number = _cluster_numbers(cluster)
    clusters = int(number.max()) + 1
    if clusters > 1 and 0 < share < 1:
        independent = share * (1 - share) / (count - 1)
        sums = np.bincount(number, right - share)
        clustered = clusters / (clusters - 1) * float(sums @ sums) / count**2
        count = count / max(clustered / independent, 1.0)
    z = NORMAL_95**2 / count
    middle = (share + z / 2) / (1 + z)
    half = float(np.sqrt(z * (share * (1 - share) + z / 4))) / (1 + z)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """The p-values of several tests, adjusted as by Holm 1979: what each is worth when the least of all is looked at
    first. None is no test, and stays."""
    order = sorted((p, i) for i, p in enumerate(p_values) if p is not None)
    adjusted: list[float | None] = [None] * len(p_values)
    least = 0.0
    for rank, (p, i) in enumerate(order):
        least = max(least, min((len(order) - rank) * p, 1.0))
        adjusted[i] = least
    return adjusted


def macro_averages(first_place: Sequence[str | None], true_place: Sequence[str]) -> tuple[float, float]:
    """Precision and recall, each the mean over the places that were asked for, all of one weight. Of a place that was
    never answered the precision is 0."""
    places = sorted(set(true_place))
    answered, true = np.array([place or "" for place in first_place], np.str_), np.array(true_place, np.str_)
    hits = np.array([(answered == place) & (true == place) for place in places]).sum(1)
    given, asked = (np.array([(side == place).sum() for place in places]) for side in (answered, true))
    return float((hits / np.maximum(given, 1)).mean()), float((hits / asked).mean())


def paired_test(first: np.ndarray, second: np.ndarray, cluster: Sequence[str]) -> float:
    """Two-sided exact test of two methods that were right on (Q,) bool queries each, clustered: the chance that they
    differ by so many right answers or more, were the methods swapped in each cluster by the toss of a coin.

    Queries of one place tell less than as many of different places. Where each is a cluster of its own this is
    McNemar's exact test.
    """
    difference = np.bincount(_cluster_numbers(cluster), first.astype(float) - second).astype(int)
    chance = np.ones(1)  # of each sum of the differences, from the least possible to the largest, in steps of one
    for size in np.abs(difference[difference != 0]):
        swapped = np.zeros(len(chance) + 2 * size)
        swapped[: len(chance)] += chance / 2
        swapped[2 * size :] += chance / 2
        chance = swapped
    sums = np.arange(len(chance)) - len(chance) // 2
    return float(min(chance[np.abs(sums) >= abs(difference.sum())].sum(), 1.0))


def bootstrap_interval(
    values: np.ndarray, cluster: Sequence[str], seed: int, weights: np.ndarray | None = None
) -> tuple[float, float]:
    """95 % interval of the mean of (N,) values over draws of as many clusters with replacement; with weights (N,), of
    the sum of values by the sum of weights."""
    number = _cluster_numbers(cluster)
    sums, counts = np.bincount(number, values), np.bincount(number, weights)
    drawn = np.random.default_rng(seed).integers(len(counts), size=(RESAMPLES, len(counts)))
    below = counts[drawn].sum(1)
    low, high = np.quantile(sums[drawn].sum(1)[below > 0] / below[below > 0], (0.025, 0.975))
    return float(low), float(high)


def resampled_interval(
    statistic: Callable[[np.ndarray], float | None], cluster: Sequence[str], seed: int
) -> tuple[float, float]:
    """95 % interval of a statistic of the indices (N,) of queries, over draws of as many clusters with replacement;
    draws of which it is None are left out. Raises ValueError where it is None of all."""
    number = _cluster_numbers(cluster)
    members = np.split(np.argsort(number, kind="stable"), np.bincount(number).cumsum()[:-1])
    drawn = np.random.default_rng(seed).integers(len(members), size=(RESAMPLES, len(members)))
    values = [statistic(np.concatenate([members[one] for one in draw])) for draw in drawn]
    low, high = np.quantile([value for value in values if value is not None], (0.025, 0.975))
    return float(low), float(high)


def _cluster_numbers(cluster: Sequence[str]) -> np.ndarray:
    """(N,) int64: names as numbers from 0 without gaps."""
    return np.unique(np.asarray(cluster, np.str_), return_inverse=True)[1]


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
