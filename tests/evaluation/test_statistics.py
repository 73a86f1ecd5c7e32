"""Statistics against closed forms, scipy, and values worked out by hand."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import binomtest, mannwhitneyu

from salframe.evaluation.statistics import (
    Estimate,
    average_precision,
    estimate_mean,
    estimate_proportion,
    estimate_statistic,
    false_accept_rate,
    holm,
    macro_averages,
    paired_test,
    precision_at,
    reliability,
    roc_area,
)


@pytest.mark.parametrize(("right", "queries"), [(90, 100), (7, 10), (500, 1009), (36, 36), (0, 12)])
def test_the_interval_of_queries_of_different_places_is_wilsons(right, queries):
    expected = binomtest(right, queries).proportion_ci(method="wilson")
    alone = list(map(str, range(queries)))
    share = estimate_proportion(np.arange(queries) < right, alone)
    assert (share.value, share.low, share.high) == pytest.approx((right / queries, expected.low, expected.high))


def test_queries_that_are_right_or_wrong_together_count_once():
    """Thirty places, two queries each, both right or both wrong: by unbiased variances worth 60 * 29 / 59 queries."""
    correct, place = np.repeat(np.arange(30) < 18, 2), np.repeat(np.arange(30), 2).astype(str)
    share, n, z = 0.6, 60 * 29 / 59, 1.959964
    middle, half = share + z**2 / (2 * n), z * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    expected = (middle - half) / (1 + z**2 / n), (middle + half) / (1 + z**2 / n)
    clustered = estimate_proportion(correct, place)
    assert (clustered.low, clustered.high) == pytest.approx(expected)
    all_right = estimate_proportion(np.ones(36, bool), ["a"] * 18 + ["b"] * 18)
    assert (all_right.low, all_right.high) == pytest.approx((0.9036, 1.0), abs=1e-4)


def test_the_clustered_interval_covers_the_truth_where_wilsons_does_not():
    """Forty rooms of three queries whose chance is their room's: of 400 such tables about 95 % hold the mean chance."""
    rng = np.random.default_rng(0)
    room, covered = np.repeat(np.arange(40), 3).astype(str), np.zeros((400, 2))
    for i in range(400):
        correct = rng.random(120) < np.repeat(rng.beta(0.7, 0.3, 40), 3)
        for j, cluster in enumerate((room, np.arange(120).astype(str))):
            share = estimate_proportion(correct, cluster)
            covered[i, j] = share.low <= 0.7 <= share.high
    clustered, alone = covered.mean(0)
    assert 0.92 < clustered < 0.98
    assert alone < 0.89


def test_holms_adjustment_by_hand():
    assert holm([0.01, None, 0.04, 0.03, 0.005]) == pytest.approx([0.03, None, 0.06, 0.06, 0.02])
    assert holm([None, 0.7, 0.6]) == [None, 1.0, 1.0]


def test_macro_averages_weigh_places_alike():
    """Kitchen: 3 of 4 found, 3 of 4 answers right; bath: asked once, never answered."""
    answered = ["kitchen", "kitchen", "kitchen", "hall", "kitchen"]
    asked = ["kitchen"] * 4 + ["bath"]
    assert macro_averages(answered, asked) == (0.375, 0.375)
    assert macro_averages(["a", None], ["a", "b"]) == (0.5, 0.5)
    assert macro_averages([], []) == (None, None)


def test_paired_test_of_single_queries_is_mcnemars():
    first = np.array([True] * 9 + [False] * 2 + [True] * 20)
    second = np.array([False] * 9 + [True] * 2 + [True] * 20)
    alone = list(map(str, range(31)))
    expected = 2 * sum(math.comb(11, k) for k in range(3)) / 2**11
    assert paired_test(first, second, alone) == pytest.approx(expected)
    assert paired_test(second, first, alone) == pytest.approx(expected)
    assert paired_test(first, first, alone) == 1.0


def test_paired_test_against_every_toss():
    """Rooms that differ by 3, 2, -1, 2, 0 and 1 queries: of the 32 tosses, those that sum to 7 or more either way."""
    size = (3, 2, -1, 2, 0, 1)
    tosses = [abs(sum(np.array(signs) * [3, 2, 1, 2, 1])) for signs in itertools.product((-1, 1), repeat=5)]
    room = [str(k) for k in range(6) for _ in range(3)]
    first = np.array([q < max(n, 0) for n in size for q in range(3)])
    second = np.array([q < max(-n, 0) for n in size for q in range(3)])
    assert paired_test(first, second, room) == pytest.approx(np.mean(np.array(tosses) >= 7))


def test_the_interval_of_a_mean_is_that_of_its_standard_error():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    alone, pairs = np.arange(400).astype(str), np.repeat(np.arange(400), 2).astype(str)
    mean = estimate_mean(values, alone, 0)
    assert mean.value == pytest.approx(values.mean())
    assert (mean.high - mean.low) / 2 == pytest.approx(1.96 * values.std() / 20, rel=0.08)
    assert estimate_mean(values, alone, 0) == mean
    twice = estimate_mean(np.repeat(values, 2), pairs, 0)  # twice as many, no more
    assert (twice.low, twice.high) == pytest.approx((mean.low, mean.high))


def test_the_interval_of_a_ratio_weighs_clusters_by_what_they_count():
    right, found = np.array([3.0, 0.0, 2.0, 5.0]), np.array([4, 0, 2, 10])
    ratio = estimate_mean(right, list("abcd"), 0, found)
    assert 0.5 == ratio.low < ratio.value == 10 / 16 < ratio.high == 1.0  # from 5 of 10 alone to 2 of 2
    assert estimate_mean(right, list("aaaa"), 0, found) == Estimate(10 / 16, 10 / 16, 10 / 16)


def test_the_interval_of_any_statistic_is_over_the_same_draws():
    values, cluster = np.random.default_rng(1).normal(3.0, 2.0, 90), np.repeat(np.arange(30), 3).astype(str)
    drawn = estimate_statistic(lambda chosen: float(values[chosen].mean()), cluster, 4)
    mean = estimate_mean(values, cluster, 4)
    assert (drawn.value, drawn.low, drawn.high) == pytest.approx((mean.value, mean.low, mean.high))
    assert estimate_statistic(lambda chosen: None, cluster, 4) is None


def test_the_interval_of_a_roc_area_is_that_of_hanley_and_mcneil():
    """1982, for areas of values that are exponential: theirs are exact there."""
    rng = np.random.default_rng(3)
    count = 1200
    evidence = np.concatenate([rng.exponential(3.0, count), rng.exponential(1.0, count)])
    present = np.arange(2 * count) < count

    def area(chosen):
        return roc_area(evidence[chosen][present[chosen]], evidence[chosen][~present[chosen]])

    found = estimate_statistic(area, np.arange(2 * count).astype(str), 0)
    a = 3 / (3 + 1)
    variance = a * (1 - a) + (count - 1) * (a / (2 - a) - a**2 + 2 * a**2 / (1 + a) - a**2)
    assert (found.high - found.low) / 2 == pytest.approx(1.96 * math.sqrt(variance) / count, rel=0.1)
    assert found.low < found.value == area(np.arange(2 * count)) < found.high


@pytest.mark.parametrize("digits", [1, 9])
def test_roc_area_is_the_statistic_of_mann_and_whitney(digits):
    rng = np.random.default_rng(2)
    present, absent = rng.normal(1, 1, 70).round(digits), rng.normal(0, 1, 50).round(digits)
    expected = mannwhitneyu(present, absent).statistic / (70 * 50)
    assert roc_area(present, absent) == pytest.approx(expected)
    assert roc_area(present, present) == pytest.approx(0.5)
    assert roc_area(present, np.zeros(0)) is None


def test_average_precision_by_hand():
    """Accepted one by one, right, wrong, right, wrong, of three that can be right: (1 + 2/3) / 3."""
    right = np.array([True, False, True, False])
    assert average_precision(np.array([4.0, 3.0, 2.0, -np.inf]), right, 3) == pytest.approx((1 + 2 / 3) / 3)
    assert average_precision(np.ones(4), right, 3) == pytest.approx(2 / 4 * 2 / 3)  # all at once
    assert average_precision(np.ones(4), right, 0) is None


def test_precision_at_recalls_by_hand():
    """As above: 1/1, 1/2, 2/3 and 2/4 are right, of three."""
    evidence, right = np.array([4.0, 3.0, 2.0, -np.inf]), np.array([True, False, True, False])
    assert precision_at(evidence, right, 3) == (pytest.approx(2 / 3), None, None)
    assert precision_at(evidence, right, 2) == pytest.approx((1.0, 2 / 3, 2 / 3))
    assert precision_at(evidence, right, 0) == (None, None, None)


def test_false_accept_rate_at_the_threshold_that_accepts_nine_of_ten():
    right = np.arange(1.0, 11.0)  # the bound is 2, which nine of them reach
    assert false_accept_rate(right, np.array([1.9, 2.0, 5.0, -np.inf])) == 0.5
    assert false_accept_rate(right, np.array([0.9, 1.0]), share=1.0) == 0.5
    assert false_accept_rate(np.zeros(0), right) is None


def test_calibrated_probabilities_have_no_calibration_error():
    rng = np.random.default_rng(3)
    probability = rng.uniform(0, 1, 40000)
    right = rng.uniform(0, 1, 40000) < probability
    assert reliability(probability, right).expected_error < 0.01
    # E[p^(1/4) - p] of p uniform in [0, 1] is 4/5 - 1/2
    assert reliability(probability**0.25, right).expected_error == pytest.approx(0.3, abs=0.01)


def test_an_estimate_is_printed_with_its_interval():
    assert str(Estimate(5 / 6, 0.4375, 0.97)) == "0.833 (0.44-0.97)"
    assert str(Estimate(0.5)) == "0.5"
