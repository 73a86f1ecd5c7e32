"""fit: what the scores of a method are worth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import DataDir, Set


def fit(
    method: Annotated[str, typer.Argument(help="A preset or localizer with the setting `posterior`.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.yaml", help="File to write.")],
    data: Annotated[
        list[str], typer.Option(help="Tuning data, never what is reported: as for `compare`; may be given again.")
    ],
    tries: Annotated[
        list[str] | None,
        typer.Option(
            "--try",
            metavar="KEY.PATH=VALUE,VALUE",
            help="Values of a setting of matching, of which the one that fits best is kept; may be given again.",
        ),
    ] = None,
    data_dir: DataDir = None,
    overrides: Set = None,
) -> None:
    """Fit a method's numbers to tuning data: settings to try, the weights of its evidence where it has any, and the
    probabilities of its places and of none of them, for which each query is asked of its map and of the map without its
    place. `--set posterior=FILE.yaml` and `--set weights=FILE.yaml` take what is written."""
    from salframe.cli.output import Bars, tell
    from salframe.evaluation.studies.fitting import fit_method

    with Bars() as bars:
        found = fit_method(
            method,
            data,
            output,
            tries=tries or (),
            data_dir=data_dir,
            overrides=overrides or (),
            progress=bars.update,
            tell=tell,
        )
    for line in found:
        print(line)
    print(output)
