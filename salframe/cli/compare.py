"""compare, ablate, evaluate: methods side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import METHODS, CommonOptions, Json, Methods, Style, with_common_options
from salframe.cli.output import show


@with_common_options()
def compare(
    methods: Methods = METHODS,
    reported: Annotated[
        bool, typer.Option("--reported", help="Show what papers report, apart from what is measured.")
    ] = False,
    *,
    options: CommonOptions,
) -> None:
    """Run methods on the same queries and print what they reach and cost. Run it again to resume."""
    from salframe.evaluation.tasks.localization.task import compare as run

    request = options.request(methods)
    show(lambda progress: run(request, reported=reported, progress=progress), options.as_json, options.style)


@with_common_options(data=(Annotated[str | None, typer.Option(help="Another dataset than the file's.")], None))
def ablate(
    file: Annotated[
        Path, typer.Argument(help="A YAML file with `method:` and `vary:`, or the name of a shipped ablation.")
    ],
    *,
    options: CommonOptions,
) -> None:
    """Run every combination of the values under `vary:` as a method of its own, in one table."""
    from salframe.evaluation.studies.study import ablate as run

    request = options.request()
    show(lambda progress: run(file, request, progress=progress), options.as_json, options.style)


def evaluate(
    run: Annotated[Path, typer.Argument(help="A run folder.")], style: Style = "table", as_json: Json = False
) -> None:
    """Measure a run again from its recorded answers; runs no method."""
    from salframe.evaluation.finished_runs import evaluate as measure

    show(lambda progress: measure(run), as_json, style)
