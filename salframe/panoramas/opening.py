"""Open datasets and their frames by name: a preset, a dataset, a YAML file, or a folder of panoramas."""

from __future__ import annotations

import os
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
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame

Progress = Callable[[str, int, int], None]
"""Called as progress(what, done, total); `what` is the name of a dataset that is prepared, or the label of a method."""


def configure_dataset(
    data: str | Path | None, data_dir: str | Path | None, overrides: Sequence[Mapping[str, Any]] = ()
) -> tuple[str, ComponentConfig]:
    """Return the short name and the configuration of a dataset.

    Args:
        data: A preset, a dataset, a YAML file, or a folder with a manifest.json; None: the default dataset.
        data_dir: Value of the dataset's setting `root`. None: unchanged.
        overrides: Settings that replace those of the preset.

    Raises:
        UnknownName: There is no dataset of this name.
    """
    data = default_of("data") if data is None else str(data)
    folder = Path(data)
    if (folder / MANIFEST).exists():
        name, content = folder.resolve().name, {"kind": FolderDataset.name, "root": str(folder.resolve())}
    elif not data.endswith(SUFFIXES) and data not in names("dataset") and (folder.is_dir() or "/" in data):
        available = ", ".join(names("dataset"))
        raise UnknownName(
            f"{data} is not a dataset, expected a folder with a {MANIFEST}, or one of the names {available}"
        )
    else:
        name, content = short_name(data), settings("dataset", data)
    if data_dir is not None:
        content = merge(content, {"root": str(Path(data_dir).resolve())})
    return name, configure("dataset", name if folder.is_dir() else data, content, overrides)


def open_dataset(
    config: ComponentConfig, progress: Callable[[int, int], None] | None = None, engine: Engine | None = None
) -> Dataset:
    """Build a dataset and prepare it: render or index its frames with an engine (None: the default engine)."""
    dataset: Dataset = registry().build("dataset", config)
    dataset.engine = engine
    dataset.prepare(progress or (lambda done, total: None))
    return dataset


def provided(config: ComponentConfig) -> frozenset[str]:
    """Return the parts that the panoramas of a dataset have, such as rgb and range, without preparing the dataset."""
    dataset: Dataset = registry().build("dataset", config)
    return dataset.provides


def find_dataset(
    data: str | Path | None = None,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
    engine: str | None = None,
) -> Dataset:
    """Open a dataset by name and prepare it: render or index its frames.

    Args:
        data: A preset, a dataset, a YAML file, or a folder with a manifest.json; None: the default dataset.
        data_dir: Value of the dataset's setting `root`. None: unchanged.
        overrides: Settings as "data.KEY=value" or "engine.KEY=value".
        progress: Called with the progress of the preparation.
        engine: Name of the engine that renders; None: the default engine.

    Raises:
        UnknownName: A name is unknown.
        ConfigError: A setting is wrong.
        DataError: The data are missing or malformed.
    """
    scoped = nest_for(map(parse_override, overrides), ("data", "engine"))
    name, config = configure_dataset(data, data_dir, scoped["data"])
    opened = open_engine(engine, scoped["engine"]) if engine or scoped["engine"] else None
    return open_dataset(config, progress and partial(progress, name), opened)


def reference_frames(dataset: Dataset) -> list[ReferenceFrame]:
    """Return the reference frames of all folds, each once."""
    return distinct_references(dataset.folds())


def distinct_references(folds: Sequence[Fold]) -> list[ReferenceFrame]:
    """Return the reference frames of folds, each once."""
    return list({frame.id: frame for fold in folds for frame in fold.references}.values())


def find_frame(dataset: Dataset, name: str) -> ReferenceFrame | QueryFrame:
    """Return the frame with this id: a query, an earlier view of a query, or a reference frame.

    Raises:
        UnknownName: There is no such frame. The error suggests the closest id.
    """
    frames: dict[str, ReferenceFrame | QueryFrame] = {}
    for fold in dataset.folds():
        frames.update((frame.id, frame) for frame in fold.references)
        frames.update((view.id, view) for query in fold.queries for view in query.earlier)
        frames.update((query.id, query) for query in fold.queries)
    if name not in frames:
        raise UnknownName(unknown("frame", name, list(frames)))
    return frames[name]


def find_image(path: Path) -> tuple[Path, str]:
    """Return the dataset folder that contains an image, and the id of the frame of the image. Raises DataError."""
    from salframe.panoramas.image_lookup import dataset_folders, find_frame_image

    image = find_frame_image(path)
    if image is not None:
        return image.folder.root, image.frame.id
    root = next(iter(dataset_folders(path)), None)
    if root is None:
        raise DataError(
            f"{path} is not in a folder with a {MANIFEST}, expected an image listed in the manifest of a dataset"
        )
    raise DataError(
        f"{root / MANIFEST} has no frame with the image {os.path.relpath(path, root)}, expected "
        "an image of a frame in this manifest"
    )


def open_frame(
    name: str,
    data: str | None = None,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
) -> ReferenceFrame | QueryFrame:
    """Return a frame of a dataset by its id or, without a dataset, by the path of its image.

    Args:
        name: Id of the frame, or path of the image where `data` is None.
        data: The dataset, as in `find_dataset`.
        data_dir: As in `find_dataset`.
        overrides: As in `find_dataset`.
        progress: As in `find_dataset`.

    Raises:
        DataError: The data are missing or malformed.
        UnknownName: There is no such dataset or frame.
    """
    if data is None:
        folder, name = find_image(Path(name))
        data = str(folder)
    return find_frame(find_dataset(data, data_dir, overrides, progress), name)
