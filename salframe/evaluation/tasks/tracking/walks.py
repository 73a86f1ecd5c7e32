"""Random walks of a camera through a building, and the views that it takes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from salframe.framework.errors import DataError, NoRoute
from salframe.framework.files.hashes import digest
from salframe.navigation.episodes import Site
from salframe.navigation.guide import REACHED_M
from salframe.navigation.world import World
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_yaw, wrap_angle
from salframe.panoramas.panorama import Panorama
from salframe.topology.topological_map import MapEdge, NodeKind

NUM_VIEWS = 12
"""Number of views of a walk."""
STEP_M = 0.5
"""Maximum distance in metres between two successive views of a walk."""
TRIES = 1000
"""Number of random starts and goals that are tried for a walk."""


@dataclass(frozen=True, eq=False)
class Walk:
    """A walk of a camera through at least two regions. The camera looks ahead.

    Attributes:
        id: Id of the walk. The simulated errors of an object are the same in all views of a walk.
        number: Number of the walk in its data set.
        world: Id of the world.
        poses: T_world_pano (4, 4) of each view.
        places: Region of each view, "" between regions.
    """

    id: str
    number: int
    world: str
    poses: tuple[np.ndarray, ...]
    places: tuple[str, ...]

    def views(self, world: World, content: str) -> Iterator[QueryFrame]:
        """Yield the views.

        Args:
            world: The world of the walk.
            content: Cache key of the data set.
        """
        for number, pose in enumerate(self.poses):

            def load(pose: np.ndarray = pose) -> Panorama:
                return _with_errors_of(self.id, world.observe(pose))

            yield QueryFrame(f"{self.id}/{number}", load, digest([content, self.id, pose.tolist()]))


def _with_errors_of(walk: str, panorama: Panorama) -> Panorama:
    """Return a panorama whose objects get the same simulated detection errors in all panoramas of a walk."""
    if panorama.annotations is None:
        return panorama
    return replace(panorama, annotations=replace(panorama.annotations, error_id=walk))


def draw_walk(site: Site, number: int, seed: int) -> Walk:
    """Generate a walk from a random pose towards a random scene node of another region, along the shortest path.

    Raises:
        DataError: The world allows no walk.
    """
    world = site.world
    rng = np.random.default_rng([seed, 5, number])
    for _ in range(TRIES):
        poses = _try_walk(site, rng)
        places = tuple(world.region(pose) for pose in poses)
        if len(poses) == NUM_VIEWS and len({*places} - {""}) > 1:
            return Walk(f"{world.id}-walk-{number}", number, world.id, tuple(poses), places)
    raise DataError(
        f"no camera path (walk) fits into the building {world.id}, expected enough free space for a path of "
        f"{(NUM_VIEWS - 1) * STEP_M:g} m through at least two rooms"
    )


def _try_walk(site: Site, rng: np.random.Generator) -> list[np.ndarray]:
    """Return the poses of the views of a walk; fewer than NUM_VIEWS if an obstacle stops it, or it reaches its goal."""
    world, guide = site
    pose = world.draw_start(rng)
    nodes, start = world.chart.map.nodes, world.region(pose)
    goals = [node.id for node in nodes if node.kind is NodeKind.SCENE and start not in node.regions]
    if not goals:
        return [pose]
    poses, goal = [pose], goals[rng.integers(len(goals))]
    while len(poses) < NUM_VIEWS:
        try:
            leg = guide.with_margin.shortest_path(pose[:3, 3], goal).leg(pose[:3, 3])
        except NoRoute:
            break
        if isinstance(leg, MapEdge):
            pose, is_stopped = world.take_stairs(pose, leg)
        else:
            length_m = float(np.linalg.norm(leg))
            if length_m <= REACHED_M:
                break
            turn_rad = float(wrap_angle(np.arctan2(leg[1], leg[0]) - pose_yaw(pose)))
            pose, is_stopped = world.move(pose, turn_rad, min(STEP_M, length_m))
        if is_stopped:
            break
        poses.append(pose)
    return poses
