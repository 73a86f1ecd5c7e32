"""The role `range-model`: estimate the range of a panorama from its colour."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import wraps
from typing import Any, ClassVar

import numpy as np

from salframe.framework.component import Role
from salframe.framework.components.auto import name_parts
from salframe.framework.components.identity import identity
from salframe.framework.errors import InputMissing, InvalidAnswer
from salframe.framework.files.cache import Cache
from salframe.panoramas.geometry import peak_column
from salframe.panoramas.panorama import Panorama


class RangeModel(Role):
    """Estimates the range of a panorama from its colour image."""

    role = "range-model"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    gives: ClassVar[frozenset[str]] = frozenset({"range"})
    """Parts that the model adds to panoramas. A slot is a setting that selects a component. If a slot after the slot of
    the model has the value `auto`, its component is chosen as if panoramas had these parts."""
    turn_tolerance: ClassVar[float] = 1e-3
    """Maximum relative change of 95 % of the ranges when the panorama is rotated by whole columns.

    A model with the decorator `from_bright_side` meets this limit."""

    @abstractmethod
    def estimate(self, panorama: Panorama) -> np.ndarray:
        """Return the range along the ray in metres, (H, 2H) float32, positive, NaN where unknown.

        Must not change its input. The same input must give the same output. If nothing can be estimated, the result is
        NaN everywhere, and no exception is raised.
        """


def estimate_range(
    model: RangeModel, panorama: Panorama, cache: Cache | None = None, cache_key: Mapping[str, str] | None = None
) -> tuple[Panorama, float]:
    """Return the panorama with the estimated range, and the time of the estimation in seconds.

    The range is unknown outside the visible part of the sphere, and `range_by` is the name of the model. Methods that
    share a model and a cache share its estimates.

    Args:
        model: The range model.
        panorama: The panorama.
        cache: Cache of estimates; None: no cache.
        cache_key: Identifies the colour in the cache: the content_key of the dataset and the id of the frame.

    Raises:
        InputMissing: The panorama lacks a part that the model needs.
        InvalidAnswer: The model did not return a range image.
    """
    key = {**(cache_key or {}), "range": identity(model.config)}
    cached = None if cache is None else cache.get(key)
    if cached is None:
        absent = sorted(model.needs - panorama.provides)
        if absent:
            raise InputMissing(
                f"the range model {model.name!r} needs {name_parts(absent)}, which {panorama.id} does not have: choose "
                "another range model (setting range.kind)"
            )
        start = time.perf_counter()
        range_m = model.estimate(panorama)
        seconds = time.perf_counter() - start
        _check_range(model, panorama, range_m)
        if cache is not None:
            cache.put(key, {"range_m": range_m}, seconds)
    else:
        range_m, seconds = cached[0]["range_m"], cached[1]
    if panorama.valid is not None:
        range_m = np.where(panorama.valid, range_m, np.float32(np.nan))
    return replace(panorama, range_m=range_m, range_by=model.name), seconds


def _check_range(model: RangeModel, panorama: Panorama, range_m: Any) -> None:
    shape = None if panorama.rgb is None else panorama.rgb.shape[:2]
    if not (isinstance(range_m, np.ndarray) and range_m.dtype == np.float32 and shape in (None, range_m.shape)):
        is_array = isinstance(range_m, np.ndarray)
        received = _layout(range_m.dtype, range_m.shape) if is_array else f"a value of type {type(range_m).__name__}"
        expected = "an array of dtype float32" if shape is None else _layout("float32", shape)
        raise InvalidAnswer(
            f"the range model {model.name!r} returned {received}, expected {expected}, metres along the ray"
        )
    if (range_m <= 0).any() or np.isinf(range_m).any():
        raise InvalidAnswer(
            f"the range model {model.name!r} returned a range that is zero, negative or infinite, expected positive "
            "metres, or NaN where the range is unknown"
        )


def _layout(dtype: object, shape: tuple[int, ...]) -> str:
    return f"an array of dtype {dtype} and shape {shape}"


def from_bright_side(estimate: Callable[[Any, Panorama], np.ndarray]) -> Callable[[Any, Panorama], np.ndarray]:
    """Decorate `estimate` so that it receives each panorama with its bright side in the middle.

    The range image is rotated back. Use it for networks whose output depends on the first column of the panorama, for
    example because of strides. The estimate then does not depend on the heading of the camera.
    salframe.graphs.turning.from_near_side does the same for detectors.
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
        rotated = replace(panorama, range_m=None, range_by=None, annotations=None, **images)
        return np.roll(estimate(model, rotated), -columns, 1)

    return steady
