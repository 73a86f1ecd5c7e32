from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import pytest
from command_line import run as salframe

from salframe.evaluation.finished_runs import write_report
from salframe.evaluation.report.page import FOLDER
from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.evaluation.tasks.matching.task import measure_matching
from salframe.framework.errors import ConfigError, DataError

MAX_BUNDLE = 1.5e6


@pytest.fixture
def comparison(fakes):
    settings = ("greedy.wrong_from=2", "greedy.refuse_in=1")
    return compare(Request(("reader", "greedy", "weightless"), "rooms", settings=settings, engine="inline"))


def test_the_page_needs_nothing_else(comparison):
    page = comparison.report.read_text()
    assert "Plotly.react" in page
    tags = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", page, flags=re.DOTALL)
    assert not re.search(r"""\b(src|href)\s*=""", tags)
    assert "default-src 'none'" in tags
    assert "@import" not in page


def test_the_plotly_bundle_is_small_and_comes_with_its_licence():
    assert (FOLDER / "assets/plotly-basic.min.js").stat().st_size < MAX_BUNDLE
    assert "MIT License" in (FOLDER / "assets/plotly-LICENSE.txt").read_text()


def test_the_page_of_a_run_holds_every_row_and_query(comparison, read):
    content, islands = read(comparison.report)
    (table,) = content["tables"]["usual"]
    assert [row[0] for row in table["rows"]] == ["reader", "greedy[wrong_from=2,refuse_in=1]", "weightless"]
    assert table["rows"][0][2].startswith("100.0 (")
    assert content["title"] == "reader, greedy[wrong_from=2,refuse_in=1] and weightless on rooms"
    assert re.fullmatch(r"Localization, \d{4}-\d\d-\d\d, salframe [\d.]+", content["subtitle"])
    assert any("weightless.pth is not at hand" in note for note in content["notes"])
    (queries,) = content["sets"]
    assert len(queries["ids"]) == 10
    assert queries["answers"].keys() == {"0", "1"}
    outcomes = [content["outcomes"][k] for k in queries["answers"]["1"]["outcome"]]
    # rooms 2 and 3 are taken for the next; in room 4 the nearest to one too many is right; room 1 is refused
    assert outcomes == ["correct"] * 2 + ["rejected"] * 2 + ["wrong place"] * 4 + ["correct"] * 2
    assert queries["poses"][2] == [4.1, 0.0, 0.0]
    assert not islands
    assert not content["pictures"]


def test_runs_side_by_side_pool_seeds(fakes, read, tmp_path):
    runs = [
        compare(Request(("reader",), "rooms", settings=(f"data.seed={seed}", *settings), engine="inline")).run
        for seed, settings in ((0, ()), (1, ()), (0, ("offset=1",)), (1, ("offset=1",)))
    ]
    content, islands = read(write_report(runs, tmp_path / "page.html").path)
    table = content["tables"]["usual"][0]
    assert [arm["name"] for arm in content["arms"]] == ["reader", "offset=1"]
    assert table["headings"][:2] == ["offset", "seeds"]
    assert [row[:2] for row in table["rows"]] == [["0", "2"], ["1", "2"]]
    accuracy = table["headings"].index("accuracy %\n(95 % CI)")
    assert [row[accuracy].split()[0] for row in table["rows"]] == ["100.0", "20.0"]  # of five rooms the last is right
    assert len(content["sets"]) == 2  # two buildings, each with both arms
    assert all(one["answers"].keys() == {"0", "1"} for one in content["sets"])
    assert {id for id in islands if id.startswith("pq")} == {f"pq{s}-{i}" for s in range(2) for i in range(10)}


def test_the_columns_of_the_first_table_are_chosen(comparison, read, tmp_path):
    output = tmp_path / "page.html"
    assert salframe("report", str(comparison.run), "-o", str(output), "--columns", "accuracy,p").code == 0
    content, _ = read(output)
    assert content["tables"]["usual"][0]["headings"] == ["method", "accuracy %\n(95 % CI)", "p\n(Holm)"]
    refused = salframe("report", str(comparison.run), "-o", str(output), "--columns", "acuracy")
    assert refused.err.startswith("error: unknown column 'acuracy'")


def test_the_command_says_where_the_page_lies(comparison, tmp_path):
    output = tmp_path / "new" / "page.html"
    done = salframe("report", str(comparison.run), "-o", str(output))
    assert done.code == 0
    assert done.out == f"{output}: {output.stat().st_size / 1e6:.1f} MB\n"


def test_what_cannot_be_shown_together_is_refused(comparison, tmp_path):
    with pytest.raises(ConfigError, match="received no run"):
        write_report([])
    with pytest.raises(ConfigError, match="is not a run folder"):
        write_report([tmp_path])
    with pytest.raises(DataError, match="cannot write"):
        write_report([comparison.run], comparison.run / "request.yaml" / "page.html")


def test_labels_are_escaped(fakes):
    page = compare(Request(("reader",), "rooms", name="<script>alert(1)<", engine="inline")).report.read_text()
    assert "<script>alert(1)" not in page


def test_the_accuracy_figure_is_drawn_to_scale(comparison):
    figure = ElementTree.parse(comparison.run / "accuracy.svg").getroot()
    names = {"s": "http://www.w3.org/2000/svg"}
    widths = [float(bar.get("width")) for bar in figure.findall("s:rect", names)]
    accuracy = [row.accuracy.value for row in comparison.rows if row.measured]
    assert widths == pytest.approx([400 * value for value in accuracy], abs=0.05)
    assert "reader" in [text.text for text in figure.findall("s:text", names)]


def test_a_run_without_a_measured_method_has_a_page(fakes):
    comparison = compare(Request(("weightless",), "rooms", engine="inline"))
    assert "weightless.pth is not at hand" in comparison.report.read_text()
    assert not (comparison.run / "accuracy.svg").exists()


def test_a_task_without_a_page_is_refused(furnished, tmp_path):
    run = measure_matching(Request(("points",), "furnished", engine="inline")).run
    with pytest.raises(ConfigError, match="has the task 'matching', which has no HTML report"):
        write_report([run], tmp_path / "page.html")
