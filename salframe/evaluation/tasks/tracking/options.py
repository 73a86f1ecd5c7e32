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
    """Answers that a belief is made from: all answers, the latest one alone, or only the first one with a pose."""

    ALL = "all"
    LATEST = "latest"
    FIRST = "first"


class Belief(Settings):
    """A belief: an estimate of the pose of the moving camera, made from the answers of a localizer."""

    tracker: slot("tracker", description="tracker that makes the belief")  # type: ignore[valid-type]
    answers: Observed = Field(
        Observed.ALL,
        description="answers that the belief is made from. all: the tracker observes every answer; latest: the place "
        "and pose of the latest answer, without a tracker; first: the tracker observes only the first answer with a "
        "pose, and then moves by odometry",
    )


class TrackingOptions(TaskOptions):
    """Options of a tracking study."""

    walks: NumWalks = Field(50, description="number of random walks in each dataset")
    views: tuple[NumViews, ...] = Field(
        (NUM_VIEWS,),
        min_length=1,
        description="list of the numbers of the latest views that are localized together; each is a row of the table",
    )
    odometry: dict[str, OdometryErrors] = Field(
        {"2 % and 1 degree a step": OdometryErrors()},
        min_length=1,
        description="mapping from names to errors of the measured motion; each is a row of the table",
    )
    beliefs: dict[str, Belief] = Field(
        default_factory=lambda: {"tracker": Belief.model_validate({})},
        min_length=1,
        description="mapping from names to beliefs that are made from the same answers; each is a row of the table",
    )
