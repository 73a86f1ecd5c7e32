from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import pytest

from salframe.evaluation.localization import compare
from salframe.evaluation.request import Request


@pytest.fixture
def comparison(fakes):
    settings = ("greedy.wrong_from=2", "greedy.refuse_in=1")
    return compare(Request(("reader", "greedy", "weightless"), "rooms", settings=settings, engine="inline"))


def test_the_report_needs_nothing_else(comparison):
    page = comparison.report.read_text()
    assert "Plotly.newPlot" in page
    tags = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"""\b(src|href)\s*=""", tags)
    assert "@import" not in tags


def test_the_report_holds_every_row_and_query(comparison):
    page = comparison.report.read_text()
    assert "<b>100.0</b> (72-100)" in page
    assert "weightless.pth is not at hand" in page
    assert "greedy: 6 of 10 wrong" in page  # rooms 1 to 3; in room 4 the nearest to one too many is right
    assert page.count("<td>query-3-1</td>") == 2  # one table a measured method
    assert "Queries on the floor plan" in page


def test_labels_are_escaped(fakes):
    page = compare(Request(("reader",), "rooms", name="<script>alert(1)<", engine="inline")).report.read_text()
    assert "<script>alert(1)" not in page


def test_the_accuracy_figure_is_drawn_to_scale(comparison):
    figure = ElementTree.parse(comparison.run / "accuracy.svg").getroot()
    names = {"s": "http://www.w3.org/2000/svg"}
    widths = [float(bar.get("width")) for bar in figure.findall("s:rect", names)]
    accuracy = [row.accuracy for row in comparison.rows if row.measured]
    assert widths == pytest.approx([400 * value for value in accuracy], abs=0.05)
    assert "reader" in [text.text for text in figure.findall("s:text", names)]


def test_a_run_without_a_measured_method_has_a_report(fakes):
    comparison = compare(Request(("weightless",), "rooms", engine="inline"))
    assert "weightless.pth is not at hand" in comparison.report.read_text()
    assert not (comparison.run / "accuracy.svg").exists()
