"""compare, ablate, evaluate: methods side by side."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

if TYPE_CHECKING:
    from salframe.evaluation.compare import Comparison, Progress
    from salframe.evaluation.matching import Matching

Measured = TypeVar("Measured", "Comparison", "Matching")

DataDir = Annotated[Path | None, typer.Option(help="Folder that holds the dataset's files (its `root`).")]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE",
        help="Change a setting: data.KEY, engine.KEY, METHOD.KEY of one method, or KEY of every method that has it.",
    ),
]
Name = Annotated[str | None, typer.Option(help="Name of the run folder; the dataset's name unless given.")]
Runs = Annotated[Path, typer.Option(help="Folder that holds the runs.")]
EngineName = Annotated[str, typer.Option("--engine", help="How the methods are run: see `salframe plugins`.")]
Seed = Annotated[int, typer.Option(help="Seed of the confidence intervals.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def compare(
    methods: Annotated[str, typer.Option(help="Methods, comma-separated: presets or localizers.")] = "proposed,objects",
    data: Annotated[
        str, typer.Option(help="A dataset preset, a dataset, or a folder with a manifest.json.")
    ] = "house-12",
    data_dir: DataDir = None,
    overrides: Set = None,
    name: Name = None,
    runs: Runs = Path("runs"),
    engine: EngineName = "processes",
    seed: Seed = 0,
    reported: Annotated[
        bool, typer.Option("--reported", help="Show what papers report, apart from what is measured.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run methods on the same queries and print what they reach and cost. Run it again to resume."""
    from salframe.cli.tables import print_comparison
    from salframe.evaluation.compare import compare as run

    show(
        lambda progress: run(
            split_names(methods),
            data,
            data_dir=data_dir,
            overrides=overrides or (),
            name=name,
            runs=runs,
            engine=engine,
            seed=seed,
            progress=progress,
            reported=reported,
        ),
        print_comparison,
        as_json,
    )


def ablate(
    file: Annotated[
        Path, typer.Argument(help="A YAML file with `method:` and `vary:`, or the name of a shipped ablation.")
    ],
    data: Annotated[str | None, typer.Option(help="Another dataset than the file's.")] = None,
    data_dir: DataDir = None,
    overrides: Set = None,
    name: Name = None,
    runs: Runs = Path("runs"),
    engine: EngineName = "processes",
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Run every combination of the values under `vary:` as a method of its own, in one table."""
    from salframe.cli.tables import print_comparison
    from salframe.evaluation.ablation import ablate as run

    show(
        lambda progress: run(
            file,
            data=data,
            data_dir=data_dir,
            overrides=overrides or (),
            name=name,
            runs=runs,
            engine=engine,
            seed=seed,
            progress=progress,
        ),
        print_comparison,
        as_json,
    )


def evaluate(run: Annotated[Path, typer.Argument(help="A run folder.")], as_json: Json = False) -> None:
    """Measure a run again from its recorded answers; runs no method."""
    from salframe.cli.tables import print_comparison
    from salframe.evaluation.compare import evaluate as measure

    show(lambda progress: measure(run), print_comparison, as_json)


def split_names(methods: str) -> list[str]:
    """Names that stand between commas."""
    return [method.strip() for method in methods.split(",") if method.strip()]


def show(run: Callable[[Progress], Measured], table: Callable[[Measured], None], as_json: bool) -> None:
    """Run with progress bars on stderr, print the table or JSON on stdout; exit 1 where nothing was measured or
    something crashed."""
    from salframe.cli.tables import Bars

    try:
        with Bars() as bars:
            result = run(bars.update)
    except KeyboardInterrupt:
        print("interrupted: run the same command again to resume", file=sys.stderr)
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(result.to_json(), indent=2))
    else:
        table(result)
    if result.crashed or not result.measured:
        raise typer.Exit(1)
