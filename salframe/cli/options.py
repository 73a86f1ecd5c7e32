"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from salframe.framework.defaults import default_of

if TYPE_CHECKING:
    from salframe.evaluation.runs.request import Request

METHODS, MATCHING_METHODS, DETECTORS = (
    ",".join(default_of(key)) for key in ("methods", "matching_methods", "detectors")
)
DATA, ENGINE, PLANNER, MAP_METHOD = (default_of(key) for key in ("data", "engine", "planner", "map_method"))
RUNS = Path("runs")

Methods = Annotated[str, typer.Option(help="Methods, comma-separated, of `salframe methods`, or YAML files.")]
Data = Annotated[str, typer.Option(help="A dataset preset, a dataset, a YAML file, or a folder with a manifest.json.")]
DataArgument = Annotated[
    str, typer.Argument(help="A dataset preset, a dataset, a YAML file, or a folder with a manifest.json.")
]
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
EngineName = Annotated[str, typer.Option("--engine", help="How the work is run: see `salframe plugins`.")]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        metavar="N",
        help="How many work at a time, a thread each; unless given one a processor, and where times are measured one "
        "alone with all processors to itself.",
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the confidence intervals.")]
Style = Annotated[
    Literal["table", "md", "latex", "csv"],
    typer.Option("--format", help="How tables are printed; csv has every number in full."),
]
Timeout = Annotated[
    float | None,
    typer.Option("--timeout", metavar="SECONDS", help="End the work on a query, pair or episode that takes longer."),
]
Memory = Annotated[
    float | None, typer.Option("--memory", metavar="MB", help="End the work of a method that holds more memory.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def split_names(names: str) -> tuple[str, ...]:
    """Names that stand between commas."""
    return tuple(name.strip() for name in names.split(",") if name.strip())


def with_workers(overrides: list[str] | None, workers: int | None) -> tuple[str, ...]:
    """Settings of `--set`, and that of `--workers`."""
    return (*(overrides or ()), *(() if workers is None else (f"engine.workers={workers}",)))


def make_request(
    methods: str = "",
    *,
    data: str | None,
    data_dir: Path | None,
    overrides: list[str] | None,
    name: str | None,
    runs: Path,
    engine: str,
    workers: int | None,
    seed: int = 0,
    timeout_s: float | None = None,
    memory_mb: float | None = None,
) -> Request:
    """What the options that tasks share ask for; `methods` stand between commas."""
    from salframe.evaluation.runs.limits import Limits
    from salframe.evaluation.runs.request import Request

    return Request(
        methods=split_names(methods),
        data=data,
        data_dir=data_dir,
        settings=with_workers(overrides, workers),
        name=name,
        seed=seed,
        engine=engine,
        runs=runs,
        limits=Limits(timeout_s, memory_mb),
    )
