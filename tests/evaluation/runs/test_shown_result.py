"""Results of runs as notebooks show them."""

from __future__ import annotations

from dataclasses import replace

from shown_html import HOSTILE, SHOWN, ShownHtml

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare


def test_a_result_has_its_tables_and_its_notes(fakes):
    request = Request(("reader", "weightless"), "rooms", settings=("wrong_from=3",), engine="inline")
    result = compare(request)
    hostile = replace(result, rows=(replace(result.rows[0], method=HOSTILE), *result.rows[1:]), notes=(HOSTILE,))
    shown = ShownHtml(hostile._repr_html_())
    assert f"{SHOWN}[wrong_from=3]" in shown.texts
    assert SHOWN in shown.texts
    (first, *_) = result.tables()
    accuracy = first.rows[0][1]
    assert accuracy in shown.texts
    assert f"report: {result.report}" in shown.texts
