"""The command `navigate`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from salframe.cli.options import DATA, METHODS, CommonOptions, Methods, parse_seed, with_common_options
from salframe.cli.output import show

Worlds = Annotated[str, typer.Option(help="Dataset that can render, or that defines where an agent can walk")]
NavigationSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE",
        help="Change a setting: KEY, METHOD.KEY, navigation.KEY, data.KEY or engine.KEY",
    ),
]
NavigationSeed = Annotated[
    int, typer.Option(parser=parse_seed, metavar="N", help="Seed of episodes, noise and confidence intervals")
]


@with_common_options(data=(Worlds, DATA), overrides=(NavigationSettings, None), seed=(NavigationSeed, 0))
def navigate(
    methods: Methods = METHODS,
    episodes: Annotated[
        str,
        typer.Option(
            metavar="N|FILE|TASK:SPLIT",
            help="Episodes: number of random ones, a JSON file, or TASK:SPLIT of a published task",
        ),
    ] = "100",
    positioning: Annotated[
        Literal["on", "off", "both", "all"],
        typer.Option(help="Agents to run: pose on, off, both, or all (both, and one that knows its place)"),
    ] = "on",
    *,
    options: CommonOptions,
) -> None:
    """Send an agent from room to room with each method.

    With --positioning off, the agent uses the place only and takes its heading from odometry. "both" runs each method
    once with and once without its poses. "all" also runs an agent that knows its true place. In the episodes of a
    published task, the goals are known. In --set, METHOD.KEY changes one method, and KEY changes every method that has
    this setting. Run the same command again to resume an interrupted run.
    """
    from salframe.evaluation.tasks.navigation.options import Positioning
    from salframe.evaluation.tasks.navigation.task import NavigationTask
    from salframe.evaluation.tasks.navigation.task import navigate as run

    source = int(episodes) if episodes.removeprefix("-").isdecimal() and len(episodes) < 40 else episodes
    request = options.request(methods)
    show(
        lambda progress: run(request, episodes=source, positioning=Positioning(positioning), progress=progress),
        options.printing,
        NavigationTask,
    )
