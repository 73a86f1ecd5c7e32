"""Compare derived floors with floor masks: `python -m training.floors.measure house-42 --seeds 200,201,202`.

The data is a preset of the dataset `house`. For each seed the command derives floors from the reference frames. It
prints the number of doorways that derived floors and floor masks have in common, the errors of the lengths of routes,
and the adjusted Rand index of regions that are derived without the places of frames. `--localize` adds the accuracy of
localization, and `--episodes N` the success rate of navigation with N episodes per seed. The page
docs/how-to/floors.md reports the results.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np
import typer
from salframe_house.rendering import floors_of

from salframe.evaluation.statistics import Estimate, estimate_proportion
from salframe.framework.errors import SalframeError
from salframe.framework.files.cache import Cache
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.preparing import prepare
from salframe.navigation.agent_localizer import AgentLocalizer
from salframe.navigation.episodes import Episode, Site, draw_episodes
from salframe.navigation.guide import Guide
from salframe.navigation.walk import SUCCESS_M, EpisodeStatus, NavigationConfig, walk
from salframe.navigation.world import FloorWorld, open_worlds
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks, Regions, find_floor, floor_pixels
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.opening import reference_frames
from salframe.topology.build import build_topology
from salframe.topology.building_map import by_place
from salframe.topology.derived_floors import FloorPlan, derive_floors
from training.floors.measures import adjusted_rand_index, compare_topologies

SCORES = "floor masks", "derived floors", "derived regions"
"""Maps to compare: with floor masks; with derived floors and the true places; with derived regions as places."""


def on_grid(floor: FloorMasks, like: FloorMasks) -> FloorMasks:
    """Return the floor masks `floor` on the pixel grid of `like`, which has the same resolution.

    Pixels outside the grid are cut off.
    """
    row, column = floor_pixels(like, np.array([floor.origin_m]) + np.array([1e-6, -1e-6]))[0].tolist()
    masks = []
    for mask in (floor.free, floor.region, floor.obstacle):
        whole = np.zeros(like.free.shape, mask.dtype)
        rows, columns = (
            range(max(0, -at), min(size, total - at))
            for at, size, total in zip((row, column), mask.shape, whole.shape, strict=True)
        )
        part = mask[rows.start : rows.stop, columns.start : columns.stop]
        whole[row + rows.start : row + rows.stop, column + columns.start : column + columns.stop] = part
        masks.append(whole)
    free, region, obstacle = masks
    return FloorMasks(free, region, obstacle, like.resolution_m, like.origin_m, floor.regions, floor.z_m)


def region_agreement(masks: FloorMasks, derived: FloorMasks) -> float:
    """Return the adjusted Rand index of the regions on the pixels that have a region in both floor masks."""
    derived = on_grid(derived, masks)
    both = (masks.region > 0) & (derived.region > 0)
    return adjusted_rand_index(masks.region[both], derived.region[both])


def localize_all(
    dataset: Dataset, localizer: Localizer, frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]
) -> Iterator[bool]:
    """Yield for each query whether the first place of the answer is the place of the true position."""
    built = LocalizationMap.build(localizer, frames, Cache(), dataset.content_key, floors=floors)
    regions = Regions(floors)
    for query in dataset.folds()[0].queries:
        truth = dataset.truth(query.id).T_world_pano
        if truth is None:
            continue
        answer = built.localize(query, warn=lambda line: None)
        number = int(regions.at(truth[None, :2, 3], truth[None, 2, 3])[0])
        yield bool(answer.places) and answer.places[0].place == regions.places[number]


def walk_all(
    dataset: Dataset,
    localizer: Localizer,
    world: FloorWorld,
    derived_world: FloorWorld,
    count: int,
    seed: int,
    across: bool = False,
) -> dict[str, list[bool]]:
    """Return whether an agent succeeds in each of `count` random episodes, in two worlds.

    The result has the key "floor masks" for `world`, and the key "derived floors" for `derived_world`. The episodes
    are the same in both worlds.

    Success depends on the distance to the goal along the floor masks. With `across`, each episode starts and ends on
    different storeys.
    """
    config = NavigationConfig()
    site, derived_site = (Site(one, Guide(one.chart, config.planner)) for one in (world, derived_world))
    episodes, _ = draw_episodes({world.id: site}, 10 * count if across else count, seed)
    if across:
        episodes = [one for one in episodes if not _is_on_one_floor(world, one)][:count]
    success = {}
    for name, agent_site in (("floor masks", site), ("derived floors", derived_site)):
        agent_localizer = AgentLocalizer(localizer, dataset.content_key, positioning=True)
        success[name] = [_walk(agent_site, site.guide, agent_localizer, episode, config, seed) for episode in episodes]
    return success


def _is_on_one_floor(world: FloorWorld, episode: Episode) -> bool:
    start_m, goal_m = np.array(episode.start).reshape(4, 4)[:3, 3], np.array(world.node(episode.goal).xyz_m)
    floors = world.chart.map.floors
    return find_floor(floors, start_m) == find_floor(floors, goal_m)


def _walk(
    site: Site, guide: Guide, localizer: AgentLocalizer, episode: Episode, config: NavigationConfig, seed: int
) -> bool:
    """Return whether an agent reaches the goal of an episode. False if its map does not have the goal."""
    try:
        row = walk(site, partial(localizer.localize, site.world), episode, config, seed)
        end_m = np.array(row["path"][-1][:3])
        return row["status"] is EpisodeStatus.ARRIVED and guide.shortest_path(end_m, episode.goal).length_m <= SUCCESS_M
    except SalframeError as error:
        print(f"  episode {episode.number} fails: {error}")
        return False


def main(
    data: Annotated[str, typer.Argument(help="Preset of the dataset house")],
    seeds: Annotated[str, typer.Option(help="Seeds of the buildings, separated by commas")] = "200,201,202",
    without_transition_frames: Annotated[bool, typer.Option(help="Leave out the frames in doorways")] = False,
    localize: Annotated[bool, typer.Option(help="Measure the accuracy of localization")] = False,
    episodes: Annotated[int, typer.Option(help="Number of episodes of navigation per seed")] = 0,
) -> None:
    """Compare floors that are derived from panoramas with the floor masks of generated buildings."""
    doors = np.zeros(3, int)
    errors, lost, agreements = [], 0, []
    scores: dict[str, dict[str, list[bool]]] = {kind: defaultdict(list) for kind in ("localization", "navigation")}
    clusters: dict[str, list[str]] = defaultdict(list)
    for seed in seeds.split(","):
        _, dataset, localizer = prepare(
            data, "proposed", None, ["data.rgb=false", f"data.seed={seed}"], None, None, print
        )
        frames = reference_frames(dataset)
        used = [frame for frame in frames if frame.kind is FrameKind.SCENE or not without_transition_frames]
        (masks,) = dataset.floors()
        plan = derive_floors(used)
        split = derive_floors([replace(frame, place=frame.id) for frame in used])
        from_masks = build_topology([masks], by_place(frames))
        compared = compare_topologies(from_masks, build_topology(plan.floors, by_place(used)))
        doors += (compared.mask_doorways, compared.derived_doorways, compared.common_doorways)
        errors.append(compared.route_errors)
        lost += compared.lost_routes + compared.false_routes
        agreements.append(region_agreement(masks, split.floors[0]))
        print(
            f"{data} seed {seed}: {compared.mask_doorways} doorways in the floor masks, {compared.derived_doorways} in "
            f"the derived floors, {compared.common_doorways} in both; median error of the route lengths "
            f"{np.median(compared.route_errors):.2%} ({len(compared.route_errors)} routes), {compared.lost_routes} "
            f"lost routes (only in the floor masks), {compared.false_routes} false routes (only in the derived "
            f"floors); {len(masks.regions)} rooms, "
            f"{len(split.floors[0].regions)} derived regions, adjusted Rand index {agreements[-1]:.3f}",
            flush=True,
        )
        if localize:
            plans = (FloorPlan((masks,), tuple(frames)), plan, split)
            for name, one in zip(SCORES, plans, strict=True):
                right = list(localize_all(dataset, localizer, one.frames, one.floors))
                scores["localization"][name] += right
            clusters["localization"] += [seed] * len(right)
            means = {name: np.mean(values) for name, values in scores["localization"].items()}
            print("  localization accuracy so far", means, flush=True)
        if episodes:
            (world,) = open_worlds(dataset)
            assert isinstance(world, FloorWorld)
            _, actual = floors_of(dataset.config)
            derived = FloorWorld(world.id, dataset, [on_grid(plan.floors[0], masks)], frames, actual)
            for name, success in walk_all(dataset, localizer, world, derived, episodes, 0).items():
                scores["navigation"][name] += success
            clusters["navigation"] += [seed] * len(success)
            means = {name: np.mean(values) for name, values in scores["navigation"].items()}
            print("  navigation success so far", means, flush=True)
    num_masks, num_derived, common = doors.tolist()
    print(
        f"{data}: {common} of {num_masks} doorways of the floor masks found, {num_derived - common} of "
        f"{num_derived} derived doorways false"
    )
    every = np.concatenate(errors)
    print(
        f"{data}: median error of the route lengths {np.median(every):.2%} ({len(every)} routes), {lost} lost or "
        "false routes"
    )
    print(f"{data}: adjusted Rand index {np.mean(agreements):.3f} (mean of {len(agreements)} buildings)")
    for kind, by_name in scores.items():
        for name, values in by_name.items():
            share = estimate_proportion(np.array(values), clusters[kind])
            print(f"{data}: {kind}, {name}: {_percent(share)}, n = {len(values)}")


def _percent(estimate: Estimate) -> str:
    return f"{estimate.value:.1%} ({estimate.low:.1%} to {estimate.high:.1%})"


if __name__ == "__main__":
    typer.run(main)
