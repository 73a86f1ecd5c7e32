"""The map of a building in one folder: localization map and topological map, built and queried together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from salframe.framework.errors import ConfigError, DataError, NoRoute
from salframe.localization.answers import Localization
from salframe.localization.map import LocalizationMap, build_localization
from salframe.localization.map_files import MapParts, check_output, read_map, write_map
from salframe.localization.preparing import Tell, prepare, silent
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_yaw
from salframe.panoramas.opening import Progress, reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.topology.build import build_topology
from salframe.topology.planner import Route
from salframe.topology.routes import HERE, find_route, with_position
from salframe.topology.store import TOPOLOGY, read_topology, write_topology
from salframe.topology.topological_map import TopologicalMap, TopologySettings


@dataclass(frozen=True)
class BuildingMap:
    """The map of a building: `localization` is None for data without reference frames, `topology` is None for data
    without floors, and where it was not wanted."""

    localization: LocalizationMap | None
    topology: TopologicalMap | None

    def write(self, parts: MapParts) -> None:
        """Write the parts of both maps."""
        if self.localization is not None:
            self.localization.write(parts)
        if self.topology is not None:
            write_topology(parts, self.topology)


def build_map(
    data: str | Path | None,
    output: str | Path,
    method: str | None = None,
    *,
    topology: bool = True,
    choose: bool = False,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    engine: str | None = None,
    progress: Progress | None = None,
    tell: Tell = silent,
) -> BuildingMap:
    """Build the map of a dataset and save it to the folder `output`, in one step.

    The map localizes queries with a method, and has a topology where the dataset has floors. Floors that do not allow a
    topology, such as two floors at one height, do not prevent localization: `tell` is called with the reason, and the
    map has no topology. A dataset without reference frames gives the topology alone. The new map replaces the map in
    `output`.

    Args:
        data: name of a dataset or preset, a YAML file, or a folder with a manifest.json.
        output: folder to write the map to.
        method: name of a preset or localizer (default: that of `salframe build`).
        topology: whether to make the topology of the floors.
        choose: put one scene node where each region is widest, instead of one at each reference frame.
        data_dir: folder with the files of the dataset.
        overrides: settings, "key.path=value" each; those of data and engine start with "data." and "engine.".
        engine: name of the component that renders and describes.
        progress: called with what is done, and how much of how many.
        tell: called with lines that the user must read.

    Raises ConfigError where `output` holds something else than a map, DataError on data without reference frames and
    without usable floors and with `choose` on data without usable floors, InputMissing where nothing that `auto` may
    select can run.
    """
    output = Path(output)
    if choose and not topology:
        raise ConfigError("received both choose and no topology, expected one of them: choose places the scene nodes")
    check_output(output)
    name, dataset, localizer = prepare(data, method, data_dir, overrides, engine, progress, tell)
    floors, frames = dataset.floors() if topology else (), reference_frames(dataset)
    if choose and not floors:
        raise DataError(f"{dataset.name} has no floor masks, expected a dataset with floor masks for its topology")
    made = None
    if floors:
        try:
            made = build_topology(floors, frames, TopologySettings(choose=choose))
        except DataError as error:
            if choose or not frames:
                raise
            tell(f"warning: the map has no topology: {error}")
    localization = None
    if frames or made is None:
        localization = build_localization(localizer, dataset, progress and partial(progress, name), tell)
    built = BuildingMap(localization, made)
    with write_map(output) as parts:
        built.write(parts)
    return built


@dataclass(frozen=True)
class Whereabouts:
    """The answer of a map to a query.

    localization: the localizer's answer; node: the nearest node, off all floors and without a pose that of the frame
    that answered, None in a map without topology; distance_m: distance to walk to the node, None without a pose;
    heading_rad: azimuth of the panorama's x axis, None without a pose; route: the route to the goal where one was
    requested.
    """

    localization: Localization
    node: str | None
    distance_m: float | None = None
    heading_rad: float | None = None
    route: Route | None = None


def ask_map(
    directory: str | Path,
    frame: ReferenceFrame | QueryFrame | Panorama,
    goal: str | None = None,
    planner: str | None = None,
) -> Whereabouts:
    """Localize a query with a saved map, find the nearest node, and plan the route to a node or place.

    With a pose the route begins there, at the node `here`; without, at the node of the reference frame that answered. Raises
    DataError where the map has no localizer, or no topology to plan a route on; UnknownName on a goal that is not on
    the map; NoRoute where there is no route or the query is not localized.
    """
    localization, topology = read_map(Path(directory), partial(_read_both, needs_topology=goal is not None))
    answer = localization.localize(frame)
    if topology is None:
        return Whereabouts(answer, None, None, None if answer.T_world_query is None else pose_yaw(answer.T_world_query))
    answered = answer.places[0].frame if answer.status.names_a_place else None
    start = next((node.id for node in topology.nodes if answered in node.frames), None)
    if answer.T_world_query is not None:
        try:
            topology = with_position(topology, answer.T_world_query[:3, 3])
        except DataError:
            if goal is not None:
                raise
            return Whereabouts(answer, start, None, pose_yaw(answer.T_world_query))
        near = min((edge for edge in topology.edges if edge.start == HERE), key=lambda edge: edge.length_m)
        whereabouts = Whereabouts(answer, near.end, near.length_m, pose_yaw(answer.T_world_query))
        start = HERE
    else:
        whereabouts = Whereabouts(answer, start)
    if goal is None:
        return whereabouts
    if start is None:
        raise NoRoute(
            f"no route from {frame.id} to {goal}: "
            f"{frame.id} was not localized at a node of the map (status {answer.status})"
        )
    return replace(whereabouts, route=find_route(topology, start, goal, planner))


def _read_both(parts: MapParts, needs_topology: bool) -> tuple[LocalizationMap, TopologicalMap | None]:
    topology = read_topology(parts) if needs_topology or parts.has(TOPOLOGY) else None
    return LocalizationMap.read(parts), topology
