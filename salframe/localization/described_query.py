"""Describe the views of a query. `LocalizationMap.localize`, navigation and evaluation use the same functions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from salframe.framework.files.cache import Cache
from salframe.localization.describing import describe_frame
from salframe.localization.level_frames import UPSIDE_DOWN, unturn_description
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.camera_height import LevelSurfaces, find_level_surfaces
from salframe.panoramas.data_checks import upside_down_note
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.levelling import turn_panorama
from salframe.panoramas.panorama import Panorama

VERSION = "1"
"""Version of the measurement of floor and ceiling, as part of the cache keys of its results."""


@dataclass(frozen=True, eq=False)
class DescribedView:
    """A panorama of a query, with the description (features) that a localizer computed from it.

    Attributes:
        id: Id of the panorama.
        description: The description.
        surfaces: Distances of the camera from floor and ceiling in metres, measured in the panorama before it was
            levelled.
        seconds: Time of the computation, without the time to load the panorama.
        describe_turned: Function that rotates the panorama by UPSIDE_DOWN and describes it. It returns the description,
            in which R_LEVEL_PANO includes this rotation, and the time in seconds.
    """

    id: str
    description: Description
    surfaces: LevelSurfaces
    seconds: float
    describe_turned: Callable[[], tuple[Description, float]]


@dataclass(frozen=True, eq=False)
class DescribedQuery:
    """A query of V views (at least one), the input of `LocalizationMap.answer_query`.

    Attributes:
        descriptions: The descriptions of the views, in the order in which they were taken.
        T_last_view: (V, 4, 4) poses of the views in the frame of the last view; None: unknown.
        turned: The descriptions of the views after a rotation by UPSIDE_DOWN, if all views seem to be upside down;
            otherwise empty.
        seconds: Computing time of the descriptions.
    """

    descriptions: Sequence[Description]
    T_last_view: np.ndarray | None = None
    turned: Sequence[Description] = ()
    seconds: float = 0.0


def describe_view(
    localizer: Localizer,
    frame: QueryFrame,
    cache: Cache | None = None,
    dataset: str = "",
    described: tuple[Description, float] | None = None,
) -> DescribedView:
    """Compute the description (features) of a panorama of a query.

    Args:
        localizer: The localizer.
        frame: The panorama.
        cache: As in `describe_frame`.
        dataset: As in `describe_frame`.
        described: The result of `describe_frame` for this panorama; None: it is computed.

    Raises:
        InputMissing: The panorama lacks a part that the localizer requires.
        DataError: The panorama cannot be read.
    """
    description, seconds = described or describe_frame(localizer, frame, cache, dataset)
    surfaces, surfaces_s = _measure_surfaces(frame, cache, dataset)
    turned = partial(_describe_turned, localizer, frame, cache, dataset)
    return DescribedView(frame.id, description, surfaces, seconds + surfaces_s, turned)


def describe_query(
    localizer: Localizer,
    views: Sequence[DescribedView],
    T_last_view: np.ndarray | None,
    camera_z_m: np.ndarray,
    warn: Callable[[str], object],
) -> DescribedQuery:
    """Combine described views (panoramas with their features) to a query. If all views seem to be upside down, they are
    also described after a rotation by UPSIDE_DOWN.

    Args:
        localizer: The localizer. The views are rotated only if it uses range and its `level` is "auto".
        views: The V views in the order in which they were taken, at least one.
        T_last_view: (V, 4, 4) poses of the views in the frame of the last view; None: unknown.
        camera_z_m: (S,) heights (z in the world) of cameras of the map, in metres.
        warn: Called with a warning if the views seem to be upside down and are not rotated.

    Raises:
        DataError: A panorama cannot be read.
    """
    descriptions, seconds = [view.description for view in views], sum(view.seconds for view in views)
    notes = [upside_down_note(view.id, view.surfaces, camera_z_m) for view in views]
    if None in notes:
        return DescribedQuery(descriptions, T_last_view, seconds=seconds)
    if localizer.level == "off" or "range" not in localizer.needs | localizer.uses:
        warn(str(notes[0]))
        return DescribedQuery(descriptions, T_last_view, seconds=seconds)
    turned, turned_s = zip(*(view.describe_turned() for view in views), strict=True)
    return DescribedQuery(descriptions, T_last_view, turned, seconds + sum(turned_s))


def _measure_surfaces(frame: QueryFrame, cache: Cache | None, dataset: str) -> tuple[LevelSurfaces, float]:
    """Return the floor and the ceiling in a panorama, and the time of the computation in seconds."""
    key = {"dataset": frame.content or dataset, "frame": frame.id, "surfaces": VERSION}
    cached = None if cache is None else cache.get(key)
    if cached is not None:
        floor_m, ceiling_m = cached[0]["surfaces_m"].tolist()
        return LevelSurfaces(floor_m, ceiling_m), cached[1]
    panorama = frame.load()
    start = time.perf_counter()
    surfaces = find_level_surfaces(panorama)
    seconds = time.perf_counter() - start
    if cache is not None:
        cache.put(key, {"surfaces_m": np.array([surfaces.floor_m, surfaces.ceiling_m])}, seconds)
    return surfaces, seconds


def _describe_turned(
    localizer: Localizer, frame: QueryFrame, cache: Cache | None, dataset: str
) -> tuple[Description, float]:
    def load() -> Panorama:
        return turn_panorama(frame.load(), UPSIDE_DOWN)

    turned = QueryFrame(f"{frame.id}, turned upside down", load, frame.content)
    description, seconds = describe_frame(localizer, turned, cache, dataset)
    return unturn_description(description, UPSIDE_DOWN), seconds
