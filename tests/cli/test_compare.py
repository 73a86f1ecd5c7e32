"""compare and ablate: tables, exit statuses, wrong files."""

from __future__ import annotations

import json

import pytest
from command_line import run
from rich.console import Console

from salframe.cli import tables
from salframe.evaluation.tasks.localization.table import COLUMNS, DEFAULT_COLUMNS


def test_compare_prints_a_table(fakes):
    done = run(
        "compare",
        "--methods",
        "reader,greedy,weightless",
        "--data",
        "rooms",
        "--set",
        "greedy.offset=1",
        "--engine",
        "inline",
    )
    assert done.code == 0
    lines = done.out.splitlines()
    assert max(map(len, lines[:8])) <= 100
    assert any(line.strip().startswith("reader") and "100.0 (72-100)" in line for line in lines)
    assert any(line.strip().startswith("greedy") and "20.0 (3-64)" in line for line in lines)
    assert "weightless: weightless.pth is not at hand: salframe weights fetch weightless" in done.out
    assert lines[-1].startswith("report: runs/rooms-")


def test_a_narrow_terminal_cuts_no_column(fakes, monkeypatch):
    monkeypatch.setattr(tables, "_console", lambda: Console(width=80))
    lines = run("compare", "--methods", "reader,greedy", "--data", "rooms", "--engine", "inline").out.splitlines()
    assert max(map(len, lines[:-1])) <= 80
    assert not any("…" in line for line in lines)
    headings = " ".join(lines).split()
    usual = [COLUMNS[name].heading for name in DEFAULT_COLUMNS if name != "seed_range"]
    assert all(word in headings for heading in usual for word in heading.split())
    assert sum(line.strip().startswith("reader") for line in lines) == 2  # accuracy, and costs


def test_compare_prints_json_and_nothing_else(fakes):
    done = run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--json")
    assert done.err == ""
    parts = {"format", "task", "run", "report", "request", "data_fingerprint", "versions", "rows", "notes"}
    assert set(done.json) == parts
    assert [row["method"] for row in done.json["rows"]] == ["reader"]


@pytest.mark.parametrize(
    ("methods", "code"), [("reader", 0), ("weightless", 1), ("weightless,reader", 0), ("reader,unbuildable", 1)]
)
def test_exit_status_says_whether_something_was_measured_and_nothing_crashed(fakes, methods, code):
    assert run("compare", "--methods", methods, "--data", "rooms", "--engine", "inline").code == code


def test_ablate_runs_every_combination(fakes, tmp_path):
    (tmp_path / "offsets.yaml").write_text(
        "method: reader\ndata: rooms\nset: {data.rooms: 4}\nvary:\n  offset: [0, -1]\n  refuse_in: [-1, 2]\n"
    )
    done = run("ablate", "offsets.yaml", "--engine", "inline", "--json")
    assert done.code == 0
    assert "/offsets-" in done.json["runs"][0]
    accuracy = {row["method"]: row["accuracy"] for row in done.json["rows"]}
    assert accuracy == {
        "reader[offset=0,refuse_in=-1]": 1.0,
        "reader[offset=0,refuse_in=2]": 0.75,
        "reader[offset=-1,refuse_in=-1]": 0.25,
        "reader[offset=-1,refuse_in=2]": 0.25,  # only room 0 is the nearest to one too few
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"method": "reader", "vary": {"offset": [1]}, "varry": {}}, "unknown key"),
        (
            {"method": "reader", "methods": ["greedy"], "vary": {"offset": [1]}},
            "`method` and `methods`, expected exactly one",
        ),
        ({"method": "reader", "vary": {"offset": []}}, "`vary` has no values for offset"),
        ({"method": "reader", "vary": {"offset": 1}}, "vary.offset"),
        ({"method": "reader", "vary": {"data.romms": [1, 2]}}, "unknown setting rooms.romms"),
        ({"method": "reader", "vary": {"ofset": [1]}}, "unknown key 'ofset', did you mean 'offset'?"),
    ],
)
def test_a_wrong_ablation_file_is_one_line(fakes, tmp_path, content, message):
    (tmp_path / "wrong.yaml").write_text(json.dumps(content))
    done = run("ablate", "wrong.yaml", "--data", "rooms")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert message in done.err


def test_columns_are_chosen_and_checked_before_the_run(fakes, tmp_path):
    options = ("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline")
    refused = run(*options, "--columns", "acuracy")
    assert refused.code == 2
    assert refused.err.startswith("error: unknown column 'acuracy', did you mean 'accuracy'?")
    assert not (tmp_path / "runs").exists()
    table = run(*options, "--columns", "accuracy,bytes", "--format", "md").out.splitlines()
    assert table[0] == "| method | accuracy % (95 % CI) | bytes /panorama |"
    latex = run(*options, "--columns", "accuracy", "--format", "latex").out.splitlines()
    assert latex[0] == r"\begin{table}"
    assert latex[5] == r"\begin{tabular}{lr}"
