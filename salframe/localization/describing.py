"""Describe frames (compute their features) with a localizer: estimate missing range, measure the time, cache the
result, and use worker processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any

from salframe.framework.component import ComponentConfig, components_in
from salframe.framework.components.auto import first_fit, needs_of
from salframe.framework.components.identity import identity
from salframe.framework.components.registry import registry
from salframe.framework.engines.engine import Engine
from salframe.framework.errors import FRAME_ERRORS, InputMissing
from salframe.framework.files.bounded import parse_json
from salframe.framework.files.cache import Cache
from salframe.framework.files.hashes import digest
from salframe.framework.validation import validate
from salframe.graphs.cached_detections import detect_cached
from salframe.localization.detecting import DetectingLocalizer
from salframe.localization.level_frames import R_LEVEL_PANO, level_key, level_panorama
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.opening import open_dataset, reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import estimate_range


def estimates_range(localizer: Localizer, provides: frozenset[str]) -> bool:
    """Return whether range is estimated for panoramas that provide these parts. It is estimated if they have no range
    and the localizer has a range model.

    Args:
        localizer: The localizer.
        provides: Parts that the panoramas have: some of "rgb", "range" and "annotations".
    """
    return localizer.range_model is not None and "range" not in provides


def required_parts(localizer: Localizer, provides: frozenset[str]) -> frozenset[str]:
    """Return the parts that a panorama must have for a localizer: the `needs` of the localizer.

    If range is estimated, the needs of the range model replace "range".

    Args:
        localizer: The localizer.
        provides: Parts that the panoramas have: some of "rgb", "range" and "annotations".
    """
    if localizer.range_model is None or not estimates_range(localizer, provides):
        return localizer.needs
    return (localizer.needs - {"range"}) | localizer.range_model.needs


def check_parts(localizer: Localizer, panorama: Panorama, remedy: Callable[[], str] | None = None) -> None:
    """Raise InputMissing if a panorama lacks an input that the localizer requires, such as range.

    The error message ends with the text that `remedy` returns.
    """
    if missing := required_parts(localizer, panorama.provides) - panorama.provides:
        parts = " and ".join(sorted(missing))
        reason = f"the method {localizer.name!r} needs {parts}, which {panorama.display_name} does not have"
        raise InputMissing(reason if remedy is None else f"{reason}: {remedy()}")


def suggest_components(config: ComponentConfig, provides: frozenset[str]) -> str:
    """Return advice for the case that the panoramas lack an input of the localizer, such as range. The advice is to
    build the map with other components, or to pass the missing inputs."""
    unusable = ((slot, inner.component.role) for slot, inner in components_in(config) if needs_of(inner) - provides)
    replacements = [
        (slot, component.name) for slot, role in unusable if (component := first_fit(role, provides)[0]) is not None
    ]
    missing = " and ".join(sorted(needs_of(config) - provides))
    if not replacements:
        return f"pass {missing} too, or build a map with another method"
    settings = " and ".join(f"--set {slot}.kind={name}" for slot, name in replacements)
    return f"build the map with {settings}, or pass {missing} too"


def complete_panorama(
    localizer: Localizer, panorama: Panorama, cache: Cache | None = None, cache_key: Mapping[str, str] | None = None
) -> tuple[Panorama, float]:
    """Return the panorama, with estimated range if necessary, and the time of the estimation in seconds.

    Range is estimated if the panorama has none and the localizer has a range model.

    Args:
        localizer: The localizer.
        panorama: The panorama.
        cache: As in `estimate_range`.
        cache_key: As in `estimate_range`.

    Raises:
        InputMissing: The panorama lacks a part that the localizer requires.
    """
    check_parts(localizer, panorama)
    if localizer.range_model is None or not estimates_range(localizer, panorama.provides):
        return panorama, 0.0
    return estimate_range(localizer.range_model, panorama, cache, cache_key)


def describe_frame(
    localizer: Localizer, frame: ReferenceFrame | QueryFrame, cache: Cache | None = None, dataset: str = ""
) -> tuple[Description, float]:
    """Return the description (features) of a frame, and the time of its computation in seconds, without the time to
    load the panorama.

    Args:
        localizer: The localizer.
        frame: The frame. If its panorama is tilted and the `level` of the localizer is "auto", the panorama is levelled
            first. The description then contains the rotation R_LEVEL_PANO.
        cache: Cache of descriptions and detections; None: no cache. For cached results, the time of the original
            computation is returned.
        dataset: The `content_key` of the dataset. The cache identifies a panorama by the id and the `content` of the
            frame. If the frame has no `content`, this key is used in its place.

    Raises:
        InputMissing: The panorama lacks a part that the localizer requires.
        DataError: The panorama cannot be read.
    """
    cache_key = {"dataset": frame.content or dataset, "frame": frame.id}
    if cache is not None:
        key = {**cache_key, **level_key(localizer, frame), "describe": localizer.describe_identity()}
        cached = cache.get(key)
        if cached is not None:
            return cached
    panorama = frame.load()
    start = time.perf_counter()
    panorama, rotation = level_panorama(localizer, frame, panorama)
    level_s = time.perf_counter() - start
    if rotation is not None:
        cache_key["level"] = digest(rotation.round(9).tolist())
    completed, estimate_s = complete_panorama(localizer, panorama, cache, cache_key)
    description, describe_s = _describe_panorama(localizer, completed, panorama.provides, cache, cache_key)
    seconds = level_s + estimate_s + describe_s
    if rotation is not None:
        description = {**description, R_LEVEL_PANO: rotation}
    if cache is not None:
        cache.put(key, description, seconds)
    return description, seconds


def _describe_panorama(
    localizer: Localizer,
    panorama: Panorama,
    provides: frozenset[str],
    cache: Cache | None,
    cache_key: Mapping[str, Any],
) -> tuple[Description, float]:
    """Return the description of a panorama, and the time in seconds. The detections come from the cache if possible.

    Args:
        localizer: The localizer.
        panorama: The panorama, with estimated range if necessary.
        provides: Parts of the panorama before its range was estimated.
        cache: Cache of detections; None: no cache.
        cache_key: Identifies the panorama before its range was estimated.
    """
    if (
        cache is None
        or not isinstance(localizer, DetectingLocalizer)
        or type(localizer).describe is not DetectingLocalizer.describe  # it may not call `describe_detections`
    ):
        start = time.perf_counter()
        description = localizer.describe(panorama)
        return description, time.perf_counter() - start
    key = dict(cache_key)
    if localizer.range_model is not None and estimates_range(localizer, provides):
        key["range"] = identity(localizer.range_model.config)
    detections, detect_s = detect_cached(localizer.detector, panorama, cache, key)
    start = time.perf_counter()
    description = localizer.describe_detections(detections, panorama)
    return description, detect_s + time.perf_counter() - start


def describe_frames(
    method: ComponentConfig, data: ComponentConfig, frames: Sequence[str], engine: Engine
) -> Iterator[tuple[str, float]]:
    """Describe reference frames of a prepared dataset (compute their features) with an engine, and store the
    descriptions in the cache.

    A frame that cannot be described is skipped. If the method itself fails, all following frames are skipped. Errors
    are not raised here, but later, when the description is needed.

    Args:
        method: Settings of the localizer.
        data: Settings of the dataset.
        frames: Ids of the frames.
        engine: The engine.

    Yields:
        The id of each described frame, and the time of the computation in seconds.
    """
    settings = [config.model_dump_json() for config in (method, data)]
    for answer in engine.try_all(partial(_describe, *settings), frames):
        if isinstance(answer, tuple):
            yield answer
        elif not isinstance(answer, FRAME_ERRORS):
            return


def describe_ahead(
    method: ComponentConfig, dataset: Dataset, progress: Callable[[int, int], None] | None = None
) -> None:
    """Describe the reference frames of a prepared dataset (compute their features) with the workers of its engine, and
    cache the descriptions.

    Do nothing if the number of workers is not set.
    """
    if dataset.engine is None or not dataset.engine.isolates or dataset.engine.workers is None:
        return
    ids = [frame.id for frame in reference_frames(dataset)]
    for done, _ in enumerate(describe_frames(method, dataset.config, ids, dataset.engine), 1):
        if progress:
            progress(done, len(ids))


def _describe(method: str, data: str, frame: str) -> tuple[str, float]:
    localizer, cache, content_key, frames = _open(method, data)
    return frame, describe_frame(localizer, frames[frame], cache, content_key)[1]


@lru_cache(maxsize=1)
def _open(method: str, data: str) -> tuple[Localizer, Cache, str, Mapping[str, ReferenceFrame]]:
    """Return a localizer, the cache, the content_key and the reference frames of a dataset.

    A worker process reuses them for all its frames.
    """
    dataset = open_dataset(read_config("dataset", data))
    localizer: Localizer = registry().build("localizer", read_config("localizer", method))
    return localizer, Cache(), dataset.content_key, {frame.id: frame for frame in reference_frames(dataset)}


def read_config(role: str, content: str) -> Any:
    """Return the configuration of a component from JSON text, the form in which processes exchange it."""
    settings = parse_json(content.encode())
    return validate(registry().get(role, settings["kind"]).Config, settings, settings["kind"])
