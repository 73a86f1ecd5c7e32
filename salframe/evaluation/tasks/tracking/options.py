"""Options of a tracking study: walks, views, odometry and the beliefs to compare."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from salframe.evaluation.runs.task import TaskOptions
from salframe.framework.components.slots import slot
from salframe.framework.validation import Settings
from salframe.localization.tracking import NUM_VIEWS
from salframe.panoramas.query_motion import OdometryErrors

MAX_WALKS = 10_000
"""Maximum number of walks of a run."""
MAX_VIEWS = 100
"""Maximum number of views that are localized together."""
NumWalks = Annotated[int, Field(ge=1, le=MAX_WALKS)]
NumViews = Annotated[int, Field(ge=1, le=MAX_VIEWS)]


class Observed(StrEnum):
    """Answers that a belief (estimated pose of the camera) is made from: all answers, the latest one alone, or only the
    first one with a pose."""

    ALL = "all"
    LATEST = "latest"
    FIRST = "first"


class Belief(Settings):
    """Settings of a way to estimate the pose of the camera from answers and odometry."""

    tracker: slot("tracker", description="tracker that estimates the pose of the camera")  # type: ignore[valid-type]
    answers: Observed = Field(
        Observed.ALL,
        description="answers that the pose is estimated from. all: the tracker receives every answer; latest: place "
        "and pose of the latest answer, without a tracker; first: the tracker receives only the first answer with a "
        "pose, and then follows odometry",
    )


class TrackingOptions(TaskOptions):
    """Options of a tracking study."""

    walks: NumWalks = Field(50, description="number of random walks of the camera in each dataset")
    views: tuple[NumViews, ...] = Field(
        (NUM_VIEWS,),
        min_length=1,
        description="list of numbers of views, such as [1, 5]. For each number, the latest views of this number are "
        "localized together; each number is a row of the table",
    )
    odometry: dict[str, OdometryErrors] = Field(
        {"2 % and 1 degree a step": OdometryErrors()},
        min_length=1,
        description="mapping from row names to simulated errors of the measured motion; each entry is a row of the "
        "table",
    )
    beliefs: dict[str, Belief] = Field(
        default_factory=lambda: {"tracker": Belief.model_validate({})},
        min_length=1,
        description="mapping from row names to ways to estimate the pose from the same answers; each entry is a row "
        "of the table",
    )
