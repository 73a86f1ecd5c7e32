"""Options of a navigation study: its agents and episodes."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from salframe.evaluation.runs.task import TaskOptions
from salframe.navigation.episodes import NumEpisodes

WITHOUT = " without positioning"
"""Suffix of the label of a method whose poses the agent ignores."""
TRUE_PLACE = "true place"
"""Label of the control agent, which knows its true place and uses no localization method."""


class Positioning(StrEnum):
    """Agents to run for each method: with the estimated poses (ON), with place and odometry only (OFF), or both (BOTH).

    ALL adds an agent that knows its true place and uses it with odometry.
    """

    ON = "on"
    OFF = "off"
    BOTH = "both"
    ALL = "all"


ARMS = {
    Positioning.ON: ("",),
    Positioning.OFF: (WITHOUT,),
    Positioning.BOTH: ("", WITHOUT),
    Positioning.ALL: ("", WITHOUT),
}
"""Suffixes of the labels of the agents that run for each method."""


class NavigationOptions(TaskOptions):
    """Options of a navigation study."""

    episodes: NumEpisodes | str = Field(
        100,
        description="number of random episodes in each dataset, or BENCHMARK:SPLIT, such as reverie:val_seen, to "
        "run the episodes of a benchmark",
    )
    positioning: Positioning = Field(
        Positioning.ON,
        description="agents that run for each method. on: an agent that uses the estimated pose; off: an agent that "
        "uses the estimated place and odometry only; both: one agent of each kind; all: both, and an agent that knows "
        "its true place",
    )

    @property
    def in_data_folder(self) -> bool:
        return isinstance(self.episodes, str)
