"""The command `navigate`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from salframe.cli.options import (
    DATA,
    METHODS,
    CommonOptions,
    Methods,
    parse_seed,
    set_option,
    timeout_option,
    with_common_options,
)
from salframe.cli.output import show

Worlds = Annotated[str, typer.Option(help="Dataset that supports navigation, such as house-12")]
NavigationSettings = Annotated[
    list[str] | None, set_option("Change KEY (all methods), METHOD.KEY, navigation.KEY, data.KEY or engine.KEY")
]
NavigationSeed = Annotated[
    int, typer.Option(parser=parse_seed, metavar="N", help="Seed of episodes, noise and confidence intervals")
]


@with_common_options(
    data=(Worlds, DATA),
    overrides=(NavigationSettings, None),
    seed=(NavigationSeed, 0),
    timeout=(timeout_option("episode"), None),
)
def navigate(
    methods: Methods = METHODS,
    episodes: Annotated[
        str,
        typer.Option(
            metavar="N|FILE|BENCHMARK:SPLIT",
            help="Number of random episodes, JSON file, or benchmark such as reverie:val_seen",
        ),
    ] = "100",
    positioning: Annotated[
        Literal["on", "off", "both", "all"],
        typer.Option(help="What the agent uses of an answer: its pose (on), or only its place (off)"),
    ] = "on",
    *,
    options: CommonOptions,
) -> None:
    """Measure how well an agent navigates with each method.

    In each episode, the agent walks from a start to a goal, and localizes itself with the method. With --positioning
    on, it uses the poses of the answers. With off, it uses only their places. With both, each method is measured in
    both ways. With all, an agent that knows its true place is measured too. Run the same command again to resume an
    interrupted run.
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
