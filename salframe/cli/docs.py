"""The command `docs`: shows the pages of the documentation, which are installed with salframe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json, tell

SECTIONS = ("index", "tutorials", "how-to", "results", "explanation", "reference")
"""Folders of pages, in the order in which pages are listed, and in which a page with a short name is searched."""


def docs(
    page: Annotated[
        str | None,
        typer.Argument(
            metavar="PAGE", help="Page to open, such as `maps` or `results/scale` (default: list the pages)"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a page of the documentation."""
    from rich.console import Console
    from rich.markdown import Markdown

    from salframe.framework.errors import UnknownName, unknown
    from salframe.framework.files.reading import read_text

    folder, pages = _folder(), _pages()
    if page is None:
        titles = {name: _title(read_text(folder / f"{name}.md")) for name in pages}
        if as_json:
            print_json([{"page": name, "title": title} for name, title in titles.items()])
            return
        width = max(map(len, titles))
        for name, title in titles.items():
            print(f"{name:{width}}  {title}")
        return
    matches = [name for name in pages if page in (name, name.rpartition("/")[2])]
    if not matches:
        raise UnknownName(unknown("page", page, pages if "/" in page else [name.rpartition("/")[2] for name in pages]))
    match, *others = matches
    if others:
        tell(f"other pages with this name: {', '.join(others)}")
    path = folder / f"{match}.md"
    text = read_text(path)
    if as_json:
        print_json({"page": match, "path": str(path), "text": text})
    elif (console := Console()).is_terminal:
        with console.pager(styles=True):
            console.print(Markdown(text))
    else:
        print(text, end="")


def _folder() -> Path:
    """Return the folder of the pages, in the installed package or in the clone of the repository."""
    package = Path(__file__).parents[1]
    installed = package / "docs"
    return installed if installed.is_dir() else package.parent / "docs"


def _pages() -> list[str]:
    """Return the names of all pages: paths without suffix, in the order of SECTIONS."""
    folder = _folder()
    names = [path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.md")]
    return sorted(names, key=lambda name: (SECTIONS.index(_section(name)), name.count("/"), name))


def _section(name: str) -> str:
    return name.partition("/")[0]


def _title(text: str) -> str:
    return text.partition("\n")[0].removeprefix("# ")
