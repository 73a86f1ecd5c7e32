from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import binomtest, mannwhitneyu

from salframe.evaluation.runs.run_folder import DESCRIPTIONS, MAPS, MethodStatus, Outcome, RowWriter
from salframe.evaluation.runs.task import Record, count_statuses
from salframe.evaluation.statistics import (
    Judged,
    accepted_though_absent,
    average_precision,
    bootstrap_interval,
    holm,
    judge,
    macro_averages,
    paired_test,
    pose_recalls,
    precision_at,
    proportion_interval,
    reliability,
    resampled_interval,
    roc_area,
)
from salframe.evaluation.tasks.localization.answering import Query
from salframe.evaluation.tasks.localization.task import LocalizationSurvey, LocalizationTask
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


def test_a_room_of_the_same_type_is_of_the_right_type():
    types = {"kitchen": "kitchen", "other kitchen": "kitchen", "hall": "hall"}
    given = [answer("kitchen"), answer("other kitchen"), answer("hall"), answer("doorway"), answer(), None]
    given += [answer("kitchen", status="low-score")]
    assert judge(given, [TRUTH] * 7, room_types=types).right_type.tolist() == [1, 1, 0, 0, 0, 0, 0]
    assert np.isnan(judge(given[:1], [TRUTH], room_types={"hall": "hall"}).right_type).all()


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

    def room_types(self):
        return {"kitchen": "kitchen", "hall": "kitchen"}  # a kitchen that is called a hall


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
        for frame, ms in (("map-1", 5.0), ("map-2", 7.0), ("query-0", 100.0)):
            costs.append({"frame": frame, "ms": ms})
    with RowWriter(tmp_path / MAPS) as maps:
        maps.append({"fold": "kitchen", "frames": 2, "bytes": 500})
        maps.append({"fold": "hall", "frames": 3, "bytes": 500})
    data = Kitchen()
    survey = LocalizationSurvey(data, [Query(data.fold, frame) for frame in data.fold.queries])
    record = Record("method", Outcome(MethodStatus.DONE), answers, tmp_path)
    (row,) = LocalizationTask().summarize([(survey, [record])], 0)
    assert (row.queries, row.accuracy, row.status) == (4, 0.5, {"ok": 3, "no-objects": 1})
    assert (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg) == (0.25, 0.5, 0.75)
    assert row.median_translation_m == pytest.approx(0.25)  # of 0.1 and 0.4: the wrong place does not count
    assert row.median_rotation_deg == pytest.approx(1.0)
    assert row.median_heading_deg is None
    assert row.room_type_accuracy == 0.75
    assert (row.room_type_accuracy_low, row.room_type_accuracy_high) == proportion_interval(
        np.array([True, True, True, False]), ["kitchen"] * 4
    )
    assert row.bytes_per_scene == 200.0
    assert (row.describe_ms, row.query_ms, row.peak_memory_mb) == (7.0, 2.0, 30.0)


@pytest.mark.parametrize(("right", "queries"), [(90, 100), (7, 10), (500, 1009), (36, 36), (0, 12)])
def test_the_interval_of_queries_of_different_places_is_wilsons(right, queries):
    expected = binomtest(right, queries).proportion_ci(method="wilson")
    alone = list(map(str, range(queries)))
    assert proportion_interval(np.arange(queries) < right, alone) == pytest.approx((expected.low, expected.high))


def test_queries_that_are_right_or_wrong_together_count_once():
    """Thirty places, two queries each, both right or both wrong: by unbiased variances worth 60 * 29 / 59 queries."""
    correct, place = np.repeat(np.arange(30) < 18, 2), np.repeat(np.arange(30), 2).astype(str)
    share, n, z = 0.6, 60 * 29 / 59, 1.959964
    middle, half = share + z**2 / (2 * n), z * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    expected = (middle - half) / (1 + z**2 / n), (middle + half) / (1 + z**2 / n)
    assert proportion_interval(correct, place) == pytest.approx(expected)
    assert proportion_interval(np.ones(36, bool), ["a"] * 18 + ["b"] * 18) == pytest.approx((0.9036, 1.0), abs=1e-4)


def test_the_clustered_interval_covers_the_truth_where_wilsons_does_not():
    """Forty rooms of three queries whose chance is their room's: of 400 such tables about 95 % hold the mean chance."""
    rng = np.random.default_rng(0)
    room, covered = np.repeat(np.arange(40), 3).astype(str), np.zeros((400, 2))
    for i in range(400):
        correct = rng.random(120) < np.repeat(rng.beta(0.7, 0.3, 40), 3)
        for j, cluster in enumerate((room, np.arange(120).astype(str))):
            low, high = proportion_interval(correct, cluster)
            covered[i, j] = low <= 0.7 <= high
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


def test_a_refused_answer_names_no_place():
    found = judge([answer("kitchen", status="not-here"), answer("kitchen", status="no-pose")], [TRUTH] * 2)
    assert found.first_place == (None, "kitchen")
    assert found.best_place.tolist() == [True, True]


def test_a_doorway_is_no_answer_where_scenes_alone_count():
    found = judge([answer("door", "kitchen"), answer("door", "hall", "kitchen")], [TRUTH] * 2, doorways={"door"})
    assert found.correct.tolist() == [False, False]
    assert found.correct_scene.tolist() == [True, False]
    assert found.in_top_2.tolist() == [True, False]


def test_the_places_of_two_buildings_are_not_the_same():
    one = judge([answer("kitchen"), answer("hall")], [TRUTH] * 2)
    both = Judged.join([one, one])
    assert both.correct.tolist() == [True, False] * 2
    assert both.true_place == ("0: kitchen", "0: kitchen", "1: kitchen", "1: kitchen")
    assert both.first_place[1::2] == ("0: hall", "1: hall")


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


def test_statuses_are_counted_ok_first():
    assert list(count_statuses(["low-score", "no-pose", "ok", "no-pose"]).items()) == [
        ("ok", 1),
        ("no-pose", 2),
        ("low-score", 1),
    ]


def test_the_interval_of_a_mean_is_that_of_its_standard_error():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    alone, pairs = np.arange(400).astype(str), np.repeat(np.arange(400), 2).astype(str)
    low, high = bootstrap_interval(values, alone, 0)
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / 20, rel=0.08)
    assert bootstrap_interval(values, alone, 0) == (low, high)
    assert bootstrap_interval(np.repeat(values, 2), pairs, 0) == pytest.approx((low, high))  # twice as many, no more


def test_the_interval_of_a_ratio_weighs_clusters_by_what_they_count():
    right, found = np.array([3.0, 0.0, 2.0, 5.0]), np.array([4, 0, 2, 10])
    low, high = bootstrap_interval(right, list("abcd"), 0, found)
    assert 0.5 == low < right.sum() / found.sum() < high == 1.0  # from 5 of 10 alone to 2 of 2
    assert bootstrap_interval(right, list("aaaa"), 0, found) == pytest.approx((10 / 16, 10 / 16))


def test_the_interval_of_any_statistic_is_over_the_same_draws():
    values, cluster = np.random.default_rng(1).normal(3.0, 2.0, 90), np.repeat(np.arange(30), 3).astype(str)
    assert resampled_interval(lambda chosen: float(values[chosen].mean()), cluster, 4) == pytest.approx(
        bootstrap_interval(values, cluster, 4)
    )


def test_the_interval_of_a_roc_area_is_that_of_hanley_and_mcneil():
    """1982, for areas of values that are exponential: theirs are exact there."""
    rng = np.random.default_rng(3)
    count = 1200
    evidence = np.concatenate([rng.exponential(3.0, count), rng.exponential(1.0, count)])
    present = np.arange(2 * count) < count

    def area(chosen):
        return roc_area(evidence[chosen][present[chosen]], evidence[chosen][~present[chosen]])

    low, high = resampled_interval(area, np.arange(2 * count).astype(str), 0)
    a = 3 / (3 + 1)
    variance = a * (1 - a) + (count - 1) * (a / (2 - a) - a**2 + 2 * a**2 / (1 + a) - a**2)
    assert (high - low) / 2 == pytest.approx(1.96 * math.sqrt(variance) / count, rel=0.1)
    assert low < area(np.arange(2 * count)) < high


def test_denying_the_map_is_right_where_the_place_is_not_in_it():
    statuses = ["not-here", "low-score", "no-match", "no-objects", "ok"]
    asked = [answer("hall", status=status) for status in statuses] + [None]
    absent = judge(asked, [TRUTH] * 6, [False] * 6)
    assert absent.correct.tolist() == [True, True, True, False, False, False]
    assert np.isnan(absent.translation_m).all()  # such a map has no pose of the query
    assert not judge([answer("kitchen", status="not-here")], [TRUTH]).correct[0]


def test_evidence_is_the_probability_of_the_map_where_there_is_one_else_the_score():
    scored = [{**answer("hall"), "places": [["f", "hall", 7.0]]}, answer(status="no-objects"), None]
    assert judge(scored, [TRUTH] * 3).evidence.tolist() == [7.0, -np.inf, -np.inf]
    scored[0] |= {"probabilities": [0.2], "not_here": 0.75}
    found = judge(scored, [TRUTH] * 3)
    assert found.evidence.tolist() == [0.25, -np.inf, -np.inf]
    assert found.confidence[0] == 0.2
    assert np.isnan(found.confidence[1:]).all()
    scored[0]["status"] = "not-here"
    assert judge(scored, [TRUTH] * 3).confidence[0] == 0.75


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


def test_accepted_though_absent_at_the_bound_that_keeps_nine_of_ten():
    right = np.arange(1.0, 11.0)  # the bound is 2, which nine of them reach
    assert accepted_though_absent(right, np.array([1.9, 2.0, 5.0, -np.inf])) == 0.5
    assert accepted_though_absent(right, np.array([0.9, 1.0]), kept=1.0) == 0.5
    assert accepted_though_absent(np.zeros(0), right) is None


def test_calibration_error_of_two_bins_by_hand():
    """Four answers of 0.9 of which two are right, one of 0.25 that is wrong: (4 * 0.4 + 0.25) / 5."""
    sure = {**answer("kitchen"), "probabilities": [0.9], "not_here": 0.1}
    wrong = {**sure, "places": [["f", "hall", 1.0]]}
    unsure = {**wrong, "probabilities": [0.25], "not_here": 0.75}
    found = reliability(judge([sure, sure, wrong, wrong, unsure, answer("kitchen")], [TRUTH] * 6))
    assert found.confidence == pytest.approx([0.25, 0.9])
    assert found.frequency.tolist() == [0.0, 0.5]
    assert found.count.tolist() == [1, 4]
    assert found.expected_error == pytest.approx((4 * 0.4 + 0.25) / 5)
    assert reliability(judge([answer("kitchen")], [TRUTH])) is None


def test_calibrated_probabilities_have_no_calibration_error():
    rng = np.random.default_rng(3)
    probability = rng.uniform(0, 1, 40000)
    right = rng.uniform(0, 1, 40000) < probability
    rows = [
        {
            "status": "ok",
            "places": [["f", "kitchen" if r else "hall", 1.0]],
            "pose": None,
            "probabilities": [p],
            "not_here": 1 - p,
        }
        for p, r in zip(probability, right, strict=True)
    ]
    judged = judge(rows, [Truth("kitchen")] * len(rows))
    assert reliability(judged).expected_error < 0.01
    overconfident = [{**row, "probabilities": [row["probabilities"][0] ** 0.25]} for row in rows]
    # E[p^(1/4) - p] of p uniform in [0, 1] is 4/5 - 1/2
    assert reliability(judge(overconfident, [Truth("kitchen")] * len(rows))).expected_error == pytest.approx(
        0.3, abs=0.01
    )
