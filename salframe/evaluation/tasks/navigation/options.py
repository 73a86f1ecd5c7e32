"""Which arms and episodes a study of navigation has."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from salframe.evaluation.runs.task import TaskOptions

WITHOUT = " without positioning"
"""What the label of a method ends with that is run without its poses."""
TRUE_PLACE = "true place"
"""The label of the arm that no method localizes."""


class Positioning(StrEnum):
    """Which arms to run: each method with its poses, by place and odometry alone, or both; ALL: and an agent that is
    told its true place, and goes by that and odometry."""

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
"""What the labels of methods end with."""


class NavigationOptions(TaskOptions):
    """What a study of navigation sets."""

    episodes: int | str = Field(100, description="how many are drawn in each data set, or TASK:SPLIT")
    positioning: Positioning = Field(Positioning.ON, description="with poses, without, or both and more")

    @property
    def in_data_folder(self) -> bool:
        return isinstance(self.episodes, str)
