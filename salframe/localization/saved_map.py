"""The map on disk: built with a localizer, opened again, and asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from salframe.framework.auto import Choice
from salframe.framework.cache import Cache
from salframe.framework.config import ComponentConfig, parse_override, validate
from salframe.framework.defaults import default_of
from salframe.framework.engine import open_engine
from salframe.framework.errors import DataError
from salframe.framework.installation import folder_bytes
from salframe.framework.presets import Overrides, configure, settings, short_name
from salframe.framework.registry import registry
from salframe.localization.describing import describe_ahead
from salframe.localization.localizer import Localizer
from salframe.localization.map_folder import check_output, read_map
from salframe.localization.map_parts import METHOD, read_method
from salframe.panoramas.camera_height import units_note
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import Progress, configure_dataset, mapping_frames, open_dataset, provided

Tell = Callable[[str], None]
"""Called with a line that the user must read: what `auto` became, or that ranges seem to be in a wrong unit."""


def silent(line: str) -> None:
    """Tell nobody."""


def build_map(
    data: str | Path | None,
    output: str | Path,
    method: str | None = None,
    *,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    engine: str | None = None,
    progress: Progress | None = None,
    tell: Tell = silent,
) -> Localizer:
    """Describe a dataset's mapping frames with a method and save the map to the folder `output`, which changes whole.

    It replaces the map that the folder held, the topology of a topological map too. `engine`: what renders and
    describes, the default one where it is None; "engine.KEY=VALUE" among `overrides` are its settings. Raises
    ConfigError where `output` holds something else than a map, InputMissing where nothing that `auto` may become can
    run.
    """
    output = Path(output)
    check_output(output)
    name, dataset, localizer = prepare(data, method, data_dir, overrides, engine, progress, tell)
    build_from(localizer, dataset, progress and partial(progress, name), tell)
    localizer.save(output)
    return localizer


def prepare(
    data: str | Path | None,
    method: str | None,
    data_dir: str | Path | None,
    overrides: Sequence[str],
    engine: str | None,
    progress: Progress | None,
    tell: Tell,
) -> tuple[str, Dataset, Localizer]:
    """A method's short name, the dataset prepared by an engine, and the method's localizer, with overrides for all;
    `tell` what `auto` became, and where ranges seem to be in a wrong unit."""
    asked = default_of("map_method") if method is None else method
    name, content = short_name(asked), settings("localizer", asked)
    given = Overrides(map(parse_override, overrides), {name: content}, role="localizer", scopes=("data", "engine"))
    data_name, config = configure_dataset(data, data_dir, given.scopes["data"])
    choice = Choice(data_name, partial(provided, config))
    chosen = configure("localizer", name, content, given.methods[name], choice)
    localizer: Localizer = registry().build("localizer", chosen)
    for note in choice.notes:
        tell(f"{name}: {note}")
    opened = open_engine(engine, given.scopes["engine"]) if engine or given.scopes["engine"] else None
    dataset = open_dataset(config, progress and partial(progress, data_name), opened)
    if units := units_note(mapping_frames(dataset)):
        tell(f"warning: {units}")
    return name, dataset, localizer


def build_from(localizer: Localizer, dataset: Dataset, progress: Callable[[int, int], None] | None, tell: Tell) -> None:
    """Have a localizer build its map of a prepared dataset; workers of the dataset's engine, where their number is set,
    describe the frames first."""
    describe_ahead(localizer.config, dataset, progress)
    frames = mapping_frames(dataset)
    for note in localizer.build(frames, Cache(), dataset.content_key, progress, dataset.floors()):
        tell(note)


def open_map(directory: str | Path) -> Localizer:
    """The localizer of a saved map, ready to localize as many panoramas as there are.

    Raises DataError where `directory` holds no map, or one that was edited or is not whole; UnknownName without its
    localizer.
    """
    return read_map(Path(directory), read_localizer)


def map_bytes(localizer: Localizer) -> int:
    """The bytes on disk of the map that a localizer has taken, without its index, which is made of the map."""
    with TemporaryDirectory() as folder:
        localizer.save(Path(folder) / "map", indexed=False)
        return folder_bytes(Path(folder))


def map_config(directory: Path) -> ComponentConfig:
    """The configuration of a saved map's localizer, as it was decided when the map was built. Raises as `open_map`."""
    return read_map(directory, _read_config)


def read_localizer(parts: Path) -> Localizer:
    """The localizer among the parts of a map. Raises as `open_map`."""
    localizer = _make_localizer(parts)
    localizer.read_parts(parts)
    return localizer


def read_unindexed(parts: Path) -> Localizer:
    """The localizer among the parts of a map, which remembers it and cannot be asked yet. Raises as `open_map`."""
    localizer = _make_localizer(parts)
    localizer.remember(parts)
    return localizer


def _make_localizer(parts: Path) -> Localizer:
    localizer: Localizer = registry().build("localizer", _read_config(parts))
    return localizer


def _read_config(parts: Path) -> ComponentConfig:
    saved = read_method(parts).localizer
    if not isinstance(kind := saved.get("kind"), str):
        raise DataError(f"{parts / METHOD} names no localizer: build the map again")
    config: ComponentConfig = validate(registry().get("localizer", kind).Config, saved, f"{parts.parent}:")
    return config
