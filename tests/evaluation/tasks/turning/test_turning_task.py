"""The task `turning`: shares of queries that the views of a turn resolve."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from salframe.evaluation.runs.records import Record
from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import MethodStatus, Outcome
from salframe.evaluation.studies.study import Study, run_study
from salframe.evaluation.tasks.turning.measures import summarize_turns
from salframe.evaluation.tasks.turning.rows import TurnLine, TurnRow
from salframe.evaluation.tasks.turning.task import TURNS_DEG
from salframe.framework.errors import InputMissing
from salframe.framework.validation import validate

RIGHT, UNSURE = TurnLine(accepted=True, right=True), TurnLine(accepted=False, right=True)
WRONG, LOST = TurnLine(accepted=True, right=False), TurnLine(accepted=False, right=False)


def query(number: int, **lines: TurnLine) -> TurnRow:
    return TurnRow(query=str(number), place=f"room-{number}", status="ok", error=None, **lines)


def test_shares_are_of_the_queries_that_are_not_accepted():
    rows = (
        query(0, first=RIGHT),
        query(1, first=WRONG),
        query(2, first=UNSURE, suggested=RIGHT, last_view=RIGHT, random=LOST),
        query(3, first=LOST, suggested=UNSURE, last_view=WRONG, random=WRONG),
        query(4, first=UNSURE),  # no suggestion: the first answer remains
        query(5, first=LOST, suggested=WRONG, last_view=RIGHT, random=LOST),
    )
    row = summarize_turns([Record("method", Outcome(MethodStatus.DONE), rows, Path())])
    assert (row.queries, row.unaccepted) == (6, 4)
    assert row.resolved_first.value == pytest.approx(1 / 6)
    assert (row.resolved.value, row.resolved_last_view.value, row.resolved_random.value) == (0.25, 0.5, 0.0)
    assert (row.right_first.value, row.right.value) == (0.5, 0.75)
    assert (row.right_last_view.value, row.right_random.value) == (0.75, 0.25)
    assert (row.wrong.value, row.wrong_last_view.value, row.wrong_random.value) == (0.25, 0.25, 0.25)


def test_a_crashed_query_counts_as_wrong():
    failed = TurnRow(query="1", place="a", status="crashed", error="no answer")
    row = summarize_turns([Record("method", Outcome(MethodStatus.DONE), (query(0, first=RIGHT), failed), Path())])
    assert (row.resolved_first.value, row.unaccepted, row.resolved.value) == (0.5, 1, 0.0)


def study(data: str, method: str = "proposed", **settings) -> Study:
    content = {"task": "turning", "data": data, "methods": [method], "set": settings}
    return validate(Study, content, "study")


def test_queries_of_a_home_are_turned():
    fast = {"data.height": 128, "data.queries_per_room": 1, "data.rgb": False, "data.query_fov_deg": 40}
    result = run_study(study("house-6", **fast), Request(engine="inline", name="turns"))
    (row,) = result.rows
    lines = (result.runs[0] / "methods" / "proposed" / "rows.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    assert row.queries == len(rows)
    assert 0 < row.unaccepted <= row.queries
    for one in rows:
        turned = [one.get(name) for name in ("suggested", "last_view", "random")]
        assert [line is None for line in turned] == 3 * [one["first"]["accepted"]]
        if turned[0]:
            assert turned[0]["turn_deg"] == turned[1]["turn_deg"] == 180
            assert turned[2]["turn_deg"] in TURNS_DEG
    assert row.resolved is not None
    assert not result.crashed


@pytest.mark.usefixtures("fakes")
def test_data_that_cannot_render_are_refused():
    with pytest.raises(InputMissing, match="cannot render"):
        run_study(study("rooms", "reader"), Request(engine="inline", name="turns"))
