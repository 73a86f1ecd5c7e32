"""Sections of the documentation that docstrings and comments cite."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent
FOLDERS = ("salframe", "plugins", "baselines", "configs", "examples", "training", "tests", "docs")
CITATION = re.compile(r"(?:(docs/[\w/-]+)/)?([\w-]+)\.md(?:#([\w-]+))?")
SECTION = re.compile(r"\bmethod\.md,? (?:\d|Metrics)")


def sources() -> list[Path]:
    """Files of code and settings of the repository."""
    files = (path for folder in FOLDERS for path in (REPOSITORY / folder).rglob("*"))
    return sorted(path for path in files if path.suffix in {".py", ".pyi", ".yaml"} and path != Path(__file__))


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as mkdocs makes them."""
    lines = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE).splitlines()
    headings = [line.lstrip("#").strip().lower() for line in lines if line.startswith("#")]
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", heading)) for heading in headings}


CITED = sorted(
    {
        (str(path.relative_to(REPOSITORY)), f"{found[1]}/{found[2]}.md", found[3])
        for path in sources()
        for found in CITATION.finditer(path.read_text(encoding="utf-8"))
        if found[1] and found[3]
    }
)


@pytest.mark.parametrize(("source", "page", "anchor"), CITED, ids=lambda value: value)
def test_a_cited_section_is_there(source, page, anchor):
    assert anchor in anchors(REPOSITORY / page), f"{source} cites #{anchor} of {page}, which has no such heading"


def test_sections_are_cited_by_their_anchors():
    assert len(CITED) > 20
    wrong = [path for path in sources() if SECTION.search(path.read_text(encoding="utf-8"))]
    assert wrong == []
