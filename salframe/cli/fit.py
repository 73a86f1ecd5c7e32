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
    data_dir: DataDir = None,
    overrides: Set = None,
) -> None:
    """Fit the probabilities of a method's places, and of none of them, to tuning data: each query is asked of its map
    and of the map without its place. `--set posterior=FILE.yaml` takes what is written."""
    from salframe.cli.output import Bars, tell
    from salframe.evaluation.fitting import fit_method, summary

    with Bars() as bars:
        found = fit_method(
            method, data, output, data_dir=data_dir, overrides=overrides or (), progress=bars.update, tell=tell
        )
    for line in summary(found):
        print(line)
    print(output)
