"""Out-of-map queries: the queries of a dataset, localized in a map without their place."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from salframe.framework.component import match_only
from salframe.panoramas.floors import FloorMasks, find_floor
from salframe.panoramas.frames import Fold, FrameKind, QueryFrame, ReferenceFrame, Truth

DOORWAY_M = 0.75
"""Maximum distance between a doorway's panorama and the floor of a place that the doorway leads to."""


def hide_query_place_setting() -> Any:
    """Return the pydantic field of the setting `hide_query_place`: whether each query is also localized in a map
    without its place. A dataset with this setting applies `add_hidden_places` to its folds."""
    help = (
        "true: each query is localized twice, first in the whole map, then in a map without the place of "
        "the query. The correct answer in the second map is out-of-map; false: each query is localized once, in the "
        "whole map"
    )
    return match_only(False, description=help)


def add_hidden_places(
    folds: Sequence[Fold], truth: Callable[[str], Truth], floors: Sequence[FloorMasks] = ()
) -> list[Fold]:
    """Return the folds (maps with their queries), each followed by its out-of-map folds.

    A fold has one out-of-map fold for each place of its queries: the queries of the place, and the reference frames
    without the frames of the place. Transition frames at doorways to the place are removed too, if the floor masks show
    the place. An out-of-map fold without reference frames is left out.

    Args:
        folds: The folds.
        truth: Returns the truth of a query by its id.
        floors: Floor masks of the dataset.
    """
    extended: list[Fold] = []
    for fold in folds:
        extended.append(fold)
        queries: dict[str, list[QueryFrame]] = {}
        for query in fold.queries:
            queries.setdefault(truth(query.id).place, []).append(query)
        for place, queries_there in queries.items():
            references = hide_places(fold.references, [place], floors)
            if references:
                extended.append(Fold(f"{fold.id} without {place}", references, tuple(queries_there)))
    return extended


def hide_places(
    references: Sequence[ReferenceFrame], places: Collection[str], floors: Sequence[FloorMasks]
) -> tuple[ReferenceFrame, ...]:
    """Return the reference frames without the frames of some places and of the doorways to these places.

    Doorways are found only if the floor masks show the places.
    """
    floors = sorted(floors, key=lambda floor: floor.z_m)
    floor_m = [_floor_of(places, floor) for floor in floors]
    remaining = []
    for frame in references:
        position_m, leads_there = frame.T_world_pano[:3, 3], False
        number = find_floor(floors, position_m)
        if frame.kind is FrameKind.TRANSITION and number is not None:
            leads_there = np.hypot(*(floor_m[number] - position_m[:2]).T).min(initial=np.inf) <= DOORWAY_M
        if frame.place not in places and not leads_there:
            remaining.append(frame)
    return tuple(remaining)


def _floor_of(places: Collection[str], floor: FloorMasks) -> np.ndarray:
    """Return the centres of the pixels of places, (N, 2) in the world, in metres."""
    labels = [label for label, name in floor.regions.items() if name in places]
    row, column = np.nonzero(np.isin(floor.region, labels))
    x_m = floor.origin_m[0] + (column + 0.5) * floor.resolution_m
    y_m = floor.origin_m[1] - (row + 0.5) * floor.resolution_m
    return np.stack([x_m, y_m], 1)
