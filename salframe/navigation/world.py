"""Simulated worlds: the panorama at each true pose of an agent, and the effects of its moves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import DataError, InputMissing, UnknownName, unknown
from salframe.navigation.chart import Chart, FloorChart, nearest_floor
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import Connection, FloorMasks, find_floor, floor_numbers
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.topology.build import build_topology
from salframe.topology.connections import connect_storeys
from salframe.topology.edges import components
from salframe.topology.grid import FloorGrid, cell, nearest_pixel
from salframe.topology.topological_map import MapEdge, MapNode, TopologySettings

_PACE_M = 0.01
"""Step in metres at which a walk is tested for collisions."""
STAIRS_M = 1.0
"""Maximum distance in metres from the start of stairs or of a lift at which an agent can take them."""


class World(ABC):
    """A building to navigate in.

    The pose T_world_pano (4, 4) of an agent is the pose of its panorama: upright, with the x axis ahead.

    Attributes:
        id: Id of the world.
        chart: The chart (knowledge of the building) that agents receive.
    """

    def __init__(self, id: str, chart: Chart) -> None:
        self.id = id
        self.chart = chart
        self._nodes = {node.id: node for node in chart.map.nodes}

    def node(self, name: str) -> MapNode:
        """Return a node of the map.

        Raises:
            UnknownName: There is no such node. The message suggests the most similar name.
        """
        if name not in self._nodes:
            raise UnknownName(f"building {self.id}: {unknown('node', name, list(self._nodes))}")
        return self._nodes[name]

    @abstractmethod
    def stand_at(self, node: MapNode, yaw_rad: float) -> np.ndarray:
        """Return T_world_pano (4, 4) of an agent that stands at a node.

        Raises:
            DataError: An agent does not fit there.
        """

    @abstractmethod
    def stand(self, x_m: float, y_m: float, yaw_rad: float, floor: int | None = None) -> np.ndarray:
        """Return T_world_pano (4, 4) of an agent that stands at a position and heading in the world frame.

        Args:
            x_m: Position in metres.
            y_m: Position in metres.
            yaw_rad: Heading in the world frame, in radians.
            floor: Number of the floor, from 1 for the lowest one; None: the only floor.

        Raises:
            DataError: An agent does not fit there, there is no such floor, or `floor` is None in a world of several
                floors.
        """

    def is_reachable(self, start: np.ndarray, goal: np.ndarray) -> bool:
        """Return whether there is a walkable path between two poses (4, 4). The default returns True."""
        return True

    @abstractmethod
    def draw_start(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random pose T_world_pano (4, 4) of an agent in a region (room), uniform over position and heading.

        Raises:
            DataError: No region has enough free space for an agent.
        """

    @abstractmethod
    def region(self, T_world_pano: np.ndarray) -> str:
        """Return the name of the region (room) at a pose (4, 4); "" if there is no region."""

    @abstractmethod
    def references(self, T_world_pano: np.ndarray) -> Sequence[ReferenceFrame]:
        """Return the reference frames of the map in which a panorama at this pose (4, 4) is localized."""

    @abstractmethod
    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """Return the panorama that a camera at a pose (4, 4) shows."""

    @abstractmethod
    def move(self, T_world_pano: np.ndarray, turn_rad: float, length_m: float) -> tuple[np.ndarray, bool]:
        """Return the pose (4, 4) after an agent turned and then walked straight ahead, and whether an obstacle stopped
        it."""

    def take_stairs(self, T_world_pano: np.ndarray, edge: MapEdge) -> tuple[np.ndarray, bool]:
        """Return the pose (4, 4) after an agent took stairs or a lift, and whether this was impossible because there
        are none at the pose. The default is for worlds whose maps have neither."""
        return T_world_pano, True


class FloorWorld(World):
    """Floors of a dataset that can render panoramas, connected by stairs and lifts.

    The agent is a disc with the robot radius of the map. It walks on clear floor. Walls and obstacles stop it.

    Args:
        id: Id of the world.
        dataset: The dataset that renders panoramas.
        floors: The masks that the chart is built from, sorted by height.
        frames: The reference frames on the floors, from which the chart is also built.
        actual: The masks whose walls and obstacles stop the agent, in the order of `floors`. They show the building as
            rendered by `observe`, which may have changed after it was mapped.
        connections: The stairs and lifts between the floors.
    """

    def __init__(
        self,
        id: str,
        dataset: Dataset,
        floors: Sequence[FloorMasks],
        frames: Sequence[ReferenceFrame],
        actual: Sequence[FloorMasks],
        connections: Sequence[Connection] = (),
    ) -> None:
        from scipy import ndimage

        settings = TopologySettings()
        self._floors = list(floors)
        grids = [FloorGrid(floor, settings.robot_radius_m) for floor in self._floors]
        topology = connect_storeys(build_topology(self._floors, frames, settings), connections)
        super().__init__(id, FloorChart(topology, grids, settings.robot_radius_m))
        self._dataset, self._radius_m, self._grids = dataset, settings.robot_radius_m, grids
        self._references = reference_frames(dataset)
        cameras_m = np.array([frame.T_world_pano[:3, 3] for frame in frames])
        numbers = floor_numbers(self._floors, cameras_m)
        self._camera_z_m = [float(np.median(cameras_m[numbers == floor, 2])) for floor in range(len(floors))]
        self._names = [grid.names for grid in grids]
        self._free = [FloorGrid(masks, settings.robot_radius_m).clear for masks in actual]
        self._parts = [ndimage.label(free)[0] for free in self._free]

    def stand_at(self, node: MapNode, yaw_rad: float) -> np.ndarray:
        return self._stand(node.xyz_m[:2], yaw_rad, nearest_floor(self._floors, np.array(node.xyz_m)))

    def stand(self, x_m: float, y_m: float, yaw_rad: float, floor: int | None = None) -> np.ndarray:
        count = len(self._floors)
        if floor is None and count > 1:
            raise DataError(
                f"building {self.id} has {count} floors, but the start has no floor: set `floor` to a number from 1 to "
                f"{count}"
            )
        if floor is not None and not 1 <= floor <= count:
            raise DataError(f"building {self.id} has no floor {floor}, expected a number from 1 to {count}")
        return self._stand((x_m, y_m), yaw_rad, 0 if floor is None else floor - 1)

    def _stand(self, xy_m: Sequence[float], yaw_rad: float, number: int) -> np.ndarray:
        x_m, y_m = xy_m
        if not self._is_free(np.array([xy_m]), number).all():
            raise DataError(
                f"building {self.id}: the position ({x_m:.2f}, {y_m:.2f}) m is in a wall or obstacle, or less than "
                f"{self._radius_m:g} m from one, expected free floor"
            )
        return pose_2d(x_m, y_m, yaw_rad, self._camera_z_m[number])

    def is_reachable(self, start: np.ndarray, goal: np.ndarray) -> bool:
        stairs = [edge for edge in self.chart.map.edges if edge.storeys]
        ends = [[self._part(np.array(self.node(name).xyz_m)) for name in (edge.start, edge.end)] for edge in stairs]
        pairs = [pair for pair in ends if all(label for _, label in pair)]  # the label 0 stands for blocked pixels
        first, last = self._part(start[:3, 3]), self._part(goal[:3, 3])
        parts = sorted({first, last, *(part for pair in pairs for part in pair)})
        index = np.array([[parts.index(part) for part in pair] for pair in pairs], int).reshape(-1, 2)
        component = components(len(parts), index)
        return bool(component[parts.index(first)] == component[parts.index(last)])

    def _part(self, xyz_m: np.ndarray) -> tuple[int, int]:
        """Return the floor of a position and the connected part of its free pixels there."""
        number = nearest_floor(self._floors, xyz_m)
        return number, int(self._parts[number][cell(self._grids[number].to_pixel(xyz_m[:2]))])

    def draw_start(self, rng: np.random.Generator) -> np.ndarray:
        pixels = [
            np.argwhere(free & grid.clear & (grid.label > 0))
            for free, grid in zip(self._free, self._grids, strict=True)
        ]
        ends = np.cumsum([len(one) for one in pixels])
        if not ends[-1]:
            raise DataError(
                f"building {self.id} has no free floor in any room, expected free floor for the start of an episode"
            )
        drawn = int(rng.integers(ends[-1]))
        number = int(np.searchsorted(ends, drawn, "right"))
        x_m, y_m = self._grids[number].to_metres(np.concatenate(pixels)[drawn] + 0.5)
        return pose_2d(x_m, y_m, rng.uniform(-np.pi, np.pi), self._camera_z_m[number])

    def region(self, T_world_pano: np.ndarray) -> str:
        number = nearest_floor(self._floors, T_world_pano[:3, 3])
        grid = self._grids[number]
        return self._names[number].get(int(grid.label[cell(grid.to_pixel(T_world_pano[:2, 3]))]), "")

    def references(self, T_world_pano: np.ndarray) -> Sequence[ReferenceFrame]:
        return self._references

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        return self._dataset.observe(T_world_pano)

    def move(self, T_world_pano: np.ndarray, turn_rad: float, length_m: float) -> tuple[np.ndarray, bool]:
        yaw_rad = pose_yaw(T_world_pano) + turn_rad
        paces = np.linspace(0, length_m, int(np.ceil(length_m / _PACE_M)) + 1)
        line = T_world_pano[:2, 3] + paces[:, None] * (np.cos(yaw_rad), np.sin(yaw_rad))
        free = self._is_free(line[1:], nearest_floor(self._floors, T_world_pano[:3, 3]))
        steps = len(free) if free.all() else int(free.argmin())
        x_m, y_m = line[steps]
        return pose_2d(x_m, y_m, yaw_rad, T_world_pano[2, 3]), steps < len(free)

    def take_stairs(self, T_world_pano: np.ndarray, edge: MapEdge) -> tuple[np.ndarray, bool]:
        """Return the pose (4, 4) after an agent took stairs or a lift, and whether this was impossible. Stairs and
        lifts can be taken within STAIRS_M of the node at which they begin. They end at the node at their other end, or
        at the nearest free position if the node is blocked. The heading does not change."""
        start_m, end_m = (np.array(self.node(name).xyz_m) for name in (edge.start, edge.end))
        first, last = (nearest_floor(self._floors, point_m) for point_m in (start_m, end_m))
        if nearest_floor(self._floors, T_world_pano[:3, 3]) != first:
            return T_world_pano, True
        grid = self._grids[last]
        arrival = nearest_pixel(self._free[last], grid.to_pixel(end_m[:2]))
        arrival_m = end_m[:2] if arrival is None else grid.to_metres(arrival)
        is_near = np.linalg.norm(start_m[:2] - T_world_pano[:2, 3]) <= STAIRS_M
        if not is_near or arrival is None or np.linalg.norm(arrival_m - end_m[:2]) > STAIRS_M:
            return T_world_pano, True
        return self._stand(arrival_m.tolist(), pose_yaw(T_world_pano), last), False

    def _is_free(self, xy_m: np.ndarray, number: int) -> np.ndarray:
        """Return whether the agent fits at positions (N, 2) on a floor, (N,) bool."""
        free = self._free[number]
        pixel = np.floor(self._grids[number].to_pixel(xy_m)).astype(int)
        inside = ((pixel >= 0) & (pixel < free.shape)).all(1)
        row, column = np.where(inside[:, None], pixel, 0).T
        return inside & free[row, column]


class NavigableDataset(Dataset):
    """A dataset that defines its own worlds. For any other dataset that can render panoramas, each floor is a world."""

    @abstractmethod
    def worlds(self) -> Sequence[World]:
        """Return the worlds of the dataset, one for each building or floor."""


def open_worlds(dataset: Dataset) -> Sequence[World]:
    """Return the worlds of a dataset.

    Raises:
        InputMissing: The dataset cannot render panoramas.
    """
    if isinstance(dataset, NavigableDataset):
        return dataset.worlds()
    if type(dataset).observe is Dataset.observe:
        raise InputMissing(
            f"navigation needs panoramas at new poses, which the dataset {dataset.name} cannot render: choose another "
            "dataset, such as house-12"
        )
    return floor_worlds(dataset)


def floor_worlds(dataset: Dataset, actual: Sequence[FloorMasks] | None = None) -> list[FloorWorld]:
    """Return the worlds of a dataset that can render: one for each floor, or for the floors that stairs and lifts
    connect.

    Args:
        dataset: The dataset.
        actual: As in FloorWorld, in the order of `dataset.floors()`; None: the masks of the dataset.

    Raises:
        DataError: The dataset has no floor, a floor has no reference frame, or both ends of a connection are on one
            floor.
        UnknownName: An end of a connection does not exist.
    """
    floors, connections = dataset.floors(), dataset.connections()
    if not floors:
        raise DataError(
            "navigation needs floor masks (images of the free floor) to detect collisions, which the dataset "
            f"{dataset.name} does not have: choose another dataset, such as house-12"
        )
    order = sorted(range(len(floors)), key=lambda number: floors[number].z_m)
    by_height = [floors[number] for number in order]
    frames_by_floor: list[list[ReferenceFrame]] = [[] for _ in floors]
    for frame in reference_frames(dataset):
        place = find_floor(by_height, frame.T_world_pano[:3, 3])
        if place is not None:
            frames_by_floor[order[place]].append(frame)
    without_frames = [floor.z_m for floor, frames in zip(floors, frames_by_floor, strict=True) if not frames]
    if without_frames:
        raise DataError(
            f"the dataset {dataset.name} has no reference frame (panorama of the map) on its floor at "
            f"z = {without_frames[0]:g} m, expected at least one on each floor"
        )
    pairs = _connected_floors(by_height, frames_by_floor, connections)
    building = components(len(floors), np.array([(order[i], order[j]) for i, j in pairs], int).reshape(-1, 2))
    of_floor = [(order[floor], one) for one, (floor, _) in zip(connections, pairs, strict=True)]
    worlds = []
    for first in dict.fromkeys(building.tolist()):
        numbers = [number for number in order if building[number] == first]
        worlds.append(
            FloorWorld(
                id="floor" if len(numbers) == len(floors) else f"floor-{numbers[0]}",
                dataset=dataset,
                floors=[floors[number] for number in numbers],
                frames=[frame for number in numbers for frame in frames_by_floor[number]],
                actual=[(actual or floors)[number] for number in numbers],
                connections=[one for floor, one in of_floor if floor in numbers],
            )
        )
    return worlds


def _connected_floors(
    floors: Sequence[FloorMasks], frames: Sequence[Sequence[ReferenceFrame]], connections: Sequence[Connection]
) -> list[tuple[int, int]]:
    """Return for each connection the indices of the floors of its ends in `floors`, which are sorted by height. Raises
    UnknownName or DataError as `connect_storeys`."""
    if not connections:
        return []
    topology = build_topology(floors, [frame for on_floor in frames for frame in on_floor])
    connected = [connect_storeys(topology, [connection]) for connection in connections]
    edges = [edge for one in connected for edge in one.edges if edge.storeys]
    return [(edge.storeys[0] - 1, edge.storeys[1] - 1) for edge in edges]
