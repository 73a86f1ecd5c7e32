"""The command `score`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json


def score(
    task: Annotated[
        str, typer.Argument(metavar="BENCHMARK", help="Benchmark, such as reverie; see `salframe show scorer`")
    ],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File with the answers, in the format of the benchmark")],
    data: Annotated[Path, typer.Option(metavar="DIR", help="Folder with the downloaded data of the benchmark")],
    as_json: Json = False,
) -> None:
    """Score a file of answers to a benchmark.

    Any program can write the file. Prints the metrics of the benchmark, in one row for each split (part) of its data.
    """
    from salframe.cli.tables import print_table
    from salframe.evaluation.scorer import score as run

    rows = run(task, file, data)
    if as_json:
        print_json(rows)
    else:
        print_table(
            list(rows[0]),
            [[f"{value:.2f}" if isinstance(value, float) else str(value) for value in row.values()] for row in rows],
        )
