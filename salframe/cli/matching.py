"""matching: are the points or objects that a method matches the same ones?"""

from __future__ import annotations

from salframe.cli.options import (
    DATA,
    ENGINE,
    MATCHING_METHODS,
    RUNS,
    Data,
    DataDir,
    EngineName,
    Json,
    Memory,
    Methods,
    Name,
    Runs,
    Set,
    Style,
    Timeout,
    Workers,
    make_request,
)
from salframe.cli.output import show


def matching(
    methods: Methods = MATCHING_METHODS,
    data: Data = DATA,
    data_dir: DataDir = None,
    overrides: Set = None,
    name: Name = None,
    runs: Runs = RUNS,
    engine: EngineName = ENGINE,
    workers: Workers = None,
    timeout: Timeout = None,
    memory: Memory = None,
    style: Style = "table",
    as_json: Json = False,
) -> None:
    """Match each query with the nearest map frame of its own place, and print how much of it is right. Run it again to
    resume.
    """
    from salframe.evaluation.tasks.matching.task import measure_matching

    request = make_request(
        methods,
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
    show(lambda progress: measure_matching(request, progress=progress), as_json, style)
