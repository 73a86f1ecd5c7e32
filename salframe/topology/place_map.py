"""A topological map and the map of a method in one folder: built together, asked together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from salframe.framework.errors import DataError, NoRoute
from salframe.localization.answers import Localization
from salframe.localization.localizer import Localizer
from salframe.localization.map_folder import check_output, read_map, write_map
from salframe.localization.saved_map import Tell, build_from, prepare, read_localizer, silent
from salframe.panoramas.frames import MapFrame, QueryFrame
from salframe.panoramas.geometry import pose_yaw
from salframe.panoramas.opening import Progress, mapping_frames
from salframe.panoramas.panorama import Panorama
from salframe.topology.build import build_topology
from salframe.topology.planner import Route
from salframe.topology.routes import HERE, find_route, with_position
from salframe.topology.store import read_topology, write_topology
from salframe.topology.topological_map import TopologicalMap, TopologySettings


def build_topological_map(
    data: str | Path | None,
    output: str | Path,
    method: str | None = None,
    *,
    choose: bool = False,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    engine: str | None = None,
    progress: Progress | None = None,
    tell: Tell = silent,
) -> TopologicalMap:
    """Make the topological map of a dataset's floors and the map of a method, and save both to the folder `output`,
    which changes whole.

    `choose`: one scene node where each region is widest, rather than where mapping frames stand. A dataset without
    mapping frames gives the topological map alone. `engine` as in `build_map`. Raises DataError on a dataset without
    floors, ConfigError where `output` holds something else than a map.
    """
    output = Path(output)
    check_output(output)
    name, dataset, localizer = prepare(data, method, data_dir, overrides, engine, progress, tell)
    floors, frames = dataset.floors(), mapping_frames(dataset)
    if not floors:
        raise DataError(
            f"{dataset.name} has no floor masks, expected a dataset that has: "
            "salframe build makes a map without a topology"
        )
    topology = build_topology(floors, frames, TopologySettings(choose=choose))
    if frames:
        build_from(localizer, dataset, progress and partial(progress, name), tell)
    with write_map(output) as parts:
        if frames:
            localizer.write_parts(parts)
        write_topology(parts, topology)
    return topology


@dataclass(frozen=True)
class Whereabouts:
    """What a map makes of a panorama: the localizer's answer, the nearest node, how far it is to walk there (None
    without a pose, and off all floors, where the node is that of the frame that answered), the heading (azimuth of the
    panorama's x axis, None without a pose), and the route to a goal where one was asked for."""

    localization: Localization
    node: str | None
    distance_m: float | None = None
    heading_rad: float | None = None
    route: Route | None = None


def ask_map(
    directory: str | Path, frame: MapFrame | QueryFrame | Panorama, goal: str | None = None, planner: str | None = None
) -> Whereabouts:
    """Localize a frame with a map that `build_topological_map` wrote, find the nearest node, and plan the route to a
    node or place.

    With a pose the route begins there, at the node `here`; without, at the node of the map frame that answered. Raises
    DataError, UnknownName on a goal that is not on the map, NoRoute where none leads there or the frame is not
    localized.
    """
    localizer, topology = read_map(Path(directory), _read_both)
    answer = localizer.localize(frame)
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
        found = Whereabouts(answer, near.end, near.length_m, pose_yaw(answer.T_world_query))
        start = HERE
    else:
        found = Whereabouts(answer, start)
    if goal is None:
        return found
    if start is None:
        raise NoRoute(
            f"no route from {frame.id} to {goal}: "
            f"{frame.id} was not localized at a node of the map (status {answer.status})"
        )
    return replace(found, route=find_route(topology, start, goal, planner))


def _read_both(parts: Path) -> tuple[Localizer, TopologicalMap]:
    topology = read_topology(parts)
    return read_localizer(parts), topology
