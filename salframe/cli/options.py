"""Options that several commands share."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast, get_type_hints

import typer

from salframe.framework.components.defaults import default_of

if TYPE_CHECKING:
    from salframe.evaluation.runs.request import Request

Command = TypeVar("Command", bound=Callable[..., None])
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
Name = Annotated[str | None, typer.Option(help="Name of the run folder (default: the name of the dataset).")]
Runs = Annotated[Path, typer.Option(help="Folder that holds the runs.")]
EngineName = Annotated[str, typer.Option("--engine", help="How the work is run: see `salframe plugins`.")]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        metavar="N",
        help="Number of worker processes (default: one per core; one with all cores where times are measured).",
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


@dataclass(frozen=True, kw_only=True)
class CommonOptions:
    """Options of the commands that make runs."""

    data: Data = DATA
    data_dir: DataDir = None
    overrides: Set = None
    name: Name = None
    runs: Runs = RUNS
    engine: EngineName = ENGINE
    workers: Workers = None
    seed: Seed = 0
    timeout: Timeout = None
    memory: Memory = None
    style: Style = "table"
    as_json: Json = False

    @property
    def settings(self) -> tuple[str, ...]:
        """Settings of `--set`, and that of `--workers`."""
        return with_workers(self.overrides, self.workers)

    def request(self, methods: str = "") -> Request:
        """Return the request of these options; `methods` are separated by commas."""
        from salframe.evaluation.runs.limits import Limits
        from salframe.evaluation.runs.request import Request

        return Request(
            methods=split_names(methods),
            data=self.data,
            data_dir=self.data_dir,
            settings=self.settings,
            name=self.name,
            seed=self.seed,
            engine=self.engine,
            runs=self.runs,
            limits=Limits(self.timeout, self.memory),
        )


def with_common_options(without: Sequence[str] = (), **changed: tuple[Any, Any]) -> Callable[[Command], Command]:
    """Return a decorator of a command that receives CommonOptions as its parameter `options`: the command line then
    has an option for each of their fields.

    Args:
        without: Fields that the command has no option for; they keep their defaults.
        changed: The type, with its help, and the default of fields that the command has another option for.
    """
    types = get_type_hints(CommonOptions, include_extras=True)
    shown = {field.name: changed.get(field.name, (types[field.name], field.default)) for field in fields(CommonOptions)}
    shown = {name: option for name, option in shown.items() if name not in without}

    def decorate(command: Command) -> Command:
        @wraps(command)
        def run(**values: Any) -> Any:
            common = {name: values.pop(name) for name in shown}
            return command(**values, options=CommonOptions(**common))

        own = inspect.signature(command, eval_str=True).parameters.values()
        parameters: list[inspect.Parameter] = []
        for parameter in own:
            if parameter.name == "options":
                parameters += [
                    inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
                    for name, (kind, default) in shown.items()
                ]
            else:
                parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        del run.__wrapped__  # type: ignore[attr-defined]
        return cast(Command, run)

    return decorate
