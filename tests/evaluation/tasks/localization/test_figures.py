from __future__ import annotations

import numpy as np
import pytest

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.figures import rank_of
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.task import compare
from salframe.localization.answers import RankedPlace


def answer(*places, status="ok"):
    ranked = [RankedPlace(f"frame {place}", place, 1.0) for place in places]
    return AnswerRow.model_construct(status=status, places=ranked, pose=None)


def test_the_rank_of_a_place_counts_each_place_once():
    assert rank_of(answer("a", "a", "b"), "b") == 2
    assert rank_of(answer("a"), "b") == np.inf
    assert rank_of(answer("b", status="low-score"), "b") == np.inf
    assert rank_of(None, "b") == np.inf


@pytest.fixture
def figures(fakes, read):
    settings = ("greedy.wrong_from=2", "greedy.refuse_in=1")
    result = compare(Request(("reader", "greedy"), "rooms", settings=settings, engine="inline"))
    return {figure["title"]: figure for figure in read(result.report)[0]["figures"]}


def trace(figure, arm):
    (found,) = (one for one in figure["data"] if one.get("arm") == arm)
    return found


def test_recalls_are_of_all_queries(figures):
    """Of 5 rooms `greedy` is right in the first, refuses the second, and answers the next room from the third on; the
    last has no next, so that it is right there too. The right room is second best otherwise."""
    assert trace(figures["Recall at N"], 0)["y"] == [1.0] * 5
    assert trace(figures["Recall at N"], 1)["y"] == [0.4, 0.8, 0.8, 0.8, 0.8]


def test_errors_are_drawn_over_all_queries(figures):
    """Poses are those of the reference frames: off by 0.1 or 0.2 m in the right room, by 3.8 or 3.9 m from the next."""
    curve = trace(figures["Cumulative translation error"], 1)
    assert curve["x"] == pytest.approx([0.01, 0.1, 0.1, 0.2, 0.2, *[3.8] * 2, *[3.9] * 2, 20], abs=1e-3)
    assert curve["y"] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.8])
    histogram = trace(figures["Distribution of the translation error"], 1)
    shares = histogram["y"][::2]
    assert sum(shares) == pytest.approx(0.8)
    edges = histogram["x"]
    below_a_metre = [share for share, edge in zip(histogram["y"], edges, strict=True) if edge < 1][::2]
    assert sum(below_a_metre) == pytest.approx(0.4)


def test_costs_stand_beside_accuracy(figures):
    point = trace(figures["Accuracy against memory"], 1)
    assert point["y"] == [0.4]
    assert point["x"][0] > 0
    assert 0.4 - point["error_y"]["arrayminus"][0] >= 0


def test_precision_is_drawn_against_recall_where_queries_may_not_be_in_the_map(fakes, read, figures):
    """The best score of `reader` is 0 in a map that has the room, and -1 in one that has not, as often: the bound at 0
    accepts all right answers alone, that at -1 as many wrong ones."""
    asked = Request(("reader",), "rooms", settings=("data.hide_query_place=true",), engine="inline")
    drawn = {figure["title"]: figure for figure in read(compare(asked).report)[0]["figures"]}
    curve = trace(drawn["Precision-recall curve"], 0)
    assert (curve["x"], curve["y"]) == ([1.0, 1.0], [1.0, 0.5])
    assert "Precision-recall curve" not in figures
