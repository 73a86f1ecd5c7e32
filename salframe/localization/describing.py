"""Frames described by an engine: into the cache, from which whoever needs a description takes it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any

from salframe.framework.bounded import parse_json
from salframe.framework.cache import Cache
from salframe.framework.config import ComponentConfig, validate
from salframe.framework.engine import Engine
from salframe.framework.errors import FRAME_ERRORS
from salframe.framework.registry import registry
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import MapFrame
from salframe.panoramas.opening import mapping_frames, open_dataset


def describe_frames(
    method: ComponentConfig, data: ComponentConfig, frames: Sequence[str], engine: Engine
) -> Iterator[tuple[str, float]]:
    """Describe mapping frames of a prepared data set, by their ids, into the cache: each that is done, and the seconds
    it took when it was computed.

    A frame that cannot be described is left out, and where the method itself fails, all that follow: who needs the
    description will meet the same, and tell.
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
    """Have the workers of a prepared data set's engine, where their number is set, describe its mapping frames into the
    cache."""
    if dataset.engine is None or not dataset.engine.isolates or dataset.engine.workers is None:
        return
    ids = [frame.id for frame in mapping_frames(dataset)]
    for done, _ in enumerate(describe_frames(method, dataset.config, ids, dataset.engine), 1):
        if progress:
            progress(done, len(ids))


def _describe(method: str, data: str, frame: str) -> tuple[str, float]:
    localizer, cache, content_key, frames = _open(method, data)
    return frame, localizer.describe_frame(frames[frame], cache, content_key)[1]


@lru_cache(maxsize=1)
def _open(method: str, data: str) -> tuple[Localizer, Cache, str, Mapping[str, MapFrame]]:
    """A localizer and the mapping frames of a data set, which a worker keeps from one frame to the next."""
    dataset = open_dataset(read_config("dataset", data))
    localizer: Localizer = registry().build("localizer", read_config("localizer", method))
    return localizer, Cache(), dataset.content_key, {frame.id: frame for frame in mapping_frames(dataset)}


def read_config(role: str, content: str) -> Any:
    """The configuration of a component in JSON text, as one process hands it to another."""
    settings = parse_json(content.encode())
    return validate(registry().get(role, settings["kind"]).Config, settings, settings["kind"])
