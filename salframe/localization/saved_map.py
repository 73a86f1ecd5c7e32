"""The map on disk: built with a localizer, opened again, and asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from salframe.framework.auto import Choice
from salframe.framework.cache import Cache
from salframe.framework.config import ComponentConfig, parse_override, validate
from salframe.framework.defaults import default_of
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files import atomic_folder
from salframe.framework.presets import Overrides, configure, settings, short_name
from salframe.framework.registry import registry
from salframe.localization.localizer import MAP, Localizer, read_map
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
    progress: Progress | None = None,
    tell: Tell = silent,
) -> Localizer:
    """Describe a dataset's mapping frames with a method and save the map to the folder `output`, which appears whole.

    It replaces the map that the folder held and all that lies beside it, the topology of a topological map too. Raises
    ConfigError where `output` holds something else than a map, InputMissing where nothing that `auto` may become can
    run.
    """
    output = Path(output)
    check_output(output, MAP)
    name, dataset, localizer = prepare(data, method, data_dir, overrides, progress, tell)
    tracked = progress and partial(progress, name)
    for note in localizer.build(mapping_frames(dataset), Cache(), dataset.content_key, tracked, dataset.floors()):
        tell(note)
    with atomic_folder(output) as folder:
        localizer.save(folder)
    return localizer


def check_output(output: Path, *names: str) -> None:
    """Raises ConfigError where a folder to write a map to holds something else than a map, which has a file of one of
    these names."""
    is_map = any((output / name).exists() for name in names)
    if output.exists() and not is_map and (not output.is_dir() or any(output.iterdir())):
        raise ConfigError(f"{output} holds something else than a map: name a new folder, or remove it")


def prepare(
    data: str | Path | None,
    method: str | None,
    data_dir: str | Path | None,
    overrides: Sequence[str],
    progress: Progress | None,
    tell: Tell,
) -> tuple[str, Dataset, Localizer]:
    """A method's short name, the prepared dataset, and the method's localizer, with overrides for both; `tell` what
    `auto` became, and where ranges seem to be in a wrong unit."""
    asked = default_of("map_method") if method is None else method
    name, content = short_name(asked), settings("localizer", asked)
    given = Overrides(map(parse_override, overrides), {name: content}, role="localizer", scopes=("data",))
    data_name, config = configure_dataset(data, data_dir, given.scopes["data"])
    choice = Choice(data_name, partial(provided, config))
    chosen = configure("localizer", name, content, given.methods[name], choice)
    localizer: Localizer = registry().build("localizer", chosen)
    for note in choice.notes:
        tell(f"{name}: {note}")
    dataset = open_dataset(config, progress and partial(progress, data_name))
    if units := units_note(mapping_frames(dataset)):
        tell(f"warning: {units}")
    return name, dataset, localizer


def open_map(directory: str | Path) -> Localizer:
    """The localizer of a saved map, ready to localize as many panoramas as there are.

    Raises DataError where `directory` is no map, UnknownName without its localizer.
    """
    directory = Path(directory)
    localizer: Localizer = registry().build("localizer", map_config(directory))
    localizer.load(directory)
    return localizer


def map_config(directory: Path) -> ComponentConfig:
    """The configuration of a saved map's localizer, as it was decided when the map was built. Raises as `open_map`."""
    saved = read_map(directory).localizer
    if not isinstance(kind := saved.get("kind"), str):
        raise DataError(f"{directory / MAP} names no localizer: build the map again")
    config: ComponentConfig = validate(registry().get("localizer", kind).Config, saved, f"{directory}:")
    return config
