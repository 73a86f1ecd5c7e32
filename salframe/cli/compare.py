"""The commands `compare`, `ablate` and `evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import (
    METHODS,
    Columns,
    CommonOptions,
    Json,
    Methods,
    Printing,
    Style,
    split_names,
    with_common_options,
)
from salframe.cli.output import show


@with_common_options()
def compare(
    methods: Methods = METHODS,
    reported: Annotated[
        bool, typer.Option("--reported", help="Also show results reported in papers, in separate tables")
    ] = False,
    *,
    options: CommonOptions,
) -> None:
    """Compare methods on the same queries.

    Prints the accuracy and the cost of each method. Run the same command again to resume an interrupted run.
    """
    from salframe.evaluation.tasks.localization.task import LocalizationTask
    from salframe.evaluation.tasks.localization.task import compare as run

    request = options.request(methods)
    show(lambda progress: run(request, reported=reported, progress=progress), options.printing, LocalizationTask)


@with_common_options(
    data=(
        Annotated[str | None, typer.Option(help="Dataset to use instead of the dataset that the ablation file names")],
        None,
    )
)
def ablate(
    file: Annotated[
        Path, typer.Argument(help="Ablation: YAML file with `method:` and `vary:`, or name of a shipped one")
    ],
    *,
    options: CommonOptions,
) -> None:
    """Compare all combinations of settings of a method.

    Prints one table with a row for each combination.
    """
    from salframe.evaluation.studies.study import ablate as run
    from salframe.evaluation.studies.study import read_study

    request = options.request()
    show(lambda progress: run(file, request, progress=progress), options.printing, read_study(file).kind)


def evaluate(
    run: Annotated[Path, typer.Argument(help="Run folder of an earlier `salframe` command")],
    style: Style = "table",
    columns: Columns = None,
    as_json: Json = False,
) -> None:
    """Compute the metrics of a run again from its recorded answers.

    Runs no method.
    """
    from salframe.evaluation.finished_runs import evaluate as measure

    show(lambda progress: measure(run), Printing(as_json, style, split_names(columns or "")))
