"""navigate: methods in closed loop, in a building."""

from __future__ import annotations

from pathlib import Path
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
    Methods,
    Name,
    Runs,
    split_names,
)
from salframe.cli.output import show


def navigate(
    methods: Methods = METHODS,
    data: Annotated[str, typer.Option(help="A dataset that can render, or matterport-annotations.")] = DATA,
    episodes: Annotated[
        str, typer.Option(metavar="N|FILE", help="How many episodes to draw, or a JSON file of them.")
    ] = "100",
    positioning: Annotated[
        Literal["on", "off", "both"],
        typer.Option(
            help="off: place alone, heading by odometry; both: each method once with and once without its poses."
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
    seed: Annotated[int, typer.Option(help="Seed of episodes, noise and confidence intervals.")] = 0,
    as_json: Json = False,
) -> None:
    """Send an agent from room to room with each method as its localizer. Run it again to resume."""
    from salframe.cli.tables import print_navigation
    from salframe.evaluation.navigation import Positioning
    from salframe.evaluation.navigation import navigate as run
    from salframe.evaluation.request import Request

    asked = int(episodes) if episodes.lstrip("-").isdigit() else Path(episodes)
    request = Request(split_names(methods), data, data_dir, tuple(overrides or ()), name, seed, engine, runs)
    show(
        lambda progress: run(request, episodes=asked, positioning=Positioning(positioning), progress=progress),
        print_navigation,
        as_json,
    )
