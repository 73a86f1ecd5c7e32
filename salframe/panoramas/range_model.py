"""The role `range-model`: how far everything in a panorama is, from its colour."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import wraps
from typing import Any, ClassVar

import numpy as np

from salframe.framework.component import Role
from salframe.framework.components.identity import identity
from salframe.framework.errors import InputMissing, InvalidAnswer
from salframe.framework.files.cache import Cache
from salframe.panoramas.geometry import peak_column
from salframe.panoramas.panorama import Panorama


class RangeModel(Role):
    """Estimates the range of a panorama from its colour."""

    role = "range-model"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    gives: ClassVar[frozenset[str]] = frozenset({"range"})
    """What panoramas get, for `auto` in a slot declared after the range model's."""
    turn_tolerance: ClassVar[float] = 1e-3
    """Turning the panorama by columns turns the range image: 95 % of its ranges change by no more than this share of
    themselves. `from_bright_side` sees to it."""

    @abstractmethod
    def estimate(self, panorama: Panorama) -> np.ndarray:
        """(H, 2H) float32 range along the ray in metres, over 0, NaN where unknown.

        Must not change its input; the same input gives the same output. A panorama in which nothing can be told has no
        known range, and raises nothing.
        """


def estimate_range(
    model: RangeModel, panorama: Panorama, cache: Cache | None = None, cache_key: Mapping[str, str] | None = None
) -> tuple[Panorama, float]:
    """The panorama with the range that a model estimates, unknown where nothing was seen, and `range_by` the model's
    name; the seconds that it took when it was estimated.

    With a cache, `cache_key` (the content_key of its dataset and the id of its frame) stands for the colour, and methods
    that share a model share its estimates. Raises InputMissing where the panorama lacks what the model needs,
    InvalidAnswer on an answer that is no range image.
    """
    key = {**(cache_key or {}), "range": identity(model.config)}
    known = None if cache is None else cache.get(key)
    if known is None:
        absent = sorted(model.needs - panorama.provides)
        if absent:
            raise InputMissing(
                f"the range model {model.name!r} needs {' and '.join(absent)}, which {panorama.id} does not have"
            )
        start = time.perf_counter()
        range_m = model.estimate(panorama)
        seconds = time.perf_counter() - start
        _check_range(model, panorama, range_m)
        if cache is not None:
            cache.put(key, {"range_m": range_m}, seconds)
    else:
        range_m, seconds = known[0]["range_m"], known[1]
    if panorama.valid is not None:
        range_m = np.where(panorama.valid, range_m, np.float32(np.nan))
    return replace(panorama, range_m=range_m, range_by=model.name), seconds


def _check_range(model: RangeModel, panorama: Panorama, range_m: Any) -> None:
    shape = None if panorama.rgb is None else panorama.rgb.shape[:2]
    if not (isinstance(range_m, np.ndarray) and range_m.dtype == np.float32 and shape in (None, range_m.shape)):
        received = f"{getattr(range_m, 'dtype', type(range_m).__name__)} {np.shape(range_m)}"
        raise InvalidAnswer(f"{model.name} gave {received}, expected float32 {shape}, metres along the ray")
    if (range_m <= 0).any() or np.isinf(range_m).any():
        raise InvalidAnswer(f"{model.name} gave a range of 0, less or infinity, expected NaN where it is not known")


def from_bright_side(estimate: Callable[[Any, Panorama], np.ndarray]) -> Callable[[Any, Panorama], np.ndarray]:
    """Make a model's `estimate` see each panorama with its bright side in the middle, and turn the range image back.

    For networks whose answer depends on where the panorama begins (strides, views at fixed azimuths): turning the
    panorama by any number of columns then turns the range and changes nothing else, as
    salframe.graphs.turning.from_near_side does for detectors.
    """

    @wraps(estimate)
    def steady(model: Any, panorama: Panorama) -> np.ndarray:
        if panorama.rgb is None:
            return estimate(model, panorama)
        columns = len(panorama.rgb) - peak_column(panorama.rgb.mean((0, 2)))
        images = {
            name: np.roll(image, columns, 1)
            for name in ("rgb", "valid")
            if (image := getattr(panorama, name)) is not None
        }
        seen = replace(panorama, range_m=None, range_by=None, annotations=None, **images)
        return np.roll(estimate(model, seen), -columns, 1)

    return steady
