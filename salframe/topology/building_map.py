"""The map of a building in one folder: a localization map and a topological map, built and queried together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from salframe.framework.errors import FRAME_ERRORS, ConfigError, DataError, NoRoute, RequirementMissing, UnknownName
from salframe.framework.files.cache import Cache
from salframe.localization.answers import Localization
from salframe.localization.describing import describe_ahead, describe_frame
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap, build_localization
from salframe.localization.map_files import MapParts, check_output, read_map, write_map
from salframe.localization.preparing import Tell, prepare, python_warning, silent
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import Connection
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_yaw
from salframe.panoramas.opening import Progress, reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.topology.build import build_topology
from salframe.topology.connections import connect_by_walks, restore_connections
from salframe.topology.derived_floors import FloorPlan, derive_floors, has_places
from salframe.topology.free_space import FreeSpace
from salframe.topology.map_server import read_map_server
from salframe.topology.planner import Route
from salframe.topology.routes import HERE, find_route, with_position
from salframe.topology.store import TOPOLOGY, read_topology, write_topology
from salframe.topology.topological_map import TopologicalMap, TopologySettings


@dataclass(frozen=True)
class BuildingMap:
    """The map of a building.

    Attributes:
        localization: The localization map; None for data without reference frames.
        topology: The topological map; None if the data have no usable floors, or the topology was disabled.
    """

    localization: LocalizationMap | None
    topology: TopologicalMap | None

    def write(self, parts: MapParts) -> None:
        """Write both maps as parts of a saved map."""
        if self.localization is not None:
            self.localization.write(parts)
        if self.topology is not None:
            write_topology(parts, self.topology)


def by_place(frames: Iterable[ReferenceFrame]) -> list[ReferenceFrame]:
    """Return frames sorted by place and id. A topology thus does not depend on the order in which frames were added to
    the map."""
    return sorted(frames, key=lambda frame: (frame.place, frame.id))


def build_map(
    data: str | Path | None,
    output: str | Path,
    method: str | None = None,
    *,
    topology: bool = True,
    central_nodes: bool = False,
    calibrate: bool = True,
    floor_map: str | Path | None = None,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    engine: str | None = None,
    progress: Progress | None = None,
    tell: Tell = silent,
) -> BuildingMap:
    """Build the map of a dataset and save it to the folder `output`, in one step.

    The topology is computed from the floor masks of the dataset, and from its stairs and lifts. Without masks, floors
    are derived from the range of the reference frames. If no topology can be computed, `tell` is called with the
    reason. A map without reference frames has only the topology. The new map replaces the map in `output`.

    Args:
        data: name of a dataset or preset, a YAML file, or a folder with a manifest.json.
        output: folder to write the map to.
        method: name of a preset or localizer (default: the default of `salframe build`).
        topology: whether to build the topology of the floors.
        central_nodes: place one scene node in the widest part of each region, instead of one at each reference frame.
        calibrate: whether to calibrate the probabilities of the method with the reference frames.
        floor_map: YAML file of the occupancy map of a robot (`read_map_server`). Its free space is used if the dataset
            has no floor masks.
        data_dir: folder with the files of the dataset.
        overrides: settings, "key.path=value" each; settings of data and engine start with "data." and "engine.".
        engine: name of the engine, which distributes the rendering and the description of panoramas.
        progress: called with the name of the step, the number of items done and their total number.
        tell: called with messages for the user, one line each.

    Raises:
        ConfigError: `output` holds something other than a map, or `central_nodes` or `floor_map` was combined with
            `topology=False`.
        DataError: `floor_map` cannot be read, or the data have no usable floors. Missing floors are an error only if
            `central_nodes` or `floor_map` was passed, or if the data have no reference frames.
        RequirementMissing: `central_nodes` or `floor_map` was passed, and a package that derives floors is not
            installed.
        InputMissing: None of the components that `auto` may select can run.
    """
    output = Path(output)
    if central_nodes and not topology:
        raise ConfigError(
            "received --central-nodes and --no-topology, expected at most one: a map without a topology has no nodes"
        )
    if floor_map is not None and not topology:
        raise ConfigError(
            "received --floor-map and --no-topology, expected at most one: only a topology uses the floor map"
        )
    check_output(output)
    space = None if floor_map is None else read_map_server(Path(floor_map))
    name, dataset, localizer = prepare(data, method, data_dir, overrides, engine, progress, tell)
    method_progress = progress and partial(progress, name)
    frames = reference_frames(dataset)
    plan, topological_map = FloorPlan(tuple(dataset.floors()), tuple(frames)), None
    if topology:
        try:
            if not plan.floors:
                plan = plan_floors(dataset, frames, localizer, progress, space)
            elif space is not None:
                tell(f"warning: the floor map {floor_map} is not used, because the data have floor masks")
            topological_map = _build_topology(plan, TopologySettings(choose=central_nodes), dataset.connections())
        except (DataError, RequirementMissing) as error:
            if central_nodes or space is not None or not frames:
                raise
            tell(f"warning: the map has no topology (graph for routes): {error}")
    localization = None
    if frames or topological_map is None:
        localization = build_localization(
            localizer, dataset, method_progress, tell, plan.frames, plan.floors, calibrate=calibrate
        )
    building_map = BuildingMap(localization, topological_map)
    with write_map(output) as parts:
        building_map.write(parts)
    return building_map


def plan_floors(
    dataset: Dataset,
    frames: Sequence[ReferenceFrame],
    localizer: Localizer,
    progress: Progress | None = None,
    space: FreeSpace | None = None,
) -> FloorPlan:
    """Derive the floors of a dataset without floor masks from its reference frames.

    Args:
        dataset: The prepared dataset.
        frames: Its reference frames.
        localizer: The localizer of the map. If the frames have no places, the objects in its descriptions determine the
            names of the regions.
        progress: As in `build_map`.
        space: The free space of the only storey, for example from the occupancy map of a robot; None: it is computed
            from the range images.

    Raises:
        DataError: No floors can be derived from the frames.
        RequirementMissing: A package that derives floors is not installed.
    """
    if not has_places(frames):
        describe_ahead(localizer.config, dataset, progress and partial(progress, localizer.name))
    cache = Cache()

    def labels(frame: ReferenceFrame) -> Sequence[str]:
        with suppress(*FRAME_ERRORS):
            description, _ = describe_frame(localizer, frame, cache, dataset.content_key)
            return [str(label) for label in description.get("labels", ())]
        return ()

    return derive_floors(frames, labels, progress and partial(progress, "floors"), space)


def _build_topology(plan: FloorPlan, settings: TopologySettings, connections: Sequence[Connection]) -> TopologicalMap:
    topology = build_topology(plan.floors, by_place(plan.frames), settings, plan.sources)
    topology = restore_connections(topology, connections) if connections else connect_by_walks(topology, plan.frames)
    return replace(topology, notes=(*filter(None, [plan.sources.note]), *plan.notes, *topology.notes))


@dataclass(frozen=True)
class MapAnswer:
    """The answer of a map to a query.

    Attributes:
        localization: The answer of the localizer.
        node: Id of the node nearest to the estimated position. If there is no pose on a floor, id of the node of the
            best reference frame. None if the map has no topology, or if the answer is not accepted.
        distance_m: Walking distance to the node in metres; None without a pose.
        heading_rad: Azimuth of the x axis of the panorama in the world frame; None without a pose.
        route: The route to the goal; None if no goal was passed, or there is no route.
        no_route: The reason why there is no route to the goal; None if there is a route, or no goal was passed.
    """

    localization: Localization
    node: str | None = None
    distance_m: float | None = None
    heading_rad: float | None = None
    route: Route | None = None
    no_route: str | None = None


def ask_map(
    directory: str | Path,
    frame: ReferenceFrame | QueryFrame | Panorama,
    goal: str | None = None,
    planner: str | None = None,
    *,
    warn: Callable[[str], object] = python_warning,
) -> MapAnswer:
    """Localize a query with a saved map, find the nearest node, and plan the route to a node, place or sign.

    The route begins at the estimated position, which becomes the node `here`. Without a pose, it begins at the node of
    the best reference frame. If there is no route, the answer states the reason: the goal is unknown or cannot be
    reached, the map has no topology, or the answer of the localizer is not accepted.

    Args:
        directory: folder of the map.
        frame: the query.
        goal: id of a node, name of a place, or text of a sign; None for no route.
        planner: name of the planner, None for the default.
        warn: as in `LocalizationMap.localize`.

    Raises:
        DataError: The map has no localizer, or the query is malformed.
        InputMissing: The query lacks a part that the localizer needs.
    """
    localization, topology = read_map(Path(directory), _read_both)
    answer = localization.localize(frame, warn=warn)
    map_answer = MapAnswer(answer, heading_rad=None if answer.T_world_query is None else pose_yaw(answer.T_world_query))
    if answer.accepted is False:
        reason = f"the query {frame.id} was not localized ({answer.summary})"
        return map_answer if goal is None else replace(map_answer, no_route=f"no route to {goal}: {reason}")
    if topology is None:
        reason = "the map has no topology, which routes need: build the map from data with floor masks or range"
        return map_answer if goal is None else replace(map_answer, no_route=f"no route to {goal}: {reason}")
    start = next((node.id for node in topology.nodes if answer.places[0].frame in node.frames), None)
    map_answer = replace(map_answer, node=start)
    try:
        if answer.T_world_query is not None:
            topology = with_position(topology, answer.T_world_query[:3, 3])
            nearest = min((edge for edge in topology.edges if edge.start == HERE), key=lambda edge: edge.length_m)
            map_answer, start = replace(map_answer, node=nearest.end, distance_m=nearest.length_m), HERE
        if goal is None:
            return map_answer
        if start is None:
            raise NoRoute(
                f"no route to {goal}: the query was localized at the reference frame {answer.places[0].frame}, "
                "which has no node in the topology (graph for routes)"
            )
        return replace(map_answer, route=find_route(topology, start, goal, planner))
    except (DataError, NoRoute, UnknownName) as error:
        if goal is None:
            return map_answer
        reason = str(error) if isinstance(error, NoRoute) else f"no route to {goal}: {error}"
        return replace(map_answer, no_route=reason)


def _read_both(parts: MapParts) -> tuple[LocalizationMap, TopologicalMap | None]:
    topology = read_topology(parts) if parts.has(TOPOLOGY) else None
    return LocalizationMap.read(parts), topology
