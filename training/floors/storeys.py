"""Measure a map of two storeys without floor masks: `python -m training.floors.storeys house-42`.

The data is a preset of the dataset `house` with two storeys. The command derives the floors of both storeys from their
panoramas, connects them by the stairs of the building, and prints the routes across the storeys, the accuracy of
localization on each storey, and the success rate of navigation from one storey to the other. The page
docs/how-to/floors.md reports the results.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from salframe_house.rendering import floors_of

from salframe.framework.errors import NoRoute
from salframe.framework.files.cache import Cache
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.preparing import prepare
from salframe.navigation.world import FloorWorld, open_worlds
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import find_floor
from salframe.panoramas.opening import reference_frames
from salframe.topology.build import build_topology
from salframe.topology.building_map import by_place
from salframe.topology.connections import connect_storeys
from salframe.topology.derived_floors import FloorPlan, derive_floors
from salframe.topology.routes import directions, find_route
from salframe.topology.topological_map import EdgeKind, NodeKind, TopologicalMap
from training.floors.measure import on_grid, walk_all


@dataclass(frozen=True)
class StoreyResults:
    """Results on two storeys.

    Attributes:
        routes: Number of routes from one storey to the other that were found and use the stairs.
        errors: Relative errors of the lengths of these routes, compared with routes planned on the floor masks.
        localized: For each storey, whether the storey and the place of each answer are right.
        walked: Success of each episode from one storey to the other, with the "floor masks" and with the "derived
            floors".
    """

    routes: int
    errors: list[float]
    localized: dict[int, list[tuple[bool, bool]]]
    walked: dict[str, list[bool]]


def measure_routes(
    topology: TopologicalMap, reference: TopologicalMap, count: int, seed: int
) -> tuple[int, list[float]]:
    """Return the number of random routes from one storey to the other that were found and use the stairs, and the
    relative errors of their lengths."""
    scenes = [node for node in reference.nodes if node.kind is NodeKind.SCENE]
    lower, upper = (
        [node.id for node in scenes if find_floor(reference.floors, np.array(node.xyz_m)) == floor] for floor in (0, 1)
    )
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


def localize_storeys(dataset: Dataset, localizer: Localizer, plan: FloorPlan) -> dict[int, list[tuple[bool, bool]]]:
    """Return for the queries of each storey whether their answers name the correct storey and the correct place."""
    built = LocalizationMap.build(localizer, plan.frames, Cache(), dataset.content_key, floors=plan.floors)
    storey_of = {frame.place: find_floor(plan.floors, frame.T_world_pano[:3, 3]) for frame in plan.frames}
    right = defaultdict(list)
    for query in dataset.folds()[0].queries:
        answer, truth = built.localize(query, warn=lambda line: None), dataset.truth(query.id)
        place, storey = answer.places[0].place if answer.places else "", storey_of[truth.place]
        right[storey].append((storey_of.get(place) == storey, place == truth.place))
    return right


def measure(data: str, seed: int, routes: int, episodes: int) -> StoreyResults:
    """Derive the floors of a building of two storeys, and measure its map."""
    overrides = ["data.rgb=false", "data.storeys=2", f"data.seed={seed}"]
    _, dataset, localizer = prepare(data, "proposed", None, overrides, None, None, print)
    frames, floors, stairs = reference_frames(dataset), dataset.floors(), dataset.connections()
    plan = derive_floors(frames)
    topology = connect_storeys(build_topology(plan.floors, by_place(plan.frames)), stairs)
    reference = connect_storeys(build_topology(floors, by_place(frames)), stairs)
    good, errors = measure_routes(topology, reference, routes, 0)
    localized = localize_storeys(dataset, localizer, plan)
    (world,) = open_worlds(dataset)
    if not isinstance(world, FloorWorld):
        raise TypeError(
            f"the dataset has a building of the type {type(world).__name__}, expected FloorWorld (with floor masks)"
        )
    on_masks = [on_grid(floor, masks) for floor, masks in zip(plan.floors, floors, strict=True)]
    derived = FloorWorld(world.id, dataset, on_masks, frames, floors_of(dataset.config)[1], stairs)
    walked = walk_all(dataset, localizer, world, derived, episodes, 0, across=True)
    return StoreyResults(good, errors, localized, walked)


def main(
    data: Annotated[str, typer.Argument(help="Preset of the dataset house")],
    seed: Annotated[int, typer.Option(help="Seed of the lower storey")] = 200,
    episodes: Annotated[int, typer.Option(help="Number of episodes of navigation")] = 24,
    routes: Annotated[int, typer.Option(help="Number of routes")] = 500,
) -> None:
    """Derive and measure the map of two storeys."""
    results = measure(data, seed, routes, episodes)
    print(
        f"routes across the storeys: {results.routes} of {routes} take the stairs, median error of the route lengths "
        f"{np.median(results.errors):.2%}"
    )
    for storey, right in sorted(results.localized.items()):
        is_storey, is_place = np.array(right).T
        print(
            f"queries on storey {storey + 1}: storey correct {is_storey.mean():.1%}, place correct "
            f"{is_place.mean():.1%} ({len(right)} queries)"
        )
    for name, success in results.walked.items():
        print(f"navigation between storeys, {name}: {sum(success)} of {len(success)} episodes successful")


if __name__ == "__main__":
    typer.run(main)
