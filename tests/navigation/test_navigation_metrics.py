"""From rows to the table."""

from __future__ import annotations

import numpy as np
import pytest
from salframe.evaluation.navigation_metrics import bootstrap_interval, success_p_value, summarize
from scipy.stats import binom


def rows(successes, **given):
    one = {
        "status": "arrived",
        "oracle": True,
        "success_3m": True,
        "travelled_m": 4.0,
        "panoramas": 3,
        "collisions": 1,
        **given,
    }
    return [{**one, "success": success, "spl": 0.5 * success} for success in successes]


def test_means_and_intervals():
    summary = summarize(rows([True] * 30 + [False] * 10), 0)
    assert (summary["success_rate"], summary["spl"], summary["oracle_success_rate"]) == (0.75, 0.375, 1.0)
    assert (summary["path_m"], summary["panoramas"], summary["collisions"]) == (4.0, 3.0, 1.0)
    low, high = binom.ppf((0.025, 0.975), 40, 0.75) / 40
    assert (summary["success_rate_low"], summary["success_rate_high"]) == (
        pytest.approx(low, abs=0.026),
        pytest.approx(high, abs=0.026),
    )


def test_a_crashed_episode_is_a_failure_and_has_no_length():
    crashed = {"status": "crashed", "success": False, "oracle": False, "spl": 0.0, "success_3m": False}
    summary = summarize([*rows([True]), crashed], 0)
    assert (summary["success_rate"], summary["path_m"]) == (0.5, 4.0)
    assert summarize([crashed], 0)["path_m"] is None


def test_the_interval_of_a_mean_is_that_of_its_standard_error():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    low, high = bootstrap_interval(values, 0)
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / 20, rel=0.08)
    assert bootstrap_interval(values, 0) == (low, high)


def test_significance_is_of_the_same_episodes():
    assert success_p_value(rows([True] * 8), rows([False] * 8)) == pytest.approx(2 / 2**8)
    assert success_p_value(rows([True, False]), rows([True, False])) == 1.0
