"""Figures of papers: what is shipped, and that they never stand among measured rows."""

from __future__ import annotations

import json

import pytest
from command_line import run

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tables.reported import Reported, read_reported
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.errors import ConfigError
from salframe.framework.validation import validate


def test_the_papers_figures_are_shipped_with_their_source():
    (paper,) = read_reported()
    assert "360° Saliency Graph" in paper.source
    tables = {table.title: dict(table.rows) for table in paper.tables}
    assert list(tables["Scene localization"]) == ["LDL", "FGPL", "MiC", "MFP-CNN", "SOVS", "proposed"]
    assert list(tables["Scene localization"].values()) == [(35,), (71,), (78,), (80,), (82,), (86,)]
    assert list(tables["Components"].values()) == [(68,), (76,), (82,), (84,), (86,)]
    assert tables["Keypoint matching"]["LoFTR"] == (36.07,)
    assert tables["Accuracy by focal length"]["SOVS"] == (47, 36, 29)
    assert tables["Navigation on REVERIE"]["DUET"] == (51.07, 46.98, 33.73)
    assert tables["Perturbation"]["objects, 66 %"] == (67, 40.28, 31.77)


@pytest.fixture
def shipped(plugins):
    """The components of fake_plugin, the engines, and what salframe ships beside components."""
    plugins("fake_plugin", "salframe_engines", "salframe.configs")


def test_json_holds_them_under_a_key_of_their_own(shipped):
    done = run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--json", "--reported")
    assert [list(row) for row in done.json["rows"]] == [list(LocalizationRow(method="reader", queries=10).to_json())]
    (paper,) = done.json["reported"]
    assert paper["tables"][1]["rows"]["SOVS"] == [82]


def test_the_terminal_shows_them_below_the_measured_table(shipped):
    lines = run(
        "compare", "--methods", "reader,weightless", "--data", "rooms", "--engine", "inline", "--reported"
    ).out.splitlines()
    (heading,) = [i for i, line in enumerate(lines) if line.strip() == "reported, not measured"]
    assert any(line.strip().startswith("reader") for line in lines[:heading])
    assert not any(line.strip().startswith(("reader", "weightless")) for line in lines[heading:])
    assert not any("SOVS" in line for line in lines[:heading])
    assert [line.split() for line in lines[heading:] if "Airbert" in line] == [["Airbert", "34.51", "27.89", "21.88"]]
    assert max(map(len, lines[:-1])) <= 100


def test_the_report_holds_them_apart_from_what_is_measured(shipped, read):
    request = Request(("reader",), "rooms", engine="inline")
    content, _ = read(compare(request, reported=True).report)
    (paper,) = content["reported"]
    assert paper["tables"][1]["rows"]["SOVS"] == [82]
    assert "SOVS" not in json.dumps(content["tables"])
    assert read(compare(request).report)[0]["reported"] == []


def test_a_row_with_a_number_too_few_is_told():
    table = {"title": "Navigation", "figures": ["SR", "SPL"], "rows": {"MiC": [56.97]}}
    with pytest.raises(ConfigError, match="table 'Navigation', row 'MiC': received 1 numbers, expected 2"):
        validate(Reported, {"source": "a paper", "note": "", "tables": [table]}, "paper.yaml:")
