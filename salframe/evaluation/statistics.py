"""Statistics of arrays: confidence intervals, paired tests, precision and recall, calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

ACCEPTED_SHARE = 0.9
"""Share of the correct answers that pass the threshold at which the false accept rate is measured."""
BINS = 10
"""Number of bins of equal width over [0, 1] in which probabilities are compared with frequencies."""
RESAMPLES = 2000
"""Number of bootstrap samples."""
NORMAL_95 = 1.959963984540054
"""Half the width, in standard deviations, of the interval that contains 95 % of a normal distribution."""
AT_RECALLS = (0.5, 0.75, 0.9)
"""Recalls at which the precision of accepted answers is reported."""


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % confidence interval. The bounds are None if the interval is unknown."""

    value: float
    low: float | None = None
    high: float | None = None

    def __str__(self) -> str:
        bounds = "" if self.low is None or self.high is None else f" ({self.low:.2f}-{self.high:.2f})"
        return f"{self.value:.3g}{bounds}"


def median(values: Sequence[float] | np.ndarray) -> float | None:
    """Return the median; None without values."""
    return float(np.median(values)) if len(values) else None


def estimate_proportion(successes: np.ndarray, clusters: Sequence[str]) -> Estimate:
    """Return the mean of (N,) bool with Wilson's interval for the effective sample size.

    Queries of one cluster (a place) are correlated. If the design effect is above 1, the sample size is divided by it
    (Korn and Graubard 1998). The design effect is the variance of the mean over clusters, divided by the variance of
    the mean of independent queries. The sample size is not reduced if each query is a separate cluster, or if all
    queries are successes or all are failures.
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
    """Return the mean of (N,) values with its 95 % bootstrap interval. Each sample draws whole clusters.

    With weights (N,), return the sum of the values divided by the sum of the weights.
    """
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
    """Return a statistic of queries with its 95 % bootstrap interval. Each sample draws whole clusters.

    `statistic` receives the indices of queries and returns a number or None.

    Samples where the statistic is None are left out. The result is None if the statistic of all queries is None.
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
    """Return the p-value of a two-sided exact paired test of two methods, clustered.

    It is the probability that the numbers of correct answers differ at least as much as observed, if the answers of the
    two methods were swapped in each cluster with probability 1/2. If each query is a separate cluster, this is
    McNemar's exact test.

    Args:
        first: (Q,) bool: the queries that the first method answered correctly.
        second: (Q,) bool: the queries that the second method answered correctly.
        cluster: The cluster of each query, such as its place.
    """
    difference = np.bincount(_cluster_numbers(cluster), first.astype(float) - second).astype(int)
    chance = np.ones(1)  # of each sum of the differences, from the minimum to the maximum, in steps of one
    for size in np.abs(difference[difference != 0]):
        swapped = np.zeros(len(chance) + 2 * size)
        swapped[: len(chance)] += chance / 2
        swapped[2 * size :] += chance / 2
        chance = swapped
    sums = np.arange(len(chance)) - len(chance) // 2
    return float(min(chance[np.abs(sums) >= abs(difference.sum())].sum(), 1.0))


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Return the p-values of several tests, adjusted by Holm's method (1979). None (no test) stays None."""
    order = sorted((p, i) for i, p in enumerate(p_values) if p is not None)
    adjusted: list[float | None] = [None] * len(p_values)
    max_p = 0.0
    for rank, (p, i) in enumerate(order):
        max_p = max(max_p, min((len(order) - rank) * p, 1.0))
        adjusted[i] = max_p
    return adjusted


def macro_averages(
    first_place: Sequence[str | None], true_place: Sequence[str]
) -> tuple[float, float] | tuple[None, None]:
    """Return the macro precision and the macro recall: unweighted means over the true places. None without places.

    `first_place` is the answer to each query, None without one. A place that is never answered has the precision 0.
    """
    if not true_place:
        return None, None
    places = sorted(set(true_place))
    answered, true = np.array([place or "" for place in first_place], np.str_), np.array(true_place, np.str_)
    hits = np.array([(answered == place) & (true == place) for place in places]).sum(1)
    num_answered, num_true = (np.array([(side == place).sum() for place in places]) for side in (answered, true))
    return float((hits / np.maximum(num_answered, 1)).mean()), float((hits / num_true).mean())


def roc_area(present: np.ndarray, absent: np.ndarray) -> float | None:
    """Return the area under the ROC curve; None if either array is empty.

    It is the probability that a value of `present` (P,) exceeds one of `absent` (A,), where ties count half.
    """
    if not len(present) or not len(absent):
        return None
    from scipy.stats import rankdata

    ranks = rankdata(np.concatenate([present, absent]))[: len(present)]
    return float((ranks.mean() - (len(present) + 1) / 2) / len(absent))


def false_accept_rate(correct: np.ndarray, absent: np.ndarray, share: float = ACCEPTED_SHARE) -> float | None:
    """Return the share of out-of-map queries that are accepted; None if either array is empty.

    Args:
        correct: (R,) evidence (score or probability) of the correct answers.
        absent: (A,) evidence of the answers to out-of-map queries.
        share: Minimum share of the correct answers to accept. The highest threshold that accepts this share is used.
    """
    if not len(correct) or not len(absent):
        return None
    bound = np.sort(correct)[::-1][int(np.ceil(share * len(correct) - 1e-9)) - 1]
    return float((absent >= bound).mean())


def average_precision(evidence: np.ndarray, right: np.ndarray, count: int) -> float | None:
    """Return the area under the precision-recall curve; None if `count` is 0.

    Args:
        evidence: (Q,) evidence (score or probability) of the answers. An answer is accepted above a threshold.
        right: (Q,) bool: the correct answers.
        count: Number of queries that can be answered correctly; recall is relative to it.
    """
    if not count:
        return None
    hits, precision = accepted_above(evidence, right)
    return float(np.diff(hits, prepend=0) @ precision / count)


def precision_at(evidence: np.ndarray, right: np.ndarray, count: int) -> tuple[float | None, ...]:
    """For each recall of AT_RECALLS, return the highest precision of all thresholds with at least this recall.

    A value is None if no threshold reaches the recall.

    The arguments are those of `average_precision`.
    """
    hits, precision = accepted_above(evidence, right)
    reached = [precision[hits >= recall * count - 1e-9] for recall in AT_RECALLS]
    return tuple(float(values.max()) if count and len(values) else None for values in reached)


def accepted_above(evidence: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number and the share of correct answers among the accepted answers, for each distinct threshold.

    Args:
        evidence: (Q,) evidence of the answers. Each distinct value is a threshold; the highest comes first.
        right: (Q,) bool: the correct answers.
    """
    bounds, number = np.unique(-evidence, return_inverse=True)
    hits = np.bincount(number, right, len(bounds)).cumsum()
    return hits, hits / np.bincount(number, minlength=len(bounds)).cumsum()


@dataclass(frozen=True, eq=False)
class Reliability:
    """A reliability diagram: mean confidence (B,), frequency of correct answers (B,) and number of answers (B,) of each
    of the BINS bins of equal width that is not empty."""

    confidence: np.ndarray
    frequency: np.ndarray
    count: np.ndarray

    @property
    def expected_error(self) -> float:
        """The expected calibration error: the mean difference of confidence and frequency, weighted by the counts."""
        return float(np.abs(self.confidence - self.frequency) @ self.count / self.count.sum())


def reliability(confidence: np.ndarray, correct: np.ndarray) -> Reliability | None:
    """Return the frequency of correct answers (N,) bool in bins of their confidence (N,).

    The confidence is NaN where an answer has none. The result is None if no answer has a confidence.
    """
    has_confidence = np.isfinite(confidence)
    if not has_confidence.any():
        return None
    confidence, correct = confidence[has_confidence], correct[has_confidence]
    bin = np.minimum((confidence * BINS).astype(int), BINS - 1)
    count = np.bincount(bin, minlength=BINS)
    used = count > 0
    sums = [np.bincount(bin, values, BINS)[used] for values in (confidence, correct.astype(float))]
    return Reliability(sums[0] / count[used], sums[1] / count[used], count[used])


def _cluster_numbers(cluster: Sequence[str]) -> np.ndarray:
    """Return the cluster of each query as a number, (N,) int64, from 0 without gaps."""
    return np.unique(np.asarray(cluster, np.str_), return_inverse=True)[1]
