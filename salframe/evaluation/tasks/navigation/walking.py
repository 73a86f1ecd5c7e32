"""The worker of the task `navigation`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from salframe.evaluation.runs.rows import Row
from salframe.evaluation.runs.task import Worker
from salframe.navigation.episodes import Episode, Site
from salframe.navigation.sight import Sight, see_place
from salframe.navigation.walk import NavigationConfig, walk


class Walking(Worker[Episode]):
    """Runs an agent that uses a localizer. If `sight` is None, the agent knows its true place instead."""

    def __init__(self, sight: Sight | None, sites: Mapping[str, Site], config: NavigationConfig, seed: int) -> None:
        self._sight, self._sites, self._config, self._seed = sight, sites, config, seed

    def work(self, piece: Episode) -> Row:
        site = self._sites[piece.world]
        look = see_place if self._sight is None else self._sight.look
        return walk(site, partial(look, site.world), piece, self._config, self._seed)

    @property
    def warning(self) -> str | None:
        return None if self._sight is None else self._sight.warning
