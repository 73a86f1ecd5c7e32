"""Statistics of arrays: confidence intervals, paired tests, precision and recall, calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

KEPT = 0.9
"""Share of the correct answers that pass the threshold at which the false accept rate is measured."""
BINS = 10
"""Number of bins of equal width over [0, 1] in which probabilities are compared with frequencies."""
RESAMPLES = 2000
"""Number of bootstrap samples."""
NORMAL_95 = 1.959963984540054
"""Half the width, in standard deviations, of the interval that holds 95 % of a normal distribution."""
AT_RECALLS = (0.5, 0.75, 0.9)
"""Recalls at which the precision of accepted answers is reported."""


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % confidence interval; the bounds are None where the interval is not known."""

    value: float
    low: float | None = None
    high: float | None = None

    def __str__(self) -> str:
        bounds = "" if self.low is None or self.high is None else f" ({self.low:.2f}-{self.high:.2f})"
        return f"{self.value:.3g}{bounds}"


def median(values: Sequence[float] | np.ndarray) -> float | None:
    """The median, None of nothing."""
    return float(np.median(values)) if len(values) else None


def estimate_proportion(successes: np.ndarray, clusters: Sequence[str]) -> Estimate:
    """Return the mean of (N,) bool with Wilson's interval for the effective sample size.

    Queries of one cluster (a place) are correlated. The sample size is divided by the design effect, the ratio of the
    variance of the mean over clusters to that of independent queries, where that is above 1 (Korn and Graubard 1998).
    The result is Wilson's interval where each query is a cluster of its own, or all are successes or all failures.
    """
    count, share = float(len(successes)), float(successes.mean())
    number = _cluster_numbers(clusters)
    num_clusters = int(number.max()) + 1
    if num_clusters > 1 and 0 < share < 1:
        independent = share * (1 - share) / (count - 1)
        sums = np.bincount(number, successes - share)
        clustered = num_clusters / (num_clusters - 1) * float(sums @ sums) / count**2
        count = count / max(clustered / independent, 1.0)
    z = NORMAL_95**2 / count
    middle = (share + z / 2) / (1 + z)
    half = float(np.sqrt(z * (share * (1 - share) + z / 4))) / (1 + z)
    return Estimate(share, max(middle - half, 0.0), min(middle + half, 1.0))


def estimate_mean(
    values: np.ndarray, clusters: Sequence[str], seed: int, weights: np.ndarray | None = None
) -> Estimate:
    """Return the mean of (N,) values with the bootstrap interval over clusters; with weights (N,), the sum of the
    values divided by the sum of the weights."""
    number = _cluster_numbers(clusters)
    sums, counts = np.bincount(number, values), np.bincount(number, weights)
    drawn = np.random.default_rng(seed).integers(len(counts), size=(RESAMPLES, len(counts)))
    below = counts[drawn].sum(1)
    low, high = np.quantile(sums[drawn].sum(1)[below > 0] / below[below > 0], (0.025, 0.975))
    value = values.mean() if weights is None else values.sum() / weights.sum()
    return Estimate(float(value), float(low), float(high))


def estimate_statistic(
    statistic: Callable[[np.ndarray], float | None], clusters: Sequence[str], seed: int
) -> Estimate | None:
    """Return a statistic of the indices (N,) of queries with its bootstrap interval over clusters.

    Samples where the statistic is None are left out. The result is None where it is None of all queries.
    """
    number = _cluster_numbers(clusters)
    value = statistic(np.arange(len(number)))
    if value is None:
        return None
    members = np.split(np.argsort(number, kind="stable"), np.bincount(number).cumsum()[:-1])
    drawn = np.random.default_rng(seed).integers(len(members), size=(RESAMPLES, len(members)))
    values = [statistic(np.concatenate([members[one] for one in draw])) for draw in drawn]
    low, high = np.quantile([value for value in values if value is not None], (0.025, 0.975))
    return Estimate(value, float(low), float(high))


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


def reliability(confidence: np.ndarray, correct: np.ndarray) -> Reliability | None:
    """Return the frequency of correct answers (N,) bool in bins of their confidence (N,), NaN where an answer has none;
    None where no answer has a confidence."""
    known = np.isfinite(confidence)
    if not known.any():
        return None
    confidence, correct = confidence[known], correct[known]
    bin = np.minimum((confidence * BINS).astype(int), BINS - 1)
    count = np.bincount(bin, minlength=BINS)
    used = count > 0
    sums = [np.bincount(bin, values, BINS)[used] for values in (confidence, correct.astype(float))]
    return Reliability(sums[0] / count[used], sums[1] / count[used], count[used])


def _cluster_numbers(cluster: Sequence[str]) -> np.ndarray:
    """(N,) int64: names as numbers from 0 without gaps."""
    return np.unique(np.asarray(cluster, np.str_), return_inverse=True)[1]
