"""The worker of the task `navigation`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from salframe.evaluation.runs.rows import Row
from salframe.evaluation.runs.task import Worker
from salframe.navigation.agent_localizer import AgentLocalizer, localize_nearest
from salframe.navigation.episodes import Episode, Site
from salframe.navigation.walk import NavigationConfig, walk


class Walking(Worker[Episode]):
    """Runs an agent that uses a localizer. If `localizer` is None, the agent knows its true place instead."""

    def __init__(
        self, localizer: AgentLocalizer | None, sites: Mapping[str, Site], config: NavigationConfig, seed: int
    ) -> None:
        self._localizer, self._sites, self._config, self._seed = localizer, sites, config, seed

    def work(self, piece: Episode) -> Row:
        site = self._sites[piece.world]
        localize = localize_nearest if self._localizer is None else self._localizer.localize
        return walk(site, partial(localize, site.world), piece, self._config, self._seed)

    @property
    def warning(self) -> str | None:
        return None if self._localizer is None else self._localizer.warning
