"""The command `navigate`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from salframe.cli.options import DATA, METHODS, CommonOptions, Methods, parse_seed, with_common_options
from salframe.cli.output import show

Worlds = Annotated[str, typer.Option(help="Dataset that supports navigation, such as house-12")]
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
            metavar="N|FILE|BENCHMARK:SPLIT",
            help="Number of random episodes, a JSON file, or a benchmark: reverie:val_seen",
        ),
    ] = "100",
    positioning: Annotated[
        Literal["on", "off", "both", "all"],
        typer.Option(help="Whether the agent uses the poses of the method (both, all: see above)"),
    ] = "on",
    *,
    options: CommonOptions,
) -> None:
    """Measure how well an agent navigates with each method.

    The agent walks from room to room and localizes with the method. With --positioning off, the agent uses only the
    places of the answers, not the poses. "both" runs each method once with and once without its poses. "all" also
    runs an agent that knows its true place. Run the same command again to resume an interrupted run.
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
