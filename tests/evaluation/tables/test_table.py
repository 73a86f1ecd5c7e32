"""Tables as text: columns, best cells, formats."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import pytest

from salframe.evaluation.runs.run_folder import MethodStatus
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.formats import to_csv, to_latex, to_markdown
from salframe.evaluation.tables.reported import ReportedTable, reported_table
from salframe.evaluation.tables.table import Table, split_table
from salframe.evaluation.tables.text import format_bytes
from salframe.evaluation.tasks.all import ALL
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.evaluation.tasks.localization.task import LocalizationTask
from salframe.evaluation.tasks.matching.table import MatchingRow
from salframe.evaluation.tasks.matching.task import MatchingTask


def row(method: str, accuracy: float | None, **given) -> LocalizationRow:
    estimate = None if accuracy is None else Estimate(accuracy, accuracy / 2, 1.0)
    return LocalizationRow(method=method, queries=4, accuracy=estimate, **given)


ROWS = [
    row("a_b", 0.75, input=("annotations + panoseg noise", "range"), by_part=(0.5, 1.0), p_adjusted=None),
    row("50 % | more", 0.5, input=("rgb",), by_part=(0.25, 0.75), p_adjusted=0.0421),
    row("absent", None, ended=MethodStatus.UNAVAILABLE),
]


def test_a_table_has_a_row_a_method_and_says_what_it_was_given():
    (table,) = LocalizationTask.tables(ROWS, ("input", "accuracy", "seed_range", "p"))
    assert table.headings == ("method", "input", "accuracy %\n(95 % CI)", "per-seed\nrange %", "p\n(Holm)")
    assert list(map(list, table.rows)) == [
        ["a_b", "annotations + panoseg noise, range", "75.0 (38-100)", "50-100", ""],
        ["50 % | more", "colour", "50.0 (25-100)", "25-75", "0.042"],
        ["absent", "-", "-", "-", "-"],
    ]
    assert table.best == {(0, 2)}


@pytest.mark.parametrize(("largest", "best"), [("macro_recall", 1), ("false_accept_rate", 0), ("calibration_error", 0)])
def test_the_best_is_the_largest_or_the_least(largest, best):
    rows = [row("a", 0.5, **{largest: 0.1}), row("b", 0.5, **{largest: 0.9})]
    (table,) = LocalizationTask.tables(rows, (largest,))
    assert table.best == {(best, 1)}


def test_none_is_best_where_all_are_alike():
    (table,) = LocalizationTask.tables([row("a", 0.5), row("b", 0.5)], ("accuracy",))
    assert not table.best


def test_rows_of_other_data_do_not_compete():
    rows = [row("a", 0.9), row("b", 0.8), row("a", 0.3), row("b", 0.4)]
    leading = {"data": ["x", "x", "y", "y"], "method": list("abab"), "key": ["", "", "", ""]}
    assert LocalizationTask.tables(rows, ("accuracy",), leading)[0].best == {(0, 3), (3, 3)}


def test_what_is_usual_has_the_spread_of_seeds_only_where_there_are_some():
    assert "per-seed\nrange %" in LocalizationTask.tables(ROWS)[0].headings
    assert "per-seed\nrange %" not in LocalizationTask.tables([row("a", 1.0)])[0].headings


def test_queries_without_their_place_have_a_table_of_their_own():
    known = row("told", 0.5, absent_queries=2, roc_area=Estimate(0.9), precision_at=(1.0, 0.5, None))
    known = replace(known, present_accuracy=Estimate(0.75, 0.5, 0.875))
    known = replace(known, average_precision=Estimate(0.8, 0.625, 1.0))
    _, worth = LocalizationTask.tables([ROWS[0], known], leading={"arm": ["x", "y"]})
    assert worth.title == "out-of-map queries"
    told = ["75.0 (50-88)", "-", "-", "100/50/-", "80.0 (62-100)", "90.0", "-", "-"]
    assert list(worth.rows[0]) == ["y", *told]
    assert len(worth.rows) == 1


def test_points_and_nodes_stand_apart():
    points, nodes = MatchingRow(method="p", pairs=2, kind="points"), MatchingRow(method="n", pairs=2, kind="nodes")
    found = MatchingTask.tables([points, nodes, MatchingRow(method="none", pairs=2)])
    assert [[cells[0] for cells in table.rows] for table in found] == [["p"], ["n"]]


@pytest.mark.parametrize("task", ALL, ids=lambda task: task.name)
def test_every_usual_column_is_there(task):
    assert set(task.default_columns) <= set(task.columns)


def test_markdown_bolds_the_best_and_escapes_bars():
    (table,) = LocalizationTask.tables(ROWS[:2], ("accuracy",))
    assert to_markdown(table) == (
        "| method | accuracy % (95 % CI) |\n|---|---|\n| a_b | **75.0 (38-100)** |\n| 50 % \\| more | 50.0 (25-100) |\n"
    )


def test_latex_is_that_of_booktabs():
    (table,) = LocalizationTask.tables(ROWS[:2], ("accuracy",))
    assert to_latex(table).splitlines() == [
        r"\begin{tabular}{lr}",
        r"\toprule",
        r"method & \shortstack[r]{accuracy \% \\ (95 \% CI)} \\",
        r"\midrule",
        r"a\_b & \textbf{75.0 (38-100)} \\",
        r"50 \% | more & 50.0 (25-100) \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]
    assert r"1\textdegree{}" in to_latex(Table(("x",), [["1°"]]))
    floating = to_latex(table, "Accuracy of 2 & 3", "tab:accuracy").splitlines()
    assert floating[0] == r"\begin{table}"
    assert floating[3:5] == [r"\caption{Accuracy of 2 \& 3}", r"\label{tab:accuracy}"]
    assert floating[5:-1] == to_latex(table).splitlines()


def test_csv_has_all_numbers_in_full():
    rows = [row("a, b", 1 / 3, by_part=(0.25, 0.5)), row("c", None)]
    first, second = csv.DictReader(io.StringIO(to_csv([one.to_json() for one in rows], [{"arm": "x"}, {}])))
    assert (first["arm"], first["method"], float(first["accuracy"])) == ("x", "a, b", 1 / 3)
    assert first["by_part"] == "0.25; 0.5"
    assert (second["arm"], second["accuracy"]) == ("", "")


def test_what_papers_report_is_a_table_apart():
    table = reported_table(ReportedTable(title="Rooms", figures=("accuracy",), rows={"6 rooms": (1.0,)}))
    assert (table.title, table.headings[0]) == ("Rooms", "reported, not measured")
    assert list(table.rows[0]) == ["6 rooms", "1"]


def test_it_is_told_where_no_detector_ran():
    assert LocalizationTask.legend(ROWS) == ["describe ms: no detector time for a_b, which use annotations"]
    assert LocalizationTask.legend(ROWS[1:]) == []
    many = LocalizationTask.legend(4 * ROWS[:1])
    assert many == ["describe ms: no detector time for all 4 methods, which use annotations"]


@pytest.mark.parametrize(("size", "text"), [(None, "-"), (999, "999 B"), (1500, "1.5 kB"), (123456, "123 kB")])
def test_bytes_are_decimal(size, text):
    assert format_bytes(size) == text


def test_a_table_that_is_too_wide_is_split_with_costs_apart():
    """Two columns fit beside the leading one; the best cell stays the best."""
    table = Table(("m", "a", "b", "c", "$"), [["x", "1", "2", "3", "4"]], frozenset({(0, 3)}), frozenset({4}))
    parts = split_table(table, lambda part: len(part.headings) <= 3)
    assert [tuple(part.headings) for part in parts] == [("m", "a", "b"), ("m", "c"), ("m", "$")]
    assert [set(part.best) for part in parts] == [set(), {(0, 1)}, set()]
    assert split_table(table, lambda part: True) == [table]
