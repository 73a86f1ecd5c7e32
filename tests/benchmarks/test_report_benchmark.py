"""What it takes to open the report of a run of 1,000 queries in Chromium, until the page is there: two seconds are
promised."""

from __future__ import annotations

import pytest
from evaluation.report.browser import CHROMIUM, Page

from salframe.evaluation.finished_runs import write_report
from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is at hand")]


def test_a_thousand_queries(fakes, tmp_path, benchmark):
    settings = ("data.rooms=250", "data.queries=4")
    run = compare(Request(("reader",), "rooms", settings=settings, engine="inline")).run
    file = write_report([run], tmp_path / "page.html").path
    (blank := tmp_path / "blank.html").write_text("<title>blank</title>")
    with Page(blank, tmp_path / "profile") as page:
        benchmark.pedantic(page.open, (file,), setup=lambda: page.open(blank), rounds=5)
