"""Answers against truths worked out by hand, and the line that they make."""

from __future__ import annotations

import math

import numpy as np
import pytest

from salframe.evaluation.runs.records import Record
from salframe.evaluation.runs.rows import RowWriter
from salframe.evaluation.runs.run_folder import DESCRIPTIONS, MAPS, MethodStatus, Outcome
from salframe.evaluation.statistics import estimate_proportion, reliability
from salframe.evaluation.tasks.localization.judging import Judged, judge, pose_recalls
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.survey import LocalizationSurvey, Query
from salframe.evaluation.tasks.localization.task import LocalizationTask
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d

TRUTH = Truth("kitchen", pose_2d(1, 2, 0))


def answer(*places: str, pose=None, status="ok", query_ms=1.0, memory=10.0, score=1.0, **given) -> AnswerRow:
    """An answer with these places, best first."""
    content = {
        "fold": "all",
        "query": "query",
        "error": None,
        "status": status,
        "places": [[f"frame-of-{place}", place, score] for place in places],
        "pose": None if pose is None else pose.ravel().tolist(),
        "query_ms": query_ms,
        "describe_ms": None,
        "peak_memory_mb": memory,
    }
    return AnswerRow.model_validate({**content, **given})


def test_the_first_place_counts():
    judged = judge([answer("kitchen"), answer("hall", "kitchen"), answer(status="no-match"), None], [TRUTH] * 4)
    assert judged.correct.tolist() == [True, False, False, False]
    assert judged.in_top_5.tolist() == [True, True, False, False]
    assert judged.statuses == ("ok", "ok", "no-match", "crashed")


def test_a_room_of_the_same_type_is_of_the_right_type():
    types = {"kitchen": "kitchen", "other kitchen": "kitchen", "hall": "hall"}
    given = [
        answer("kitchen"),
        answer("other kitchen"),
        answer("hall"),
        answer("doorway"),
        answer(status="no-match"),
        None,
    ]
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
    told = answer("kitchen", status="no-pose", heading=math.radians(190))
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
    """A data set of four queries in the kitchen and three reference frames, as far as a summary looks at it."""

    fold = Fold(
        "all",
        tuple(ReferenceFrame(id, "kitchen", np.eye(4)) for id in ("map-1", "map-2", "left-out")),
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
    assert (row.queries, row.accuracy.value, row.status) == (4, 0.5, {"ok": 3, "no-objects": 1})
    assert (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg) == (0.25, 0.5, 0.75)
    assert row.median_translation_m == pytest.approx(0.25)  # of 0.1 and 0.4: the wrong place does not count
    assert row.median_rotation_deg == pytest.approx(1.0)
    assert row.median_heading_deg is None
    three_of_four = np.array([True, True, True, False])
    assert row.room_type_accuracy == estimate_proportion(three_of_four, ["kitchen"] * 4)
    assert row.room_type_accuracy.value == 0.75
    assert row.bytes_per_scene == 200.0
    assert (row.describe_ms, row.query_ms, row.peak_memory_mb) == (7.0, 2.0, 30.0)


def test_a_refused_answer_names_no_place():
    found = judge([answer("kitchen", status="out-of-map"), answer("kitchen", status="no-pose")], [TRUTH] * 2)
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


def test_denying_the_map_is_right_where_the_place_is_not_in_it():
    statuses = ["out-of-map", "low-score", "no-match", "no-objects", "ok"]
    asked = [answer("hall", status=status) for status in statuses] + [None]
    absent = judge(asked, [TRUTH] * 6, [False] * 6)
    assert absent.correct.tolist() == [True, True, True, False, False, False]
    assert np.isnan(absent.translation_m).all()  # such a map has no pose of the query
    assert not judge([answer("kitchen", status="out-of-map")], [TRUTH]).correct[0]


def test_evidence_is_the_probability_of_the_map_where_there_is_one_else_the_score():
    others = [answer(status="no-objects"), None]
    assert judge([answer("hall", score=7.0), *others], [TRUTH] * 3).evidence.tolist() == [7.0, -np.inf, -np.inf]
    worth = {"score": 7.0, "probabilities": [0.2], "out_of_map_probability": 0.75}
    found = judge([answer("hall", **worth), *others], [TRUTH] * 3)
    assert found.evidence.tolist() == [0.25, -np.inf, -np.inf]
    assert found.confidence[0] == 0.2
    assert np.isnan(found.confidence[1:]).all()
    refused = answer("hall", status="out-of-map", **worth)
    assert judge([refused, *others], [TRUTH] * 3).confidence[0] == 0.75


def test_calibration_error_of_two_bins_by_hand():
    """Four answers of 0.9 of which two are right, one of 0.25 that is wrong: (4 * 0.4 + 0.25) / 5."""
    sure = answer("kitchen", probabilities=[0.9], out_of_map_probability=0.1)
    wrong = answer("hall", probabilities=[0.9], out_of_map_probability=0.1)
    unsure = answer("hall", probabilities=[0.25], out_of_map_probability=0.75)
    judged = judge([sure, sure, wrong, wrong, unsure, answer("kitchen")], [TRUTH] * 6)
    found = reliability(judged.confidence, judged.correct)
    assert found.confidence == pytest.approx([0.25, 0.9])
    assert found.frequency.tolist() == [0.0, 0.5]
    assert found.count.tolist() == [1, 4]
    assert found.expected_error == pytest.approx((4 * 0.4 + 0.25) / 5)
    none = judge([answer("kitchen")], [TRUTH])
    assert reliability(none.confidence, none.correct) is None
