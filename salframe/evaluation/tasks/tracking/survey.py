"""The walks through the buildings of a data set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from salframe.evaluation.runs.records import Survey
from salframe.evaluation.tasks.tracking.walks import Walk
from salframe.navigation.world import World
from salframe.panoramas.dataset import Dataset


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackingSurvey(Survey[Walk]):
    """A set of walks through the buildings of a data set, to measure trackers.

    Attributes:
        worlds: The buildings, by id.
        other: A data set of another building, whose map does not contain the places of the walks; None if there is no
            such data set.
    """

    worlds: Mapping[str, World]
    other: Dataset | None
