"""Queries that stand nowhere on their map: the same queries, asked of a map without their place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from salframe.framework.component import match_only
from salframe.panoramas.floors import FloorMasks, find_floor
from salframe.panoramas.frames import Fold, FrameKind, QueryFrame, ReferenceFrame, Truth

DOORWAY_M = 0.75
"""A doorway's panorama shows the places whose floor comes as near to it as this."""


def hide_query_place_setting() -> Any:
    """The default of a dataset's setting `hide_query_place`, whose folds then come from `add_hidden_places`."""
    help = "ask each query once more, of a map without its place and the doorways to it: the right answer is out-of-map"
    return match_only(False, description=help)


def add_hidden_places(
    folds: Sequence[Fold], truth: Callable[[str], Truth], floors: Sequence[FloorMasks] = ()
) -> list[Fold]:
    """The folds, each followed by one a place of its queries, whose map has no frame of that place. Doorways to it are
    taken out too where floor masks tell. A map of which nothing would be left is not asked."""
    extended: list[Fold] = []
    for fold in folds:
        extended.append(fold)
        queries: dict[str, list[QueryFrame]] = {}
        for query in fold.queries:
            queries.setdefault(truth(query.id).place, []).append(query)
        for place, asked in queries.items():
            references = _without(fold.references, place, floors)
            if references:
                extended.append(Fold(f"{fold.id} without {place}", references, tuple(asked)))
    return extended


def _without(
    references: Sequence[ReferenceFrame], place: str, floors: Sequence[FloorMasks]
) -> tuple[ReferenceFrame, ...]:
    """The reference frames that are neither of a place nor of a doorway to it."""
    floors = sorted(floors, key=lambda floor: floor.z_m)
    floor_m = [_floor_of(place, floor) for floor in floors]
    kept = []
    for frame in references:
        at_m, leads_there = frame.T_world_pano[:3, 3], False
        number = find_floor(floors, at_m)
        if frame.kind is FrameKind.TRANSITION and number is not None:
            leads_there = np.hypot(*(floor_m[number] - at_m[:2]).T).min(initial=np.inf) <= DOORWAY_M
        if frame.place != place and not leads_there:
            kept.append(frame)
    return tuple(kept)


def _floor_of(place: str, floor: FloorMasks) -> np.ndarray:
    """(N, 2) metres in the world: the middles of the cells of a place."""
    labels = [label for label, name in floor.regions.items() if name == place]
    row, column = np.nonzero(np.isin(floor.region, labels))
    x_m = floor.origin_m[0] + (column + 0.5) * floor.resolution_m
    y_m = floor.origin_m[1] - (row + 0.5) * floor.resolution_m
    return np.stack([x_m, y_m], 1)
