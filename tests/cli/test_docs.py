"""The command `docs`: pages by name."""

from __future__ import annotations

from pathlib import Path

from command_line import run

DOCS = Path(__file__).parents[2] / "docs"


def test_every_page_is_listed_with_its_title():
    listed = {line.split()[0]: line.split(maxsplit=1)[1] for line in run("docs").out.splitlines()}
    assert {f"{name}.md" for name in listed} == {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    assert listed["how-to/maps"] == (DOCS / "how-to/maps.md").read_text().partition("\n")[0].removeprefix("# ")


def test_a_page_is_printed_by_its_name_or_its_path():
    assert run("docs", "maps").out == (DOCS / "how-to/maps.md").read_text()
    assert run("docs", "results/matching").out == (DOCS / "results/matching.md").read_text()
    matching = run("docs", "matching")
    assert matching.out == (DOCS / "how-to/matching.md").read_text()
    assert matching.err == "other pages with this name: results/matching\n"
    assert not run("docs", "results/matching").err
    assert run("docs", "maps", "--json").json["page"] == "how-to/maps"


def test_an_unknown_page_is_one_line():
    done = run("docs", "map")
    assert done.code == 2
    assert done.err.startswith("error: unknown page 'map', did you mean 'maps'? Known: index, ")


def test_an_unknown_path_of_a_page_is_compared_with_paths():
    assert run("docs", "how-to/map").err.startswith("error: unknown page 'how-to/map', did you mean 'how-to/maps'? ")
