"""The episodes of a data set, and their worlds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from salframe.evaluation.runs.records import Survey
from salframe.navigation.episodes import Episode, Site


@dataclass(frozen=True, eq=False, kw_only=True)
class NavigationSurvey(Survey[Episode]):
    """Episodes of a data set. `sites` maps the id of each world (building) to the world and its route planner."""

    sites: Mapping[str, Site]
