"""Prepare a method and a dataset by name, as map building and fitting need them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from salframe.framework.components.auto import Choice
from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import Overrides, configure, settings, short_name
from salframe.framework.components.registry import registry
from salframe.framework.config import parse_override
from salframe.framework.engines.engine import open_engine
from salframe.localization.localizer import Localizer
from salframe.panoramas.data_checks import data_notes, picture_note
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import Progress, configure_dataset, open_dataset, provided, reference_frames

Tell = Callable[[str], None]
"""Called with a line that the user must read, such as the component that `auto` selected, or a warning."""


python_warning: Callable[[str], object] = partial(warnings.warn, stacklevel=2)
"""Issues a Python warning at the caller of the function that calls this."""


def silent(line: str) -> None:
    """Ignore a line for the user."""


def prepare(
    data: str | Path | None,
    method: str | None,
    data_dir: str | Path | None,
    overrides: Sequence[str],
    engine: str | None,
    progress: Progress | None,
    tell: Tell,
) -> tuple[str, Dataset, Localizer]:
    """Return the short name of a method, a prepared dataset, and the localizer of the method.

    Args:
        data: As in `find_dataset`.
        method: A preset, a localizer or a YAML file; None: the default method.
        data_dir: As in `find_dataset`.
        overrides: Settings as "METHOD.KEY=value", "data.KEY=value" or "engine.KEY=value".
        engine: As in `find_dataset`.
        progress: As in `find_dataset`.
        tell: Called with notes: the components that `auto` selected, changes of pictures because of their XMP metadata,
            and the warnings of `data_notes`.

    Raises:
        SalframeError: A name or a setting is wrong, or the data are missing or malformed.
    """
    requested = default_of("map_method") if method is None else method
    name, content = short_name(requested), settings("localizer", requested)
    scoped = Overrides(map(parse_override, overrides), {name: content}, role="localizer", scopes=("data", "engine"))
    data_name, config = configure_dataset(data, data_dir, scoped.scopes["data"])
    choice = Choice(data_name, partial(provided, config))
    localizer: Localizer = registry().build(
        "localizer", configure("localizer", requested, content, scoped.methods[name], choice)
    )
    for note in choice.notes:
        tell(f"{name}: {note}")
    opened = open_engine(engine, scoped.scopes["engine"]) if engine or scoped.scopes["engine"] else None
    dataset = open_dataset(config, progress and partial(progress, data_name), opened)
    if picture := picture_note(reference_frames(dataset)):
        tell(picture)
    for note in data_notes(dataset):
        tell(f"warning: {note}")
    return name, dataset, localizer
