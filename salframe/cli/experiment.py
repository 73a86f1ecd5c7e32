"""experiment: the tables that are reported, each by one command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.options import CommonOptions, with_common_options
from salframe.cli.output import TABLE, Bars, print_json

if TYPE_CHECKING:
    from salframe.evaluation.studies.experiment import ExperimentResult

ALL = "all"


@with_common_options(without=["data", "overrides", "name", "timeout", "memory"])
def experiment(
    name: Annotated[
        str | None, typer.Argument(help="An experiment, a YAML file, or `all`; without a name they are listed.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer seeds, queries and methods.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Measure again what is there.")] = False,
    results: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of the results that last, a JSON file an experiment.")
    ] = Path("docs/results"),
    *,
    options: CommonOptions,
) -> None:
    """Measure the tables of an experiment and keep them. What is there under the same settings and versions is shown
    again; what was cut off resumes. Tables on data that are not rendered need --data-dir.
    """
    from salframe.cli.tables import format_experiment, print_experiment, print_table
    from salframe.evaluation.studies.experiment import experiment_names, read_experiment, run_experiment

    if name is None:
        print_table(
            ("name", "tables", "what it is to show"),
            [
                [known, str(len(found.tables)), found.question]
                for known, found in ((known, read_experiment(known)) for known in experiment_names())
            ],
        )
        return
    request = replace(options.request(), data=None)
    done: list[ExperimentResult] = []
    for one in experiment_names() if name == ALL else [name]:
        with Bars() as bars:
            result = run_experiment(one, request, quick=quick, force=force, results=results, progress=bars.update)
        done.append(result)
        if not options.as_json and options.style == TABLE:
            print_experiment(result)
        elif not options.as_json:
            print(format_experiment(result, options.style))
    if options.as_json:
        print_json([result.to_json() for result in done])
    if any(result.crashed or not any(table.stored for table in result.tables) for result in done):
        raise typer.Exit(1)
