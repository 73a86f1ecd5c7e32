"""Maps of places on disk: building one with a localizer, opening it again, and frames to ask it about."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from salframe.config import parse_override, validate
from salframe.errors import ConfigError, DataError, UnknownName
from salframe.localizer import Localizer
from salframe.predict import open_dataset
from salframe.presets import MANIFEST, Overrides, configure, dataset_settings, settings
from salframe.registry import registry, unknown
from salframe.roles import Dataset
from salframe.storage import Cache, read_json
from salframe.types import Frame

Progress = Callable[[str, int, int], None]


def find_dataset(data: str, data_dir: Path | None = None, overrides: Sequence[str] = (), progress: Progress | None = None) -> Dataset:
    """The prepared dataset of a preset, a dataset's name or a folder; overrides are "data.key=value"."""
    return _open(data, data_dir, Overrides(map(parse_override, overrides), {}).data, progress)


def _open(data: str, data_dir: Path | None, overrides: Sequence[Mapping[str, Any]], progress: Progress | None) -> Dataset:
    name, content = dataset_settings(data, data_dir)
    return open_dataset(configure("dataset", name, content, overrides), progress and partial(progress, name))


def mapping_frames(dataset: Dataset) -> list[Frame]:
    """The mapping frames of all folds, each once."""
    return list({frame.id: frame for fold in dataset.folds() for frame in fold.mapping}.values())


def find_frame(dataset: Dataset, name: str) -> Frame:
    """The query or mapping frame of this id. Raises UnknownName with the closest one."""
    frames = {frame.id: frame for fold in dataset.folds() for frame in (*fold.mapping, *fold.queries)}
    if name not in frames:
        raise UnknownName(unknown("frame", name, list(frames)))
    return frames[name]


def find_image(path: Path) -> tuple[Path, str]:
    """The folder with a manifest.json that an image lies in, and the id of the frame it belongs to. Raises DataError."""
    path = path.resolve()
    folder = next((parent for parent in path.parents if (parent / MANIFEST).exists()), None)
    if folder is None:
        raise DataError(f"{path} lies in no folder with a {MANIFEST}, expected one that says what frame the image belongs to")
    image = path.relative_to(folder).as_posix()
    for entry in read_json(folder / MANIFEST)["frames"]:
        if image in entry.values():
            return folder, entry["id"]
    raise DataError(f"{folder / MANIFEST} has no frame with the image {image}")


def build_map(
    data: str, output: Path, method: str = "proposed", *, data_dir: Path | None = None, overrides: Sequence[str] = (),
    progress: Progress | None = None,
) -> Localizer:  # fmt: skip
    """Describe a dataset's mapping frames with a method and save the map to the folder `output`.

    Raises ConfigError where `output` holds something else than a map.
    """
    if output.exists() and not (output / "map.json").exists() and (not output.is_dir() or any(output.iterdir())):
        raise ConfigError(f"{output} holds something else than a map: name a new folder, or remove it")
    contents = {method: settings("localizer", method)}
    given = Overrides(map(parse_override, overrides), contents)
    localizer: Localizer = registry().build("localizer", configure("localizer", method, contents[method], given.methods[method]))
    dataset = _open(data, data_dir, given.data, progress)
    localizer.build(mapping_frames(dataset), Cache(), dataset.fingerprint, progress and partial(progress, method))
    localizer.save(output)
    return localizer


def open_map(directory: Path) -> Localizer:
    """The localizer of a saved map, ready to localize. Raises DataError where `directory` is no map, UnknownName without its localizer."""
    content = read_json(directory / "map.json")
    try:
        saved = content["localizer"]
        model = registry().get("localizer", saved["kind"]).Config
    except (KeyError, TypeError):
        raise DataError(f"{directory / 'map.json'} names no localizer: build the map again") from None
    localizer: Localizer = registry().build("localizer", validate(model, saved, f"{directory}:"))
    localizer.load(directory)
    return localizer
