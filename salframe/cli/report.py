"""The command `report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Columns, split_names


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN", help="Run folders to compare, all written by the same command, such as `compare`"
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.html", help="HTML file to write the report to")
    ] = Path("report.html"),
    full: Annotated[bool, typer.Option("--full", help="Include panoramas in full size instead of thumbnails")] = False,
    columns: Columns = None,
) -> None:
    """Write an HTML report that compares runs.

    The report is one file that can be read offline. It shows the results of the runs side by side, and the details of
    every query.
    """
    from salframe.cli.output import LIST_COLUMNS, Bars, print_columns, tell
    from salframe.evaluation.finished_runs import write_report
    from salframe.evaluation.tasks.all import open_run

    names = split_names(columns or "")
    if names == LIST_COLUMNS:
        _, task = open_run(runs[0])
        print_columns([type(task)])
        return
    with Bars() as bars:
        result = write_report(runs, output, full=full, columns=names, progress=bars.update)
    for note in result.notes:
        tell(note)
    print(f"{result.path}: {result.path.stat().st_size / 1e6:.1f} MB")
