"""weights list, weights fetch, weights where: the files of trained networks."""

from __future__ import annotations

from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json

app = typer.Typer(
    help="List, fetch and find the weights of networks. Nothing is downloaded unless you fetch it.",
    no_args_is_help=True,
)
Name = Annotated[str, typer.Argument(help="As in `salframe weights list`.")]


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List the weights that components use, their licence (and what they were trained on, where that has terms of its
    own), size and source, and whether they are at hand."""
    from salframe.cli.tables import print_table
    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.components.installation import list_weights
    from salframe.framework.components.registry import registry
    from salframe.framework.errors import failure_of

    rows = []
    for weights in list_weights(registry()):
        state = "not at hand" if failure_of(weights.paths) else str(weights.paths()[0].parent)
        rows.append([weights.name, weights.terms, format_bytes(weights.size_bytes), str(weights.source), state])
    headings = ("name", "licence", "size", "source", "where")
    if as_json:
        print_json([dict(zip(headings, row, strict=True)) for row in rows])
    else:
        print_table(headings, rows)


@app.command()
def fetch(name: Name) -> None:
    """Download weights into salframe's cache, unless they are at hand, and verify them; their licence, and the terms of
    what they were trained on, are told on stderr."""
    from salframe.cli.output import Bars
    from salframe.framework.components.installation import fetch_weights, find_weights
    from salframe.framework.components.registry import registry

    typer.echo(f"{name}: {find_weights(name, registry()).terms}", err=True)
    with Bars() as bars:
        paths = fetch_weights(name, lambda done, total: bars.update(f"{name} (kB)", done // 1000, total // 1000))
    for path in paths:
        print(path)


@app.command()
def where(name: Name) -> None:
    """Print the paths of weights that are at hand."""
    from salframe.framework.components.installation import find_weights
    from salframe.framework.components.registry import registry

    for path in find_weights(name, registry()).paths():
        print(path)
