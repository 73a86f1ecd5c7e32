"""The settings beside the label of a method: those that differ from the preset of its name."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from command_line import run as salframe

from salframe.evaluation.runs.changes import base_of, hidden_in, with_changes
from salframe.evaluation.runs.request import Request, Variant, resolve
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.studies.study import ablate
from salframe.evaluation.tasks.localization.task import compare


def changes(*methods, settings=()):
    return dict(resolve(Request(methods, "rooms", settings=settings, engine="inline")).changes)


@pytest.fixture
def shipped(fakes, presets):
    presets({"tuned": {"kind": "reader", "offset": 2}})


def test_only_what_differs_from_the_preset_is_listed(shipped):
    assert changes("tuned", "reader") == {}
    assert changes("tuned", "reader", settings=("tuned.offset=2", "reader.offset=0")) == {}
    assert changes("tuned", "reader", settings=("tuned.offset=0",)) == {"tuned": ("offset=0",)}
    assert changes("tuned", settings=("wrong_from=3", "offset=1")) == {"tuned": ("offset=1", "wrong_from=3")}


def test_a_file_of_the_name_of_a_preset_is_compared_with_it(shipped):
    Path("tuned.yaml").write_text("kind: reader\noffset: 1\n")
    assert changes("tuned.yaml") == {"tuned": ("offset=1",)}
    Path("tuned.yaml").write_text("kind: greedy\n")
    assert changes("tuned.yaml") == {"tuned": ("kind=greedy",)}
    Path("mine.yaml").write_text("kind: reader\noffset: 1\n")
    assert changes("mine.yaml") == {"mine": ("kind=reader", "offset=1")}


def test_a_setting_in_a_label_is_not_repeated(shipped):
    variant = Variant("tuned", {"offset": 5}, "tuned", "tuned[offset=5]")
    assert changes(variant) == {}
    assert changes(variant, settings=("wrong_from=3",)) == {"tuned[offset=5]": ("wrong_from=3",)}
    assert changes(Variant("tuned", {"offset": 5})) == {"tuned": ("offset=5",)}


@pytest.mark.parametrize("style", ["table", "md", "latex", "csv", "json"])
def test_every_table_shows_them(shipped, style):
    more = ("--json",) if style == "json" else ("--format", style)
    done = salframe(
        "compare", "--methods", "tuned", "--data", "rooms", "--engine", "inline", "--set", "tuned.wrong_from=3", *more
    )
    text = done.out.replace(r"\_", "_")
    assert "wrong_from=3" in text
    assert "offset=" not in text


def test_the_run_records_them_and_the_page_shows_them(shipped, read):
    result = compare(Request(("tuned", "reader"), "rooms", settings=("tuned.wrong_from=3",), engine="inline"))
    assert Run.load(result.run).changes("tuned") == ("wrong_from=3",)
    assert result.row("tuned").title == "tuned[wrong_from=3]"
    content, _ = read(result.report)
    assert [arm["name"] for arm in content["arms"]] == ["tuned[wrong_from=3]", "reader"]
    assert content["tables"]["usual"][0]["rows"][0][0] == "tuned[wrong_from=3]"
    printed = salframe("evaluate", str(result.run))
    assert "[wrong_from=3]" in printed.out


def test_an_ablation_shows_settings_that_it_does_not_vary(shipped):
    study = {"method": "tuned", "data": "rooms", "vary": {"offset": [0, 1]}, "set": {"tuned.wrong_from": 3}}
    Path("study.yaml").write_text(yaml.safe_dump(study))
    result = ablate("study.yaml", Request((), engine="inline"))
    (table, *_) = result.tables()
    assert [list(row[:2]) for row in table.rows] == [["tuned[wrong_from=3]", "0"], ["tuned[wrong_from=3]", "1"]]


def test_a_title_is_short():
    assert with_changes("m", ()) == "m"
    assert with_changes("m", [f"k{number}=0" for number in range(6)]) == "m[k0=0,k1=0,k2=0,k3=0,2 more]"
    assert base_of("m[a=1] without positioning") == "m without positioning"
    assert hidden_in(["slot=x", "b=1"], {"slot.kind": "x"}) == ["b=1"]
