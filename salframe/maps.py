"""Maps of places on disk: building one with a localizer and a topology, opening it again, and frames to ask it about."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from salframe.config import parse_override, validate
from salframe.errors import ConfigError, DataError, NoRoute, UnknownName
from salframe.geometry import pose_yaw
from salframe.localizer import Localizer
from salframe.predict import open_dataset
from salframe.presets import MANIFEST, Overrides, configure, dataset_settings, settings
from salframe.registry import registry, unknown
from salframe.roles import Dataset
from salframe.storage import Cache, atomic_folder, read_json
from salframe.topology import TopologySettings, build_topology
from salframe.topology.routes import HERE, find_route, with_position
from salframe.topology.store import TOPOLOGY, read_topology, write_topology
from salframe.types import Frame, Localization, Route, TopologicalMap

Progress = Callable[[str, int, int], None]

MAP = "map.json"
"""The localizer's part of a map."""


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


def open_frame(
    name: str, data: str | None = None, data_dir: Path | None = None, overrides: Sequence[str] = (), progress: Progress | None = None
) -> Frame:
    """The frame of this id in a dataset; without one, the frame that the image at this path belongs to. Raises DataError, UnknownName."""
    if data is None:
        folder, name = find_image(Path(name))
        data = str(folder)
    return find_frame(find_dataset(data, data_dir, overrides, progress), name)


def build_map(
    data: str, output: Path, method: str = "proposed", *, data_dir: Path | None = None, overrides: Sequence[str] = (),
    progress: Progress | None = None,
) -> Localizer:  # fmt: skip
    """Describe a dataset's mapping frames with a method and save the map to the folder `output`.

    Raises ConfigError where `output` holds something else than a map.
    """
    _check_output(output)
    dataset, localizer = _prepare(data, method, data_dir, overrides, progress)
    localizer.build(mapping_frames(dataset), Cache(), dataset.fingerprint, progress and partial(progress, method))
    localizer.save(output)
    return localizer


def build_topological_map(
    data: str, output: Path, method: str = "proposed", *, choose: bool = False, data_dir: Path | None = None, overrides: Sequence[str] = (),
    progress: Progress | None = None,
) -> TopologicalMap:  # fmt: skip
    """Make the topological map of a dataset's floors and the map of a method, and save both to the folder `output`, which appears whole.

    `choose`: one scene node where each region is widest, rather than where mapping frames stand. A dataset without mapping frames gives the
    topological map alone. Raises DataError on a dataset without floors, ConfigError where `output` holds something else than a map.
    """
    _check_output(output)
    dataset, localizer = _prepare(data, method, data_dir, overrides, progress)
    floors, frames = dataset.floors(), mapping_frames(dataset)
    if not floors:
        raise DataError(f"{data} has no floor masks, expected a dataset that has: salframe build makes a map without a topology")
    topology = build_topology(floors, frames, TopologySettings(choose=choose))
    with atomic_folder(output) as folder:
        write_topology(folder, topology)
        if frames:
            localizer.build(frames, Cache(), dataset.fingerprint, progress and partial(progress, method))
            localizer.save(folder)
    return topology


def _check_output(output: Path) -> None:
    is_map = any((output / name).exists() for name in (MAP, TOPOLOGY))
    if output.exists() and not is_map and (not output.is_dir() or any(output.iterdir())):
        raise ConfigError(f"{output} holds something else than a map: name a new folder, or remove it")


def _prepare(
    data: str, method: str, data_dir: Path | None, overrides: Sequence[str], progress: Progress | None
) -> tuple[Dataset, Localizer]:
    """The prepared dataset and the localizer of a method's name, with overrides for both."""
    contents = {method: settings("localizer", method)}
    given = Overrides(map(parse_override, overrides), contents)
    localizer = registry().build("localizer", configure("localizer", method, contents[method], given.methods[method]))
    return _open(data, data_dir, given.data, progress), localizer


def open_map(directory: Path) -> Localizer:
    """The localizer of a saved map, ready to localize. Raises DataError where `directory` is no map, UnknownName without its localizer."""
    content = read_json(directory / MAP)
    try:
        saved = content["localizer"]
        model = registry().get("localizer", saved["kind"]).Config
    except (KeyError, TypeError):
        raise DataError(f"{directory / MAP} names no localizer: build the map again") from None
    localizer: Localizer = registry().build("localizer", validate(model, saved, f"{directory}:"))
    localizer.load(directory)
    return localizer


@dataclass(frozen=True)
class Whereabouts:
    """What a map makes of a panorama: the localizer's answer, the nearest node, how far it is to walk there (None without a pose), the heading
    (azimuth of the panorama's x axis, None without a pose), and the route to a goal where one was asked for."""

    localization: Localization
    node: str | None
    distance_m: float | None = None
    heading_rad: float | None = None
    route: Route | None = None


def ask_map(directory: Path, frame: Frame, goal: str | None = None, planner: str = "dijkstra") -> Whereabouts:
    """Localize a frame with a map that `build_topological_map` wrote, find the nearest node, and plan the route to a node or place.

    With a pose the route begins there, at the node `here`; without, at the node of the map frame that answered. Raises DataError, UnknownName
    on a goal that is not on the map, NoRoute where none leads there or the frame is not localized.
    """
    topology = read_topology(directory)
    answer = open_map(directory).localize(frame)
    if answer.T_world_query is not None:
        topology = with_position(topology, answer.T_world_query[:3, 3])
        near = min((edge for edge in topology.edges if edge.start == HERE), key=lambda edge: edge.length_m)
        found = Whereabouts(answer, near.end, near.length_m, pose_yaw(answer.T_world_query))
        start: str | None = HERE
    else:
        answered = answer.places[0].frame if answer.places else None
        start = next((node.id for node in topology.nodes if answered in node.frames), None)
        found = Whereabouts(answer, start)
    if goal is None:
        return found
    if start is None:
        raise NoRoute(f"no route from {frame.id} to {goal}: {frame.id} was not localized at a node of the map (status {answer.status})")
    return replace(found, route=find_route(topology, start, goal, planner))
