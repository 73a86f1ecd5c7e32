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
    StudySeed,
    Style,
    split_names,
    timeout_option,
    with_common_options,
)
from salframe.cli.output import show


@with_common_options()
def compare(
    methods: Methods = METHODS,
    reported: Annotated[
        bool, typer.Option("--reported", help="Also print results published in papers, which used other data")
    ] = False,
    *,
    options: CommonOptions,
) -> None:
    """Compare localization methods on the same queries.

    A query is a panorama, photograph or sequence of views to localize. Prints the accuracy, the times and the map size
    of each method. Run the same command again to resume an interrupted run.
    """
    from salframe.evaluation.tasks.localization.task import LocalizationTask
    from salframe.evaluation.tasks.localization.task import compare as run

    request = options.request(methods)
    show(lambda progress: run(request, reported=reported, progress=progress), options.printing, LocalizationTask)


@with_common_options(
    data=(
        Annotated[str | None, typer.Option(metavar="DATASET", help="Dataset to use instead of the key `data` of FILE")],
        None,
    ),
    seed=(StudySeed, 0),
    timeout=(timeout_option("query or navigation episode"), None),
)
def ablate(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="YAML file with the keys `method` and `vary`, or the name of an ablation of salframe"
        ),
    ],
    *,
    options: CommonOptions,
) -> None:
    """Measure how the settings of a method change its results.

    FILE states the method (key `method`), and a list of values for each setting (key `vary`). Runs the method with each
    combination of the values. Prints a table with a row for each combination.

    FILE can also be the name of an included ablation. For example, `salframe ablate departures` measures the effect of
    the four largest differences between the method `saliency-graph` and the paper that introduced the saliency graph.
    `salframe docs ablate` lists the included ablations.
    """
    from salframe.evaluation.studies.study import ablate as run
    from salframe.evaluation.studies.study import read_study

    request = options.request()
    show(lambda progress: run(file, request, progress=progress), options.printing, read_study(file).kind)


def evaluate(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", help="Run folder that a command wrote, such as runs/house-12-1a2b3c4d")
    ],
    style: Style = "table",
    columns: Columns = None,
    as_json: Json = False,
) -> None:
    """Recompute the metrics of a run from its stored answers.

    The methods do not run again.
    """
    from salframe.evaluation.finished_runs import evaluate as measure
    from salframe.evaluation.tasks.all import open_run

    _, task = open_run(run)
    show(lambda progress: measure(run), Printing(as_json, style, split_names(columns or "")), type(task))
