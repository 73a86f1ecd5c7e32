"""Navigation in real buildings: an agent stands at a viewpoint and moves to a neighbouring one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.navigation.chart import Chart
from salframe.navigation.world import World
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw, wrap_angle
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap
from salframe_matterport.readers import read_connectivity, read_viewpoints, read_ways
from salframe_matterport.scenes import ViewpointScene

View = Callable[[Panorama], Panorama]

TURN_OFF_RAD, LENGTH_OFF_M = np.radians(30.0), 1.0
"""Maximum differences in bearing and in length (m) between a move and the way to a neighbour. If no neighbour is within
both, the agent stays."""


class ViewpointChart(Chart):
    """Viewpoints of a building and their neighbours. The agent is always at a viewpoint."""

    max_move_m = np.inf
    aside_m = 2.0

    def __init__(self, map: TopologicalMap, camera_m: np.ndarray) -> None:
        """Create the chart of a viewpoint graph.

        Args:
            map: The viewpoint graph with N nodes.
            camera_m: (N, 3) camera positions of the nodes in metres.
        """
        self.map = map
        self._camera_m = camera_m
        self._node_m = np.array([node.xyz_m for node in map.nodes])
        number = {node.id: i for i, node in enumerate(map.nodes)}
        self.step_m = np.full((len(number), len(number)), np.inf)
        np.fill_diagonal(self.step_m, 0.0)
        for edge in map.edges:
            a, b = number[edge.start], number[edge.end]
            self.step_m[a, b] = self.step_m[b, a] = edge.length_m

    def nearest(self, position_m: np.ndarray) -> int:
        """Return the index of the viewpoint whose camera is nearest to a position (3,) in metres."""
        return int(np.linalg.norm(self._camera_m - position_m, axis=1).argmin())

    def spot(self, position_m: np.ndarray) -> np.ndarray:
        """See Chart. Return the camera position of the nearest viewpoint."""
        return self._camera_m[self.nearest(position_m)]

    def reach(self, position_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """See Chart. The position and each point are replaced by their nearest viewpoints. A straight walk is possible
        only to the same viewpoint (length 0) and to its neighbours."""
        points = np.linalg.norm(self._node_m - points_m[:, None], axis=2).argmin(1)
        return self.step_m[self.nearest(position_m), points]


class ViewpointWorld(World):
    """Viewpoint graph of a building.

    A panorama at a viewpoint has the annotations of this viewpoint. While the agent is at a viewpoint, the reference
    frame of this viewpoint is left out of the map.
    """

    def __init__(
        self,
        id: str,
        map: TopologicalMap,
        poses: Mapping[str, np.ndarray],
        scenes: Mapping[str, ViewpointScene],
        references: Sequence[ReferenceFrame],
        view: View,
    ) -> None:
        """Create the world of a building.

        Args:
            id: Name of the world.
            map: Viewpoint graph.
            poses: T_world_pano (4, 4) of the map's nodes, by node id, in the order of the nodes.
            scenes: Scenes by node id, for the nodes that have one.
            references: Reference frames of all scenes.
            view: Function that limits a panorama to the part that a query shows, such as a smaller field of view.
        """
        self._poses, self._scenes, self._frames = list(poses.values()), scenes, tuple(references)
        self._view = view
        self._viewpoints = ViewpointChart(map, np.array([pose[:3, 3] for pose in self._poses]))
        super().__init__(id, self._viewpoints)

    def stand_at(self, node: MapNode, yaw_rad: float) -> np.ndarray:
        return self._pose_at(self._viewpoints.map.nodes.index(node), yaw_rad)

    def stand(self, x_m: float, y_m: float, yaw_rad: float, floor: int | None = None) -> np.ndarray:
        raise DataError(
            f"building {self.id}: received the start ({x_m:.2f}, {y_m:.2f}) m, expected the id of a viewpoint, because "
            "panoramas exist only at viewpoints"
        )

    def draw_start(self, rng: np.random.Generator) -> np.ndarray:
        inside = [number for number, node in enumerate(self._viewpoints.map.nodes) if node.regions]
        if not inside:
            raise DataError(
                f"building {self.id} has no viewpoint in any region, expected at least one for the start of an episode"
            )
        return self._pose_at(int(rng.choice(inside)), rng.uniform(-np.pi, np.pi))

    def region(self, T_world_pano: np.ndarray) -> str:
        return next(iter(self._node(T_world_pano).regions), "")

    def references(self, T_world_pano: np.ndarray) -> Sequence[ReferenceFrame]:
        node_id = self._node(T_world_pano).id
        return [frame for frame in self._frames if frame.id != node_id]

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        node, yaw_rad = self._node(T_world_pano), pose_yaw(T_world_pano)
        scene = self._scenes.get(node.id)
        no_objects = Annotations(objects=ObjectBoxes.empty())
        annotations = no_objects if scene is None else scene.annotations(yaw_rad)
        return self._view(Panorama(f"{node.id} {np.degrees(yaw_rad):.3f}", annotations=annotations))

    def move(self, T_world_pano: np.ndarray, turn_rad: float, length_m: float) -> tuple[np.ndarray, bool]:
        """See World. Move to the neighbour that fits the move best, or only turn if no neighbour fits.

        A neighbour fits if its bearing differs from the bearing of the move by at most TURN_OFF_RAD, and its horizontal
        distance differs from the length of the move by at most LENGTH_OFF_M.
        """
        here, yaw_rad = self._viewpoints.nearest(T_world_pano[:3, 3]), pose_yaw(T_world_pano) + turn_rad
        walk_m = length_m * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        destination, min_misfit_m = here, np.inf
        for there in np.flatnonzero(np.isfinite(self._viewpoints.step_m[here])):
            way_m = self._poses[there][:2, 3] - self._poses[here][:2, 3]
            turn_off_rad = abs(float(wrap_angle(np.arctan2(way_m[1], way_m[0]) - yaw_rad)))
            misfit_m = float(np.linalg.norm(way_m - walk_m))
            length_off_m = abs(float(np.linalg.norm(way_m)) - length_m)
            if (
                there != here
                and turn_off_rad <= TURN_OFF_RAD
                and length_off_m <= LENGTH_OFF_M
                and misfit_m < min_misfit_m
            ):
                destination, min_misfit_m = int(there), misfit_m
        return self._pose_at(destination, yaw_rad), destination == here

    def _node(self, T_world_pano: np.ndarray) -> MapNode:
        return self._viewpoints.map.nodes[self._viewpoints.nearest(T_world_pano[:3, 3])]

    def _pose_at(self, number: int, yaw_rad: float) -> np.ndarray:
        x_m, y_m, z_m = self._poses[number][:3, 3]
        return pose_2d(x_m, y_m, yaw_rad, z_m)


def viewpoint_world(
    path: Path,
    scan: str,
    scenes: Sequence[ViewpointScene],
    references: Sequence[ReferenceFrame],
    regions: Mapping[str, int],
    view: View = lambda panorama: panorama,
) -> ViewpointWorld:
    """Build the world of a building.

    Two included viewpoints are neighbours if the way between them is unobstructed. The length of an edge is its 3D
    length. Nodes are on the floor below the cameras.

    Args:
        path: Connectivity file.
        scan: Building.
        scenes: Scenes of the building's viewpoints.
        references: Reference frames of the scenes.
        regions: Region index of each viewpoint.
        view: Function that limits a panorama to the part that a query shows.

    Raises:
        DataError: The file is missing or malformed.
    """
    poses = read_connectivity(path)
    free = read_ways(path)
    height_m = {
        viewpoint.image_id: viewpoint.height for viewpoint in read_viewpoints(path) if viewpoint.height is not None
    }
    if not poses.keys() <= height_m.keys():
        raise DataError(f"{path} has a viewpoint without the key 'height', expected the key in every viewpoint")
    name = {viewpoint: f"{scan}/{viewpoint}" for viewpoint in poses}
    scene_by_id = {scene.id: scene for scene in scenes}
    nodes = [
        MapNode(
            name[viewpoint],
            NodeKind.SCENE,
            (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3]) - height_m[viewpoint]),
            (f"{scan}/region-{regions[viewpoint]}",) if viewpoint in regions else (),
            (name[viewpoint],) if name[viewpoint] in scene_by_id else (),
        )
        for viewpoint, pose in poses.items()
    ]
    edges = []
    for a, b in combinations(poses, 2):
        if (a, b) in free or (b, a) in free:
            x, y, z = poses[b][:3, 3] - poses[a][:3, 3]
            edges.append(MapEdge(name[a], name[b], float(np.sqrt(x * x + y * y + z * z)), float(np.arctan2(y, x))))
    pose_by_id = {name[viewpoint]: pose for viewpoint, pose in poses.items()}
    return ViewpointWorld(scan, TopologicalMap(tuple(nodes), tuple(edges)), pose_by_id, scene_by_id, references, view)
