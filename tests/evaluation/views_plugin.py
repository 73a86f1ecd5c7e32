"""Queries of several views: each earlier view shows the next room, so that only the last one shows the right room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from fake_plugin import Reader, Rooms
from pydantic import Field

import salframe
from salframe.localization.localizer import Description
from salframe.panoramas.frames import Fold, QueryFrame


class Walks(Rooms):
    """Rooms with queries of several views."""

    name = "walks"

    class Config(Rooms.Config):
        views: int = Field(3, ge=1, description="views of a query")

    def folds(self) -> Sequence[Fold]:
        return [replace(fold, queries=tuple(map(self._walk, fold.queries))) for fold in super().folds()]

    def _walk(self, query: QueryFrame) -> QueryFrame:
        room, count = int(query.id.split("-")[1]), self.config.views - 1
        names = [f"{query.id}-before-{number}" for number in range(count)]
        earlier = tuple(QueryFrame(name, partial(self._load, name, room + 1, 0)) for name in names)
        return replace(query, earlier=earlier, T_last_view=np.stack([np.eye(4)] * (count + 1)) if count else None)


class Joiner(Reader):
    """Joins views to the last one."""

    name = "joiner"

    def join(self, descriptions, T_last_view, odometry) -> Description:
        return descriptions[-1]


@salframe.hookimpl
def salframe_provides():
    return [Walks, Joiner, Reader]
