from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom

from salframe.evaluation.localization import LocalizationSurvey, LocalizationTask, Query
from salframe.evaluation.metrics import accuracy_interval, bootstrap_interval, judge, mcnemar_exact, pose_recalls
from salframe.evaluation.run import DESCRIPTIONS, MethodStatus, Outcome, RowWriter
from salframe.evaluation.task import Record, count_statuses
from salframe.panoramas.frames import Fold, MapFrame, QueryFrame, Truth
from salframe.panoramas.geometry import pose_2d

TRUTH = Truth("kitchen", pose_2d(1, 2, 0))


def answer(*places: str, pose=None, status="ok", query_ms=1.0, memory=10.0):
    return {
        "status": status,
        "places": [[f"frame-of-{place}", place, 1.0] for place in places],
        "pose": None if pose is None else pose.ravel().tolist(),
        "query_ms": query_ms,
        "peak_memory_mb": memory,
    }


def test_the_first_place_counts():
    judged = judge([answer("kitchen"), answer("hall", "kitchen"), answer(), None], [TRUTH] * 4)
    assert judged.correct.tolist() == [True, False, False, False]
    assert judged.in_top_5.tolist() == [True, True, False, False]
    assert judged.statuses == ("ok", "ok", "ok", "crashed")


def test_recall_counts_distinct_places():
    judged = judge(
        [answer("a", "a", "b", "c", "d", "kitchen"), answer("a", "b", "c", "d", "e", "kitchen")], [TRUTH] * 2
    )
    assert judged.in_top_5.tolist() == [True, False]


def test_a_failure_counts_neither_place_nor_pose():
    judged = judge(
        [answer("kitchen", pose=TRUTH.T_world_pano, status="low-score"), answer("kitchen", status="no-pose")],
        [TRUTH] * 2,
    )
    assert judged.correct.tolist() == [False, True]
    assert judged.translation_m.tolist() == [math.inf, math.inf]


def test_pose_errors_against_hand_computed_ones():
    judged = judge([answer("kitchen", pose=pose_2d(1.3, 2.4, math.radians(-8)))], [TRUTH])
    assert judged.translation_m == pytest.approx([0.5])
    assert judged.rotation_deg == pytest.approx([8.0])


def test_a_heading_is_judged_without_a_pose_too():
    """190 and -170 degrees are one heading."""
    told = {**answer("kitchen", status="no-pose"), "heading": math.radians(190)}
    judged = judge(
        [told, answer("kitchen", status="no-pose")], [Truth("kitchen", pose_2d(1, 2, math.radians(-176)))] * 2
    )
    assert judged.heading_deg == pytest.approx([6.0, math.inf])
    assert judged.rotation_deg.tolist() == [math.inf, math.inf]


def test_a_truth_without_a_pose_is_not_judged():
    judged = judge([answer("kitchen", pose=pose_2d(0, 0, 0))], [Truth("kitchen")])
    assert np.isnan(judged.translation_m).all()
    assert judged.correct.all()
    assert pose_recalls(judged) == {"recall_025m_2deg": None, "recall_05m_5deg": None, "recall_1m_10deg": None}


class Kitchen:
    """A data set of four queries in the kitchen and three mapping frames, as far as a summary looks at it."""

    fold = Fold(
        "all",
        tuple(MapFrame(id, "kitchen", np.eye(4)) for id in ("map-1", "map-2", "left-out")),
        tuple(QueryFrame(f"query-{i}", lambda: None) for i in range(4)),
    )

    def folds(self):
        return [self.fold]

    def truth(self, query_id):
        return TRUTH


def test_summary_of_four_queries(tmp_path):
    answers = (
        answer("kitchen", pose=pose_2d(1.1, 2, math.radians(1)), query_ms=1.0, memory=10.0),  # within every bound
        answer("kitchen", pose=pose_2d(1.4, 2, math.radians(1)), query_ms=2.0, memory=30.0),  # within the second, third
        answer(
            "hall", pose=pose_2d(1.9, 2, math.radians(9)), query_ms=9.0, memory=20.0
        ),  # wrong, its pose in the third
        answer(status="no-objects", query_ms=None, memory=None),
    )
    with RowWriter(tmp_path / DESCRIPTIONS) as costs:
        for frame, ms, size in (("map-1", 5.0, 100), ("map-2", 7.0, 300), ("query-0", 100.0, 9000)):
            costs.append({"frame": frame, "ms": ms, "bytes": size})
    data = Kitchen()
    survey = LocalizationSurvey(data, [Query(data.fold, frame) for frame in data.fold.queries])
    record = Record("method", Outcome(MethodStatus.DONE), answers, tmp_path)
    (row,) = LocalizationTask().summarize(survey, [record], 0)
    assert (row.queries, row.accuracy, row.status) == (4, 0.5, {"ok": 3, "no-objects": 1})
    assert (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg) == (0.25, 0.5, 0.75)
    assert row.median_translation_m == pytest.approx(0.25)  # of 0.1 and 0.4: the wrong place does not count
    assert row.median_rotation_deg == pytest.approx(1.0)
    assert row.median_heading_deg is None
    assert row.bytes_per_scene == 200.0
    assert (row.describe_ms, row.query_ms, row.peak_memory_mb) == (7.0, 2.0, 30.0)


@pytest.mark.parametrize(("right", "queries"), [(90, 100), (7, 10), (500, 1009)])
def test_interval_agrees_with_the_binomial_quantiles(right, queries):
    correct = np.arange(queries) < right
    low, high = accuracy_interval(correct, seed=0)
    assert low == pytest.approx(binom.ppf(0.025, queries, right / queries) / queries, abs=1.01 / queries)
    assert high == pytest.approx(binom.ppf(0.975, queries, right / queries) / queries, abs=1.01 / queries)
    assert accuracy_interval(correct, seed=0) == (low, high)


def test_interval_agrees_with_resampling_query_by_query():
    correct = np.arange(40) < 30
    rng = np.random.default_rng(1)
    means = correct[rng.integers(40, size=(20000, 40))].mean(axis=1)
    assert accuracy_interval(correct, seed=0) == pytest.approx(np.quantile(means, (0.025, 0.975)), abs=0.026)


def test_mcnemar_against_the_sum_of_binomial_coefficients():
    first = np.array([True] * 9 + [False] * 2 + [True] * 20)
    second = np.array([False] * 9 + [True] * 2 + [True] * 20)
    expected = 2 * sum(math.comb(11, k) for k in range(3)) / 2**11
    assert mcnemar_exact(first, second) == pytest.approx(expected)
    assert mcnemar_exact(second, first) == pytest.approx(expected)
    assert mcnemar_exact(first, first) == 1.0


def test_statuses_are_counted_ok_first():
    assert list(count_statuses(["low-score", "no-pose", "ok", "no-pose"]).items()) == [
        ("ok", 1),
        ("no-pose", 2),
        ("low-score", 1),
    ]


def test_the_interval_of_a_mean_is_that_of_its_standard_error():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    low, high = bootstrap_interval(values, 0)
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / 20, rel=0.08)
    assert bootstrap_interval(values, 0) == (low, high)
