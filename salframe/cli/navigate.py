"""navigate: methods in closed loop, in a building."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from salframe.cli.options import (
    DATA,
    ENGINE,
    METHODS,
    RUNS,
    DataDir,
    EngineName,
    Json,
    Memory,
    Methods,
    Name,
    Runs,
    Style,
    Timeout,
    Workers,
    make_request,
)
from salframe.cli.output import show


def navigate(
    methods: Methods = METHODS,
    data: Annotated[str, typer.Option(help="A dataset that can render, or says itself where to walk.")] = DATA,
    episodes: Annotated[
        str,
        typer.Option(
            metavar="N|FILE|TASK:SPLIT",
            help="How many episodes to draw, a JSON file of them, or those of a published task, with the goals known.",
        ),
    ] = "100",
    positioning: Annotated[
        Literal["on", "off", "both", "all"],
        typer.Option(
            help="off: place alone, heading by odometry; both: each method once with and once without its poses; "
            "all: and an agent that is told its true place."
        ),
    ] = "on",
    data_dir: DataDir = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY.PATH=VALUE",
            help="Change a setting: navigation.KEY, data.KEY, engine.KEY, METHOD.KEY of one method, or KEY of every "
            "method that has it.",
        ),
    ] = None,
    name: Name = None,
    runs: Runs = RUNS,
    engine: EngineName = ENGINE,
    workers: Workers = None,
    seed: Annotated[int, typer.Option(help="Seed of episodes, noise and confidence intervals.")] = 0,
    timeout: Timeout = None,
    memory: Memory = None,
    style: Style = "table",
    as_json: Json = False,
) -> None:
    """Send an agent from room to room with each method as its localizer. Run it again to resume."""
    from salframe.evaluation.tasks.navigation.task import Positioning
    from salframe.evaluation.tasks.navigation.task import navigate as run

    source: int | str
    try:
        source = int(episodes)
    except ValueError:
        source = episodes
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
    show(
        lambda progress: run(request, episodes=source, positioning=Positioning(positioning), progress=progress),
        as_json,
        style,
    )
