"""detection: what do detectors find of what is there?"""

from __future__ import annotations

from typing import Annotated

import typer

from salframe.cli.options import (
    DATA,
    DETECTORS,
    ENGINE,
    RUNS,
    Data,
    DataDir,
    EngineName,
    Json,
    Memory,
    Name,
    Runs,
    Set,
    Style,
    Timeout,
    Workers,
    make_request,
)
from salframe.cli.output import show


def detection(
    detectors: Annotated[str, typer.Option(help="Detectors, comma-separated.")] = DETECTORS,
    data: Data = DATA,
    data_dir: DataDir = None,
    overrides: Set = None,
    name: Name = None,
    runs: Runs = RUNS,
    engine: EngineName = ENGINE,
    workers: Workers = None,
    classes: Annotated[bool, typer.Option("--classes", help="Print a table of the classes too.")] = False,
    timeout: Timeout = None,
    memory: Memory = None,
    style: Style = "table",
    as_json: Json = False,
) -> None:
    """Detect objects in the query panoramas, and print precision and recall against their annotations. Run it again to
    resume.
    """
    from salframe.evaluation.tasks.detection.task import measure_detection

    request = make_request(
        detectors,
        data=data,
        data_dir=data_dir,
        overrides=overrides,
        name=name,
        runs=runs,
        engine=engine,
        workers=workers,
        timeout_s=timeout,
        memory_mb=memory,
    )
    show(lambda progress: measure_detection(request, progress=progress), as_json, style, classes=classes)
