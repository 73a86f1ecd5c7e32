"""README and the page of results: their commands are salframe's, and their figures agree."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from salframe.cli import app
from salframe.framework.presets import names

REPOSITORY = Path(__file__).parent.parent
README = (REPOSITORY / "README.md").read_text()
RESULTS = (REPOSITORY / "docs" / "results.md").read_text()
SECTIONS = dict(section.split("\n", 1) for section in RESULTS.split("\n## ")[1:])
MEASURED = {title: text for title, text in SECTIONS.items() if title != "Measured on other pages"}
COMMANDS = sorted(set(re.findall(r"^\s*(salframe .*)$", README + RESULTS, re.MULTILINE)))


def rows(text: str) -> list[list[str]]:
    """The cells of every row of the tables in a text."""
    lines = re.findall(r"^\|(.*)\|$", text, re.MULTILINE)
    return [[cell.strip(" *") for cell in line.split("|")] for line in lines if not set(line) <= set("-|")]


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_names_options_methods_and_data_that_there_are(line):
    command, *words = shlex.split(line, comments=True)[1:]
    words = [re.sub("^NAMES$", "proposed", word) for word in words]
    options = typer.main.get_command(app).commands[command].make_context(command, words).params
    known = {"methods": names("localizer"), "detectors": names("detector")}
    for option, there_are in known.items():
        assert set(options.get(option, "proposed").split(",")) <= {*there_are, "proposed"}
    data = options.get("data") or "house-6"
    assert data in names("dataset") or data == "path/to/my/folder"


@pytest.mark.parametrize("title", MEASURED)
def test_a_table_says_its_command_its_noise_and_what_each_method_was_given(title):
    text = MEASURED[title]
    assert "```\n" in text
    assert "noise" in text.lower()
    header, *rest = rows(text)
    (given,) = [place for place, cell in enumerate(header) if cell.endswith("given")]
    assert all(len(row) == len(header) and row[given] for row in rest)


def test_every_row_of_readmes_results_stands_on_the_page_of_results():
    header, *told = rows(README.partition("\n## Results")[2].partition("\n## ")[0])
    assert header == ["method", "given", "accuracy %", "median pose error", "bytes a scene"]
    assert len(told) == 5
    measured = [set(row) for row in rows(RESULTS)]
    for row in told:
        assert any(set(row) <= cells for cells in measured), row


def test_readme_is_short_and_its_make_targets_are_there():
    assert len(README.splitlines()) < 120
    targets = re.findall(r"^([a-z]+):", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    for page in ("README.md", "CONTRIBUTING.md", "docs/results.md"):
        assert set(re.findall(r"\bmake ([a-z]+)(?=`|  )", (REPOSITORY / page).read_text())) <= set(targets)
