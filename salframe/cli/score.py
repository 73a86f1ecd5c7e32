"""score: what some other program answered to a published task."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json


def score(
    task: Annotated[str, typer.Argument(help="The task: a scorer of `salframe plugins`.")],
    file: Annotated[Path, typer.Argument(help="The file of answers, in the task's own format.")],
    data: Annotated[Path, typer.Option(metavar="DIR", help="Folder that holds the task's data.")],
    as_json: Json = False,
) -> None:
    """Score a file of answers to a published task by the task's own rules, one row a split."""
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
