"""sensor: how good is a detector, object by object?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import (
    DATA,
    ENGINE,
    RUNS,
    DataDir,
    EngineName,
    Json,
    Name,
    Runs,
    Workers,
    split_names,
    with_workers,
)
from salframe.cli.output import Bars, print_json, tell


def sensor(
    detector: Annotated[str, typer.Argument(help="A detector of `salframe plugins`.")],
    data: Annotated[
        str, typer.Option(help="Data sets with annotations and range, comma-separated; each as in `compare`.")
    ] = DATA,
    data_dir: DataDir = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY.PATH=VALUE", help="Change a setting: data.KEY, detector.KEY or engine.KEY."),
    ] = None,
    seeds: Annotated[
        str, typer.Option(help="Seeds of the data, comma-separated, all measured together; its own unless given.")
    ] = "",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Where the sensor model goes, as JSON.")
    ] = None,
    name: Name = None,
    runs: Runs = RUNS,
    engine: EngineName = ENGINE,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Measure a detector by the annotations of all panoramas: what it finds, what it calls it, what it makes up, how
    far off it is. The file is what `detector.noise` of the detector `annotations` takes. Run it again to resume."""
    from salframe.cli.tables import print_sensor
    from salframe.evaluation.tasks.sensor.task import measure_sensor
    from salframe.framework.errors import ConfigError

    numbers = split_names(seeds)
    if wrong := [number for number in numbers if not number.isdecimal()]:
        raise ConfigError(f"received the seed {wrong[0]!r}, expected whole numbers that are not negative")
    with Bars() as bars:
        measured = measure_sensor(
            detector,
            split_names(data),
            data_dir,
            with_workers(overrides, workers),
            tuple(map(int, numbers)),
            name=name,
            engine=engine,
            runs=runs,
            progress=bars.update,
        )
    if output is not None:
        measured.write(output)
    if as_json:
        print_json(measured.to_json())
    else:
        print_sensor(measured)
    for note in measured.notes:
        tell(note)
    if output is not None:
        tell(f"sensor model: {output}")
    if measured.crashed:
        raise typer.Exit(1)
