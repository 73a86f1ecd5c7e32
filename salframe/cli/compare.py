"""compare, ablate, evaluate: methods side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import (
    DATA,
    ENGINE,
    METHODS,
    RUNS,
    Data,
    DataDir,
    EngineName,
    Json,
    Memory,
    Methods,
    Name,
    Runs,
    Seed,
    Set,
    Style,
    Timeout,
    Workers,
    make_request,
)
from salframe.cli.output import show


def compare(
    methods: Methods = METHODS,
    data: Data = DATA,
    data_dir: DataDir = None,
    overrides: Set = None,
    name: Name = None,
    runs: Runs = RUNS,
    engine: EngineName = ENGINE,
    workers: Workers = None,
    seed: Seed = 0,
    reported: Annotated[
        bool, typer.Option("--reported", help="Show what papers report, apart from what is measured.")
    ] = False,
    timeout: Timeout = None,
    memory: Memory = None,
    style: Style = "table",
    as_json: Json = False,
) -> None:
    """Run methods on the same queries and print what they reach and cost. Run it again to resume."""
    from salframe.evaluation.tasks.localization.task import compare as run

    request = make_request(
        methods,
        data=data,
        data_dir=data_dir,
        overrides=overrides,
        name=name,
        runs=runs,
        engine=engine,
        workers=workers,
        seed=seed,
        timeout_s=timeout,
        memory_mb=memory,
    )
    show(lambda progress: run(request, reported=reported, progress=progress), as_json, style)


def ablate(
    file: Annotated[
        Path, typer.Argument(help="A YAML file with `method:` and `vary:`, or the name of a shipped ablation.")
    ],
    data: Annotated[str | None, typer.Option(help="Another dataset than the file's.")] = None,
    data_dir: DataDir = None,
    overrides: Set = None,
    name: Name = None,
    runs: Runs = RUNS,
    engine: EngineName = ENGINE,
    workers: Workers = None,
    seed: Seed = 0,
    timeout: Timeout = None,
    memory: Memory = None,
    style: Style = "table",
    as_json: Json = False,
) -> None:
    """Run every combination of the values under `vary:` as a method of its own, in one table."""
    from salframe.evaluation.studies.study import ablate as run

    request = make_request(
        data=data,
        data_dir=data_dir,
        overrides=overrides,
        name=name,
        runs=runs,
        engine=engine,
        workers=workers,
        seed=seed,
        timeout_s=timeout,
        memory_mb=memory,
    )
    show(lambda progress: run(file, request, progress=progress), as_json, style)


def evaluate(
    run: Annotated[Path, typer.Argument(help="A run folder.")], style: Style = "table", as_json: Json = False
) -> None:
    """Measure a run again from its recorded answers; runs no method."""
    from salframe.evaluation.tasks.all import evaluate as measure

    show(lambda progress: measure(run), as_json, style)
