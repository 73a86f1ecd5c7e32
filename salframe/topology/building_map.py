"""The map of a building in one folder: a localization map and a topological map, built and queried together."""

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
    """The map of a building.

    Attributes:
        localization: The localization map, None for data without reference frames.
        topology: The topological map, None for data without floors and where it was disabled.
    """

    localization: LocalizationMap | None
    topology: TopologicalMap | None

    def write(self, parts: MapParts) -> None:
        """Write both maps as parts of a saved map."""
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
        topology: whether to build the topology of the floors.
        choose: place one scene node where each region has the largest clearance, instead of one at each reference
            frame.
        data_dir: folder with the files of the dataset.
        overrides: settings, "key.path=value" each; those of data and engine start with "data." and "engine.".
        engine: name of the component that renders and describes.
        progress: called with the name of the step, the number of items done and their total number.
        tell: called with messages for the user, one line each.

    Raises:
        ConfigError: `output` holds something other than a map, or `choose` was combined with no topology.
        DataError: The data have neither reference frames nor usable floors, or no usable floors with `choose`.
        InputMissing: None of the components that `auto` may select can run.
    """
    output = Path(output)
    if choose and not topology:
        raise ConfigError(
            "received the option `choose` without `topology`: `choose` sets the positions of the scene nodes of the "
            "topology; enable `topology`, or omit `choose`"
        )
    check_output(output)
    name, dataset, localizer = prepare(data, method, data_dir, overrides, engine, progress, tell)
    floors, frames = dataset.floors() if topology else (), reference_frames(dataset)
    if choose and not floors:
        raise DataError(f"{dataset.name} has no floor masks, expected a dataset with floor masks to build the topology")
    topological_map = None
    if floors:
        try:
            topological_map = build_topology(floors, frames, TopologySettings(choose=choose))
        except DataError as error:
            if choose or not frames:
                raise
            tell(f"warning: the map has no topology: {error}")
    localization = None
    if frames or topological_map is None:
        localization = build_localization(localizer, dataset, progress and partial(progress, name), tell)
    building_map = BuildingMap(localization, topological_map)
    with write_map(output) as parts:
        building_map.write(parts)
    return building_map


@dataclass(frozen=True)
class Whereabouts:
    """The answer of a map to a query.

    Attributes:
        localization: The answer of the localizer.
        node: The nearest node. Without a pose, or with a pose off all floors, the node of the reference frame that
            answered. None in a map without topology.
        distance_m: Walking distance to the node, None without a pose.
        heading_rad: Azimuth of the panorama's x axis in the world frame, None without a pose.
        route: The route to the goal, where a goal was passed.
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

    With a pose the route begins at that pose, in the node `here`; without a pose it begins at the node of the reference
    frame that answered.

    Args:
        directory: folder of the map.
        frame: the query.
        goal: id of a node or name of a place; None for no route.
        planner: name of the planner, None for the default.

    Raises:
        DataError: The map has no localizer, or no topology to plan a route on.
        UnknownName: The goal is not on the map.
        NoRoute: There is no route, or the query was not localized.
    """
    localization, topology = read_map(Path(directory), partial(_read_both, needs_topology=goal is not None))
    answer = localization.localize(frame)
    if topology is None:
        return Whereabouts(answer, None, None, None if answer.T_world_query is None else pose_yaw(answer.T_world_query))
    best_frame = answer.places[0].frame if answer.status.names_a_place else None
    start = next((node.id for node in topology.nodes if best_frame in node.frames), None)
    if answer.T_world_query is not None:
        try:
            topology = with_position(topology, answer.T_world_query[:3, 3])
        except DataError:
            if goal is not None:
                raise
            return Whereabouts(answer, start, None, pose_yaw(answer.T_world_query))
        nearest = min((edge for edge in topology.edges if edge.start == HERE), key=lambda edge: edge.length_m)
        whereabouts = Whereabouts(answer, nearest.end, nearest.length_m, pose_yaw(answer.T_world_query))
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
