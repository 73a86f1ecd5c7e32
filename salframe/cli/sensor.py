"""The command `sensor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import DATA, MAX_SEED, CommonOptions, number_parser, split_names, with_common_options
from salframe.cli.output import Bars, print_json, tell

SensorData = Annotated[
    str, typer.Option(metavar="DATASETS", help="Datasets with annotations and range images, comma-separated")
]
SensorSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a setting of the detector (detector.KEY), the dataset (data.KEY) or the workers "
        "(engine.KEY), such as detector.min_score=0.5",
    ),
]


@with_common_options(
    without=["seed", "timeout", "memory", "style", "columns"], data=(SensorData, DATA), overrides=(SensorSettings, None)
)
def sensor(
    detector: Annotated[
        str, typer.Argument(metavar="DETECTOR", help="Detector to measure; see `salframe show detector`")
    ],
    seeds: Annotated[
        str,
        typer.Option(
            metavar="N,N",
            help="Random seeds of a generated dataset, such as 100,101; each seed gives another building (default: "
            "data.seed)",
        ),
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="JSON file to write the measured errors (sensor model) to"),
    ] = None,
    *,
    options: CommonOptions,
) -> None:
    """Measure the errors of a detector (its sensor model).

    Compares the detections with annotations: missed objects, wrong labels, false positives and position errors. To
    simulate these errors, set `detector.noise` of the detector `annotations` to the output file. Run the same command
    again to resume an interrupted run.
    """
    from salframe.cli.tables import print_sensor
    from salframe.evaluation.tasks.sensor.measurement import measure_sensor

    parse = number_parser("--seeds", int, 0, MAX_SEED)
    with Bars() as bars:
        measurement = measure_sensor(
            detector,
            split_names(options.data),
            options.data_dir,
            options.settings,
            tuple(map(parse, split_names(seeds))),
            name=options.name,
            engine=options.engine,
            runs=options.runs,
            progress=bars.update,
        )
    if output is not None:
        measurement.write(output)
    if options.as_json:
        print_json(measurement.to_json())
    else:
        print_sensor(measurement)
    for note in measurement.notes:
        tell(note)
    if output is not None:
        tell(f"sensor model: {output}")
    if measurement.crashed:
        raise typer.Exit(1)
