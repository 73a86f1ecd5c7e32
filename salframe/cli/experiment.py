"""The command `experiment`: reproduce the reported tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.options import CommonOptions, StudySeed, with_common_options
from salframe.cli.output import LIST_COLUMNS, TABLE, Bars, logged, print_columns, print_json

if TYPE_CHECKING:
    from salframe.evaluation.studies.experiment import ExperimentResult

ALL = "all"


@with_common_options(without=["data", "overrides", "name", "timeout", "memory"], seed=(StudySeed, 0))
def experiment(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="Name or YAML file of the experiment, or `all` (default: list the names)"),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Measure faster: fewer seeds, queries and methods, and only some of the tables"),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Repeat measurements even if they are stored")] = False,
    results: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder to store the tables in, with one JSON file for each experiment")
    ] = Path("results"),
    *,
    options: CommonOptions,
) -> None:
    """Measure the tables of an experiment and store them.

    An experiment is a set of tables, such as those in `salframe docs results`. If a table is already stored, it is
    printed, and not measured again. It is measured again if it is incomplete, or if its settings or the versions of its
    task, data or methods have changed. Tables of real buildings need --data-dir. Run the same command again to resume
    an interrupted run.
    """
    from salframe.cli.tables import format_experiment, print_experiment, print_table
    from salframe.evaluation.runs.task import check_columns
    from salframe.evaluation.studies.experiment import experiment_names, read_experiment, run_experiment, tasks_of

    if name is None:
        print_table(
            ("name", "tables", "question"),
            [
                [entry, str(len(content.tables)), content.question]
                for entry, content in ((entry, read_experiment(entry)) for entry in experiment_names())
            ],
        )
        return
    selected_names = experiment_names() if name == ALL else [name]
    kinds = tasks_of(selected_names)
    columns = options.printing.columns
    if columns == LIST_COLUMNS:
        print_columns(kinds, options.as_json)
        return
    check_columns(columns, kinds)
    request = replace(options.request(), data=None)
    experiment_results: list[ExperimentResult] = []
    for selected in selected_names:
        with Bars() as bars:
            result = run_experiment(selected, request, quick=quick, force=force, results=results, progress=bars.update)
        experiment_results.append(result)
        if not options.as_json and options.style == TABLE:
            print_experiment(result, columns, logged)
        elif not options.as_json:
            print(format_experiment(result, options.style, columns))
    if options.as_json:
        print_json([result.to_json() for result in experiment_results])
    if any(result.crashed or not any(table.stored for table in result.tables) for result in experiment_results):
        raise typer.Exit(1)
