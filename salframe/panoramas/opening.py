"""Data sets and their frames by name: a preset, a data set, a YAML file, or a folder of panoramas."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from salframe.framework.component import ComponentConfig
from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import SUFFIXES, configure, names, nest_for, settings, short_name
from salframe.framework.components.registry import registry
from salframe.framework.config import merge, parse_override
from salframe.framework.engines.engine import Engine, open_engine
from salframe.framework.errors import DataError, UnknownName, unknown
from salframe.panoramas.dataset import MANIFEST, Dataset
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.frames import QueryFrame, ReferenceFrame

Progress = Callable[[str, int, int], None]
"""progress(what, done, total): `what` is a data set's name while it is prepared, or a method's label."""


def configure_dataset(
    data: str | Path | None, data_dir: str | Path | None, overrides: Sequence[Mapping[str, Any]] = ()
) -> tuple[str, ComponentConfig]:
    """The short name and the configuration of a data set: `data` is a preset, a data set, a YAML file, or a folder with
    a manifest.json, the default data set where it is None; `data_dir` sets its `root`.
    """
    data = default_of("data") if data is None else str(data)
    folder = Path(data)
    if (folder / MANIFEST).exists():
        name, content = folder.resolve().name, {"kind": FolderDataset.name, "root": str(folder.resolve())}
    elif not data.endswith(SUFFIXES) and data not in names("dataset") and (folder.is_dir() or "/" in data):
        known = ", ".join(names("dataset"))
        raise UnknownName(f"{data} is no dataset: expected a folder with a {MANIFEST}, or one of {known}")
    else:
        name, content = short_name(data), settings("dataset", data)
    if data_dir is not None:
        content = merge(content, {"root": str(Path(data_dir).resolve())})
    return name, configure("dataset", name, content, overrides)


def open_dataset(
    config: ComponentConfig, progress: Callable[[int, int], None] | None = None, engine: Engine | None = None
) -> Dataset:
    """The dataset, prepared: what it renders or indexes is done when this returns, by an engine, the default one where
    it is None."""
    dataset: Dataset = registry().build("dataset", config)
    dataset.engine = engine
    dataset.prepare(progress or (lambda done, total: None))
    return dataset


def provided(config: ComponentConfig) -> frozenset[str]:
    """Which of "rgb", "range", "annotations" the panoramas of a data set have; it is not prepared for that."""
    dataset: Dataset = registry().build("dataset", config)
    return dataset.provides


def find_dataset(
    data: str | Path | None = None,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
    engine: str | None = None,
) -> Dataset:
    """A data set, prepared: what it renders or indexes is done when this returns. `data`: a preset, a data set, a YAML
    file, or a folder with a manifest.json, the default one where it is None; data_dir sets its `root`; engine: the name
    of what renders, the default one where it is None; overrides: "data.key=value" or "engine.key=value" each. Raises
    UnknownName, ConfigError, DataError."""
    given = nest_for(map(parse_override, overrides), ("data", "engine"))
    name, config = configure_dataset(data, data_dir, given["data"])
    made = open_engine(engine, given["engine"]) if engine or given["engine"] else None
    return open_dataset(config, progress and partial(progress, name), made)


def reference_frames(dataset: Dataset) -> list[ReferenceFrame]:
    """The reference frames of all folds, each once."""
    return list({frame.id: frame for fold in dataset.folds() for frame in fold.references}.values())


def find_frame(dataset: Dataset, name: str) -> ReferenceFrame | QueryFrame:
    """The query or reference frame of this id. Raises UnknownName with the closest one."""
    frames: dict[str, ReferenceFrame | QueryFrame] = {}
    for fold in dataset.folds():
        frames.update((frame.id, frame) for frame in fold.references)
        frames.update((query.id, query) for query in fold.queries)
    if name not in frames:
        raise UnknownName(unknown("frame", name, list(frames)))
    return frames[name]


def find_image(path: Path) -> tuple[Path, str]:
    """The folder with a manifest.json that an image lies in, and the id of its frame. Raises DataError."""
    path = path.resolve()
    folder = next((parent for parent in path.parents if (parent / MANIFEST).exists()), None)
    if folder is None:
        raise DataError(
            f"{path} lies in no folder with a {MANIFEST}, expected one that says what frame the image belongs to"
        )
    from salframe.panoramas.folder_format import IMAGE_KEYS, Folder

    image = path.relative_to(folder).as_posix()
    for frame in Folder(folder).manifest.frames:
        if image in [getattr(frame, key) for key in IMAGE_KEYS]:
            return folder, frame.id
    raise DataError(f"{folder / MANIFEST} has no frame with the image {image}")


def open_frame(
    name: str,
    data: str | None = None,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
) -> ReferenceFrame | QueryFrame:
    """The frame of this id in a dataset; without one, the frame that the image at this path belongs to.

    Raises DataError, UnknownName.
    """
    if data is None:
        folder, name = find_image(Path(name))
        data = str(folder)
    return find_frame(find_dataset(data, data_dir, overrides, progress), name)
