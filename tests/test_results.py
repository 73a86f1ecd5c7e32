"""README and the page of results: their commands are salframe's, and their figures agree."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import pytest
import typer

from salframe.cli import app
from salframe.evaluation.studies.experiment import experiment_names, read_experiment
from salframe.evaluation.studies.stored import read_results
from salframe.framework.components.presets import names

REPOSITORY = Path(__file__).parent.parent
README = (REPOSITORY / "README.md").read_text()
SUMMARY = REPOSITORY / "docs" / "results.md"
PAGES = [SUMMARY, *sorted((REPOSITORY / "docs" / "results").glob("*.md"))]
DRAWN = [*PAGES, REPOSITORY / "docs" / "how-to" / "experiments.md"]
RESULTS = "\n".join(page.read_text() for page in PAGES)
COMMANDS = sorted(set(re.findall(r"^\s*(salframe .*)$", README + RESULTS, re.MULTILINE)))


def tables(text: str) -> list[list[list[str]]]:
    """The tables of a text, each the cells of its rows, the header first."""
    found = re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE)
    lines = [[line for line in table.splitlines() if not set(line) <= set("-| ")] for table in found]
    return [[[cell.strip(" *") for cell in line[1:-1].split("|")] for line in table] for table in lines]


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_names_options_methods_and_data_that_there_are(line):
    command, *words = shlex.split(line, comments=True)[1:]
    options = typer.main.get_command(app).commands[command].make_context(command, words).params
    assert set((options.get("methods") or "proposed").split(",")) <= set(names("localizer"))
    data = options.get("data") or "house-6"
    assert data in names("dataset") or data == "path/to/my/folder"
    if command == "experiment":
        assert options["name"] in (*experiment_names(), "all", None)


@pytest.mark.parametrize("page", DRAWN, ids=lambda page: page.stem)
def test_the_pages_are_drawn_from_the_stored_results(page):
    """python docs/generate_results.py"""
    drawn = runpy.run_path(str(REPOSITORY / "docs" / "generate_results.py"))
    text = page.read_text()
    assert drawn["redraw"](text) == text
    assert re.findall(r"<!-- experiment: ([\w-]+) -->", text) == [page.stem] * (page.stem in experiment_names())
    assert sorted(drawn["pages"]()) == sorted(DRAWN)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_defines_the_terms_of_its_tables(page):
    """docs/result_terms.yaml, or a table on the page"""
    drawn = runpy.run_path(str(REPOSITORY / "docs" / "generate_results.py"))
    assert drawn["undefined"](page.read_text()) == set()


def test_what_is_kept_is_of_experiments_that_there_are():
    for file in (REPOSITORY / "docs" / "results").glob("*.json"):
        experiment, results = read_experiment(file.stem), read_results(file)
        assert set(results.whole) | set(results.quick) <= set(experiment.tables)


def test_a_measured_table_says_what_each_method_was_given():
    measured = [table for table in tables(RESULTS) if "method" in table[0]]
    assert measured
    for header, *rest in measured:
        if "input" in header:
            place = header.index("input")
            assert all(len(row) == len(header) and row[place] for row in rest)
        else:
            assert set(header) & {"MMA@3 %", "ROC area", "model %"}


def test_every_row_of_readmes_table_stands_in_a_table_of_its_data():
    header, *rows = tables(README.partition("\n## Results")[2].partition("\n## ")[0])[0]
    assert header == ["data", "method", "input", "accuracy % (95 % CI)", "median pose error", "bytes /panorama"]
    real, office = tables(SUMMARY.read_text())[:2]
    measured = {"10 real buildings": real, "5 rendered offices": office}
    assert len(rows) == 6
    for data, *cells in rows:
        assert any(set(cells) <= {cell.partition("[")[0] for cell in row} for row in measured[data]), cells


def test_readme_is_short_and_its_make_targets_are_there():
    assert len(README.splitlines()) < 120
    targets = re.findall(r"^([a-z]+):", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    for page in ("README.md", "CONTRIBUTING.md", "docs/how-to/experiments.md"):
        assert set(re.findall(r"\bmake ([a-z]+)(?=`|  )", (REPOSITORY / page).read_text())) <= set(targets)


def test_the_tables_on_photographs_are_drawn_from_what_the_script_printed():
    """python docs/generate_photographs.py"""
    drawn = runpy.run_path(str(REPOSITORY / "docs" / "generate_photographs.py"))
    text = (REPOSITORY / "docs" / "how-to" / "segments.md").read_text()
    assert drawn["page"](text) == text
    section = text.partition("## Accuracy on photographs")[2].partition("## Localization in rendered buildings")[0]
    found = tables(section)
    assert [len(table) for table in found] == [5, 13, 6, 7]
    assert found[0][1][:2] == ["`segments`, `ade20k`", "71.4"]
