"""Two generated buildings as the storeys of one folder: `python -m training.floors.storeys house-42`.

The command writes the panoramas of two buildings of a preset, one 3 m above the other, as one folder without floor
masks. It builds a map of the folder and connects the storeys by stairs. It prints the number of correct routes between
the storeys, the accuracy of localization per storey, and the success rate of navigation from one storey to the other.
The page docs/how-to/floors.md reports the results.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from salframe_house.rendering import buildings_of

from salframe.framework.errors import NoRoute
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.preparing import prepare
from salframe.navigation.episodes import Episode, Site
from salframe.navigation.guide import Guide
from salframe.navigation.sight import Sight
from salframe.navigation.walk import NavigationConfig, walk
from salframe.navigation.world import FloorWorld
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder_format import FrameEntry, TruthEntry, write_manifest, write_objects, write_panorama
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.opening import find_dataset, reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.topology.build import build_topology
from salframe.topology.building_map import build_map, by_place
from salframe.topology.connections import connect_storeys
from salframe.topology.routes import directions, find_route
from salframe.topology.store import connect_map, open_topology
from salframe.topology.topological_map import Connection, EdgeKind, NodeKind, TopologicalMap
from training.floors.measure import on_grid

STOREY_M = 3.0
"""Height of the second storey above the first one."""
STAIRS_M = 6.0
"""Length of the stairs."""
STAIRS_PLACE = "corridor-01"
"""Place of the stairs in each building."""
PREFIXES = "", "up-"
"""Prefix of the names of frames and places on each storey."""
MAX_INSTANCES = 1 << 15
"""Number of instance ids that a storey may have."""


@dataclass(frozen=True)
class Stack:
    """Two buildings, one above the other.

    Attributes:
        folder: The folder with the panoramas of both buildings.
        datasets: The buildings.
        storey_of: Storey of each query, 0 or 1.
    """

    folder: Path
    datasets: tuple[Dataset, ...]
    storey_of: dict[str, int]


def raise_pose(T_world_pano: np.ndarray, storey: int) -> np.ndarray:
    """Return a pose in a building, raised to the height of a storey of the stack (0 or 1)."""
    raised = np.array(T_world_pano)
    raised[2, 3] += storey * STOREY_M
    return raised


def stack_buildings(datasets: Sequence[Dataset], folder: Path) -> Stack:
    """Write the panoramas of two prepared datasets as one folder."""
    entries, truth, labels, storey_of = [], {}, {}, {}
    for storey, (prefix, dataset) in enumerate(zip(PREFIXES, datasets, strict=True)):
        for frame in reference_frames(dataset):
            role = "map" if frame.kind is FrameKind.SCENE else "transition"
            pose = tuple(raise_pose(frame.T_world_pano, storey).ravel().tolist())
            entry = {"id": prefix + frame.id, "role": role, "place": prefix + frame.place, "pose": pose}
            entries.append(_write(folder, entry, frame.load(), storey, labels))
        for query in dataset.folds()[0].queries:
            answer = dataset.truth(query.id)
            pose = tuple(raise_pose(answer.T_world_pano, storey).ravel().tolist())
            truth[prefix + query.id] = TruthEntry(place=prefix + answer.place, pose=pose)
            storey_of[prefix + query.id] = storey
            entry = {"id": prefix + query.id, "role": "query"}
            entries.append(_write(folder, entry, query.load(), storey, labels))
    write_objects(folder / "objects.parquet", {"instance_id": list(labels), "label": list(labels.values())})
    write_manifest(folder, entries, truth, objects="objects.parquet", rendered=True)
    return Stack(folder, tuple(datasets), storey_of)


def _write(folder: Path, entry: dict, panorama: Panorama, storey: int, labels: dict[int, str]) -> FrameEntry:
    """Write a panorama, add its labels, and return its entry."""
    files = {"range": f"{entry['id']}.range.png", "instances": f"{entry['id']}.instances.png"}
    written = FrameEntry(**entry, **files)
    annotations = panorama.annotations
    first = storey * MAX_INSTANCES
    ids = np.where(annotations.instance_id > 0, annotations.instance_id + first, 0)
    labels.update({number + first: label for number, label in annotations.labels.items()})
    write_panorama(folder, written, None, panorama.range_m, ids)
    return written


class StoreyWorld(FloorWorld):
    """A storey of a stack. The agent on it is localized in the map of the whole stack."""

    def __init__(
        self, storey: int, dataset: Dataset, floor: FloorMasks, stack: TopologicalMap, frames: Sequence[ReferenceFrame]
    ) -> None:
        prefix, other = PREFIXES[storey], PREFIXES[1 - storey]
        of_storey = [f for f in frames if f.id.startswith(prefix) and not (other and f.id.startswith(other))]
        actual = buildings_of(dataset.config)[1].floor_masks()
        super().__init__(f"storey-{storey + 1}", dataset, floor, of_storey, actual)
        self.chart.map = replace(self.chart.map, floors=stack.floors)
        self._storey, self._references = storey, frames

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        return super().observe(raise_pose(T_world_pano, -self._storey))


def measure_routes(
    topology: TopologicalMap, reference: TopologicalMap, count: int, seed: int
) -> tuple[int, list[float]]:
    """Draw routes from the lower to the upper storey. Return the number of routes that take the stairs, and the
    relative errors of the lengths of all routes that exist."""
    scenes = [node.id for node in reference.nodes if node.kind is NodeKind.SCENE]
    lower = [id for id in scenes if not id.startswith(PREFIXES[1])]
    upper = [id for id in scenes if id.startswith(PREFIXES[1])]
    rng, good, errors = np.random.default_rng(seed), 0, []
    for _ in range(count):
        start, goal = rng.choice(lower), rng.choice(upper)
        try:
            route = find_route(topology, start, goal)
        except NoRoute:
            continue
        good += [step.floor for step in directions(route) if step.kind is EdgeKind.STAIRS] == [2]
        errors.append(abs(route.length_m / find_route(reference, start, goal).length_m - 1))
    return good, errors


def localize_storeys(
    stack: Stack, localization: LocalizationMap, dataset: Dataset
) -> dict[int, list[tuple[bool, bool]]]:
    """Return for each storey whether the storey and the place of each answer are correct."""
    right = defaultdict(list)
    for query in dataset.folds()[0].queries:
        answer = localization.localize(query, warn=lambda line: None)
        storey, place = stack.storey_of[query.id], answer.places[0].place if answer.places else ""
        is_storey = bool(place) and place.startswith(PREFIXES[1]) == bool(storey)
        right[storey].append((is_storey, place == dataset.truth(query.id).place))
    return right


def walk_across(
    stack: Stack,
    localizer: Localizer,
    topology: TopologicalMap,
    frames: Sequence[ReferenceFrame],
    count: int,
    seed: int,
) -> list[bool]:
    """Return the success of episodes from the first storey to the second: walk to the stairs, take them, and walk to
    the goal. The localizer always searches the map of both storeys."""
    config = NavigationConfig()
    worlds = [
        StoreyWorld(storey, dataset, on_grid(floor, replace(dataset.floors()[0], z_m=floor.z_m)), topology, frames)
        for storey, (dataset, floor) in enumerate(zip(stack.datasets, topology.floors, strict=True))
    ]
    sites = [Site(world, Guide(world.chart, config.planner)) for world in worlds]
    (stairs,) = [edge for edge in topology.edges if edge.kind is EdgeKind.STAIRS]
    sight = Sight(localizer, "stack", positioning=True)
    rng, success = np.random.default_rng(seed), []
    goals = [node.id for node in worlds[1].chart.map.nodes if node.kind is NodeKind.SCENE and node.id != stairs.end]
    while len(success) < count:
        start, goal, yaw_rad = worlds[0].draw_start(rng), str(rng.choice(goals)), rng.uniform(-np.pi, np.pi)
        number = len(success)
        landing = worlds[1].stand_at(worlds[1].node(stairs.end), yaw_rad)
        legs = [(sites[0], start, stairs.start), (sites[1], landing, goal)]
        success.append(
            all(
                _walk(site, sight, Episode(number, site.world.id, tuple(pose.ravel()), end, 1.0), config, seed)
                for site, pose, end in legs
            )
        )
    return success


def _walk(site: Site, sight: Sight, episode: Episode, config: NavigationConfig, seed: int) -> bool:
    """Return whether an agent reaches the goal of an episode. False if its map has no path to the goal."""
    try:
        return bool(walk(site, partial(sight.look, site.world), episode, config, seed)["success"])
    except NoRoute:
        return False


def reference_topology(datasets: Sequence[Dataset], stairs: Connection) -> TopologicalMap:
    """Return the topology of the floor masks of both storeys, with the stairs."""
    floors, frames = [], []
    for storey, (prefix, dataset) in enumerate(zip(PREFIXES, datasets, strict=True)):
        (masks,) = dataset.floors()
        regions = {label: prefix + place for label, place in masks.regions.items()}
        floors.append(replace(masks, z_m=storey * STOREY_M, regions=regions))
        frames += [
            replace(
                frame,
                id=prefix + frame.id,
                place=prefix + frame.place,
                T_world_pano=raise_pose(frame.T_world_pano, storey),
            )
            for frame in reference_frames(dataset)
        ]
    return connect_storeys(build_topology(floors, by_place(frames)), [stairs])


@dataclass(frozen=True)
class StoreyResults:
    """Results on two storeys.

    Attributes:
        routes: Number of routes across the storeys that exist and take the stairs.
        errors: Errors of the lengths of routes, relative to the lengths by the floor masks.
        localized: For each storey, whether the storey and the place of each answer are correct.
        walked: Success of each episode from one storey to the other.
    """

    routes: int
    errors: list[float]
    localized: dict[int, list[tuple[bool, bool]]]
    walked: list[bool]


def measure(data: str, seeds: Sequence[int], folder: Path, routes: int, episodes: int) -> StoreyResults:
    """Build the map of two buildings of a preset as storeys of one folder, and measure it."""
    prepared = [
        prepare(data, "proposed", None, ["data.rgb=false", f"data.seed={seed}"], None, None, print) for seed in seeds
    ]
    datasets = [dataset for _, dataset, _ in prepared]
    stack = stack_buildings(datasets, folder / "stack")
    build_map(stack.folder, folder / "map", "proposed", tell=print)
    start, end = (f"{prefix}{STAIRS_PLACE}" for prefix in PREFIXES)
    connect_map(folder / "map", [Connection(start=start, end=end, kind=EdgeKind.STAIRS, length_m=STAIRS_M)])
    topology = open_topology(folder / "map")
    (edge,) = [edge for edge in topology.edges if edge.kind is EdgeKind.STAIRS]
    stairs = Connection(start=edge.start, end=edge.end, kind=EdgeKind.STAIRS, length_m=STAIRS_M)
    good, errors = measure_routes(topology, reference_topology(datasets, stairs), routes, 0)
    localization = LocalizationMap.open(folder / "map")
    stacked = find_dataset(stack.folder)
    localized = localize_storeys(stack, localization, stacked)
    walked = walk_across(stack, localization.localizer, topology, reference_frames(stacked), episodes, 0)
    return StoreyResults(good, errors, localized, walked)


def main(
    data: Annotated[str, typer.Argument(help="Preset of the dataset house")],
    seeds: Annotated[str, typer.Option(help="Seeds of the two buildings, separated by a comma")] = "200,201",
    episodes: Annotated[int, typer.Option(help="Number of episodes of navigation")] = 24,
    routes: Annotated[int, typer.Option(help="Number of routes")] = 500,
) -> None:
    """Build and measure the map of two storeys."""
    with TemporaryDirectory() as folder:
        results = measure(data, [int(seed) for seed in seeds.split(",")], Path(folder), routes, episodes)
    print(f"routes across: {results.routes} of {routes}, median error of length {np.median(results.errors):.2%}")
    for storey, right in sorted(results.localized.items()):
        is_storey, is_place = np.array(right).T
        print(
            f"storey {storey + 1}: storey {is_storey.mean():.1%}, place {is_place.mean():.1%} of {len(right)} queries"
        )
    print(f"navigation across: {sum(results.walked)} of {len(results.walked)}")


if __name__ == "__main__":
    typer.run(main)
