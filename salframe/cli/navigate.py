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

Worlds = Annotated[
    str,
    typer.Option(
        metavar="DATASET", help="Dataset that supports navigation, such as house-12 or matterport-annotations"
    ),
]
NavigationSettings = Annotated[
    list[str] | None,
    set_option(
        "Change a setting of all methods (KEY), one method (METHOD.KEY), the agent (navigation.KEY), the "
        "dataset (data.KEY) or the worker processes (engine.KEY), such as data.seed=1"
    ),
]
NavigationSeed = Annotated[
    int,
    typer.Option(
        parser=parse_seed,
        metavar="N",
        help="Random seed of the episodes, the simulated errors of motion and the confidence intervals",
    ),
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
            help="Number of random episodes, a JSON file of episodes, or a split of a benchmark, such as "
            "reverie:val_seen",
        ),
    ] = "100",
    positioning: Annotated[
        Literal["on", "off", "both", "all"],
        typer.Option(
            help="Agents to evaluate. on: an agent that uses the estimated pose; off: an agent that uses only the "
            "estimated place and odometry; both: these two agents; all: these two and an agent that knows its true "
            "place"
        ),
    ] = "on",
    *,
    options: CommonOptions,
) -> None:
    """Measure how well an agent navigates with each method.

    In each episode, an agent walks from a start to a goal, and localizes itself with the method. --positioning selects
    the agents: an agent can use the estimated poses, or only the estimated places and odometry. For comparison, an
    agent that knows its true place can be measured too. Run the same command again to resume an interrupted run.
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
