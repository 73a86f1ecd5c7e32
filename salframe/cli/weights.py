"""The commands `weights list`, `weights fetch` and `weights where`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json

app = typer.Typer(help="List, download and locate the weights of networks.", no_args_is_help=True)
Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME", help="Weights: a name in `salframe weights list`, or a Hugging Face model hf:ORG/MODEL@REVISION"
    ),
]


@app.command("list")
def list_(
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            "-v",
            help="Also print the source, folder and sha256 of the weights, and the terms of their training data",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """List the weights that components use.

    The state is `ready`, `absent` (not downloaded) or `another file` (wrong content). `--verbose` adds the source, the
    folder, the sha256 of each file, and the terms of the training data.
    """
    from salframe.cli.tables import print_table
    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.components.installation import list_weights
    from salframe.framework.components.registry import registry

    entries: list[dict[str, Any]] = []
    for weights in list_weights(registry()):
        state = weights.state
        entries.append(
            {
                "name": weights.name,
                "licence": weights.terms if as_json or verbose else weights.licence,
                "size": format_bytes(weights.size_bytes),
                "state": state,
                "source": str(weights.source),
                "folder": "" if state == "absent" else str(weights.find()[0].parent),
                "sha256": {file.name: file.sha256 for file in weights.files},
            }
        )
    if as_json:
        print_json(entries)
    elif verbose:
        for entry in entries:
            print(f"{entry['name']}: {entry['state']}, {entry['size']}")
            for key in ("licence", "source", "folder"):
                if entry[key]:
                    print(f"  {key:7}  {entry[key]}")
            for file, sha256 in entry["sha256"].items():
                print(f"  sha256   {sha256}  {file}")
    else:
        headings = ("name", "licence", "size", "state")
        print_table(headings, [[entry[heading] for heading in headings] for entry in entries])


@app.command()
def fetch(name: Name) -> None:
    """Download weights to the cache of salframe and verify them.

    Weights that are in the cache are not downloaded again. Also prints the licence, and the terms of the training data
    if they differ from the licence.

    The name of a model of the Hugging Face hub is hf:ORG/MODEL@REVISION. The default of REVISION is main. Only
    safetensors files of the model are downloaded. The first download pins the revision to a commit, which is printed.
    """
    from salframe.cli.output import Bars
    from salframe.framework.components.installation import fetch_weights, find_weights
    from salframe.framework.components.registry import registry
    from salframe.framework.files.hub import is_hub_name

    on_hub = is_hub_name(name)
    if not on_hub:
        typer.echo(f"{name}: {find_weights(name, registry()).terms}", err=True)
    with Bars() as bars:
        paths = fetch_weights(name, lambda done, total: bars.update(f"{name} (kB)", done // 1000, total // 1000))
    if on_hub:
        weights = find_weights(name, registry())
        typer.echo(f"{weights.name}: {weights.terms}", err=True)
    for path in paths:
        print(path)


@app.command()
def where(name: Name) -> None:
    """Print the paths of weights in the cache."""
    from salframe.framework.components.installation import find_weights
    from salframe.framework.components.registry import registry

    for path in find_weights(name, registry()).paths():
        print(path)
