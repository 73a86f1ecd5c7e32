"""Options that several commands share."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeVar, cast, get_type_hints

import typer

from salframe.framework.components.defaults import default_of
from salframe.framework.errors import ConfigError, shorten

if TYPE_CHECKING:
    from salframe.evaluation.runs.request import Request

Command = TypeVar("Command", bound=Callable[..., None])
METHODS, MATCHING_METHODS, DETECTORS = (
    ",".join(default_of(key)) for key in ("methods", "matching_methods", "detectors")
)
DATA, ENGINE, PLANNER, MAP_METHOD = (default_of(key) for key in ("data", "engine", "planner", "map_method"))
RUNS = Path("runs")

MAX_SEED, MAX_WORKERS = 2**63 - 1, 1024
MIN_FOV_DEG, MAX_FOV_DEG = 5.0, 170.0
"""The same limits as in salframe.panoramas.camera. Importing that module would slow down `--help`."""
MAX_ANGLE_DEG, MAX_LIMIT = 3600.0, 1e9


def number_parser(option: str, kind: type[int] | type[float], low: float, high: float) -> Callable[[Any], Any]:
    """Return the parser of an option that takes a number from `low` to `high`. The parser raises ConfigError if the
    text is not a number in this range."""
    noun = "an integer" if kind is int else "a number"

    def parse(text: Any) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise ConfigError(f"received {option} {shorten(str(text), 40)!r}, expected {noun} from {low} to {high}")
        return value

    return parse


def limit_parser(option: str) -> Callable[[Any], float | None]:
    """Return the parser of an option that takes a limit: a positive number, or inf for no limit (None). The parser
    raises ConfigError for any other text."""

    def parse(text: Any) -> float | None:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not value > 0:
            raise ConfigError(
                f"received {option} {shorten(str(text), 40)!r}, expected a number above 0, or inf for no limit"
            )
        return value if value <= MAX_LIMIT else None

    return parse


Methods = Annotated[
    str,
    typer.Option(
        metavar="NAMES",
        help="Localization methods, comma-separated: names in `salframe methods`, or YAML files of settings",
    ),
]
Data = Annotated[
    str,
    typer.Option(
        metavar="DATASET",
        help="Dataset: a name in `salframe data list`, a YAML file of settings, or a folder with manifest.json",
    ),
]
DataArgument = Annotated[
    str,
    typer.Argument(
        metavar="DATA",
        help="Dataset: a name in `salframe data list`, a YAML file of settings, or a folder with manifest.json",
    ),
]
DataDir = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder with the downloaded files of the dataset; required for datasets such as matterport3d",
    ),
]


def set_option(help: str) -> Any:
    """Return the option --set.

    Args:
        help: The help text, which names the keys that the command accepts.
    """
    return typer.Option("--set", metavar="KEY=VALUE", help=help)


Set = Annotated[
    list[str] | None,
    set_option(
        "Change a setting of all methods (KEY), one method (METHOD.KEY), the dataset (data.KEY) or the "
        "workers (engine.KEY), such as data.seed=1"
    ),
]
SetForDetectors = Annotated[
    list[str] | None,
    set_option(
        "Change a setting of all detectors (KEY), one detector (DETECTOR.KEY), the dataset (data.KEY) or "
        "the workers (engine.KEY), such as data.seed=1"
    ),
]
SetForMethod = Annotated[
    list[str] | None,
    set_option(
        "Change a setting of the method (KEY), the dataset (data.KEY) or the worker processes (engine.KEY), such as "
        "data.seed=1"
    ),
]
SetForData = Annotated[
    list[str] | None,
    set_option("Change a setting of the dataset (data.KEY) or the worker processes (engine.KEY), such as data.seed=1"),
]
Name = Annotated[
    str | None, typer.Option(metavar="NAME", help="Prefix of the name of the run folder (default: name of the dataset)")
]
Runs = Annotated[
    Path, typer.Option(metavar="DIR", help="Parent folder of the run folders, which store the measurements")
]
EngineName = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="NAME",
        help="Where to compute: in worker processes on this machine (processes), on a Ray cluster (ray), or in the "
        "main process (inline, for debugging)",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        parser=number_parser("--workers", int, 1, MAX_WORKERS),
        metavar="N",
        help="Number of worker processes (default: one per core to render generated data, a single one for other work)",
    ),
]
parse_seed = number_parser("--seed", int, 0, MAX_SEED)
Seed = Annotated[
    int, typer.Option(parser=parse_seed, metavar="N", help="Random seed for the bootstrap of the confidence intervals")
]
StudySeed = Annotated[
    int,
    typer.Option(
        parser=parse_seed,
        metavar="N",
        help="Random seed of the confidence intervals, and of simulated navigation and tracking",
    ),
]
Style = Annotated[
    Literal["table", "md", "latex", "csv"],
    typer.Option(
        "--format",
        help="Format of the printed tables; latex has at most 6 columns unless --columns selects them; csv has all "
        "columns, and numbers with more digits",
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        "--columns",
        metavar="NAMES",
        help="Table columns to show, comma-separated; `--columns help` lists them (default: main columns)",
    ),
]
Timeout = Annotated[
    float | None,
    typer.Option(
        "--timeout",
        parser=limit_parser("--timeout"),
        metavar="SECONDS",
        help="Time limit for each query, in seconds (default: no limit)",
    ),
]
Memory = Annotated[
    float | None,
    typer.Option(
        "--memory",
        parser=limit_parser("--memory"),
        metavar="MB",
        help="Memory limit for each worker process, in megabytes (default: no limit)",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON")]
RangeUnit = Annotated[
    float | None,
    typer.Option(
        parser=number_parser("--range-unit", float, 1e-6, 1.0),
        metavar="METRES",
        help="Metres per unit of a range image (default: 0.001, pixel values in millimetres)",
    ),
]
RangeMissing = Annotated[
    list[int] | None,
    typer.Option(
        metavar="VALUE",
        min=0,
        max=65535,
        help="Pixel value for unknown range in range images, such as 65535; 0 always means unknown; repeatable",
    ),
]

Fov = Annotated[
    float | None,
    typer.Option(
        parser=number_parser("--fov", float, MIN_FOV_DEG, MAX_FOV_DEG),
        metavar="DEG",
        help="Read images as photographs with this horizontal field of view, in degrees",
    ),
]
CameraFile = Annotated[
    Path | None,
    typer.Option(
        "--camera",
        metavar="FILE",
        help="JSON file with the intrinsics and distortion of the camera; images are read as photographs",
    ),
]


def timeout_option(item: str) -> Any:
    """Return the type of the option `--timeout` of a command that limits the time of an `item`, such as "episode"."""
    return Annotated[
        float | None,
        typer.Option(
            "--timeout",
            parser=limit_parser("--timeout"),
            metavar="SECONDS",
            help=f"Time limit for each {item}, in seconds (default: no limit)",
        ),
    ]


def split_names(names: str) -> tuple[str, ...]:
    """Return the names in a comma-separated list."""
    return tuple(name.strip() for name in names.split(",") if name.strip())


def range_options(
    has_range: bool, unit_m: float | None, missing: Sequence[int] | None, kind: str | None
) -> dict[str, Any]:
    """Return the options for range images that the user set, as keyword arguments for functions that read range images.

    Raises:
        ConfigError: An option was set, but there is no range image.
    """
    values = {"range_unit_m": unit_m, "range_missing": tuple(missing) if missing else None, "range_kind": kind}
    chosen = {name: value for name, value in values.items() if value is not None}
    if chosen and not has_range:
        from salframe.framework.errors import ConfigError

        option = next(iter(chosen)).removesuffix("_m").replace("_", "-")
        raise ConfigError(f"received --{option} without --range: add --range FILE, the range image")
    return chosen


def with_workers(overrides: list[str] | None, workers: int | None) -> tuple[str, ...]:
    """Return the settings of `--set` and `--workers`, "key.path=value" each."""
    return (*(overrides or ()), *(() if workers is None else (f"engine.workers={workers}",)))


class Printing(NamedTuple):
    """Output format of a result.

    Attributes:
        as_json: Whether to print JSON in place of tables.
        style: Style of the tables, a value of `--format`.
        columns: Names of the columns of the tables; empty: the main columns.
    """

    as_json: bool = False
    style: str = "table"
    columns: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class CommonOptions:
    """Options of the commands that create runs."""

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
    columns: Columns = None
    as_json: Json = False

    @property
    def printing(self) -> Printing:
        """The output format of the result."""
        return Printing(self.as_json, self.style, split_names(self.columns or ""))

    @property
    def settings(self) -> tuple[str, ...]:
        """The settings of `--set` and `--workers`, "key.path=value" each."""
        return with_workers(self.overrides, self.workers)

    def request(self, methods: str = "") -> Request:
        """Return the request for a run with these options. `methods` are the comma-separated names of the methods."""
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


def with_common_options(without: Sequence[str] = (), **replacements: tuple[Any, Any]) -> Callable[[Command], Command]:
    """Return a decorator for commands with a parameter `options` of type CommonOptions.

    The command line gets an option for each field of CommonOptions.

    Args:
        without: Names of the fields for which the command has no option. They have their default values.
        replacements: For each field for which the command has a different option: the annotated type (with the help)
            and the default of this option.
    """
    types = get_type_hints(CommonOptions, include_extras=True)
    option_types = {
        field.name: replacements.get(field.name, (types[field.name], field.default)) for field in fields(CommonOptions)
    }
    option_types = {name: option for name, option in option_types.items() if name not in without}

    def decorate(command: Command) -> Command:
        @wraps(command)
        def run(**values: Any) -> Any:
            common = {name: values.pop(name) for name in option_types}
            return command(**values, options=CommonOptions(**common))

        signature = inspect.signature(command, eval_str=True)
        parameters: list[inspect.Parameter] = []
        for parameter in signature.parameters.values():
            if parameter.name == "options":
                parameters += [
                    inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
                    for name, (kind, default) in option_types.items()
                ]
            else:
                parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        del run.__wrapped__  # type: ignore[attr-defined]
        return cast(Command, run)

    return decorate
