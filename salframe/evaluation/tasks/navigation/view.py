"""Data for the HTML page of a report on a run of the task `navigation`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from salframe.evaluation.report.view import RunView
from salframe.evaluation.tasks.navigation.rows import EpisodeRow
from salframe.evaluation.tasks.navigation.survey import NavigationSurvey
from salframe.evaluation.tasks.navigation.table import NavigationRow
from salframe.topology.topological_map import TopologicalMap


@dataclass(frozen=True, eq=False)
class NavigationView(RunView[EpisodeRow, NavigationRow]):
    """Data of a navigation run for an HTML page, with the topological map of each world (building) by id."""

    survey: NavigationSurvey
    maps: Mapping[str, TopologicalMap]
