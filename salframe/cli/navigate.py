"""navigate: methods in closed loop, in a building."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from salframe.cli.options import DATA, METHODS, CommonOptions, Methods, with_common_options
from salframe.cli.output import show

Worlds = Annotated[str, typer.Option(help="A dataset that can render, or says itself where to walk.")]
NavigationSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE",
        help="Change a setting: navigation.KEY, data.KEY, engine.KEY, METHOD.KEY of one method, or KEY of every "
        "method that has it.",
    ),
]
NavigationSeed = Annotated[int, typer.Option(help="Seed of episodes, noise and confidence intervals.")]


@with_common_options(data=(Worlds, DATA), overrides=(NavigationSettings, None), seed=(NavigationSeed, 0))
def navigate(
    methods: Methods = METHODS,
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
    *,
    options: CommonOptions,
) -> None:
    """Send an agent from room to room with each method as its localizer. Run it again to resume."""
    from salframe.evaluation.tasks.navigation.options import Positioning
    from salframe.evaluation.tasks.navigation.task import navigate as run

    source: int | str
    try:
        source = int(episodes)
    except ValueError:
        source = episodes
    request = options.request(methods)
    show(
        lambda progress: run(request, episodes=source, positioning=Positioning(positioning), progress=progress),
        options.as_json,
        options.style,
    )
