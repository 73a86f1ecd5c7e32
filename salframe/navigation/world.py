"""Simulated worlds: the panorama at each true pose of an agent, and the effects of its moves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import DataError, InputMissing, UnknownName, unknown
from salframe.navigation.chart import Chart, FloorChart
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks, find_floor
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.topology.build import build_topology
from salframe.topology.grid import FloorGrid, cell
from salframe.topology.topological_map import MapNode, TopologySettings

_PACE_M = 0.01
"""Step in metres at which a walk is tested for collisions."""


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
            raise UnknownName(f"{self.id}: {unknown('node', name, list(self._nodes))}")
        return self._nodes[name]

    @abstractmethod
    def stand_at(self, node: MapNode, yaw_rad: float) -> np.ndarray:
        """Return the pose of an agent at a node.

        Raises:
            DataError: An agent does not fit there.
        """

    @abstractmethod
    def stand(self, x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
        """Return the pose of an agent at a position and heading in the world frame.

        Raises:
            DataError: An agent does not fit there.
        """

    def joined(self, start: np.ndarray, goal: np.ndarray) -> bool:
        """Return whether there is a walkable path between two poses (4, 4). The default returns True."""
        return True

    @abstractmethod
    def draw_start(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random pose of an agent in a region, uniform over position and heading.

        Raises:
            DataError: An agent fits nowhere in a region.
        """

    @abstractmethod
    def region(self, T_world_pano: np.ndarray) -> str:
        """Return the name of the region at a pose; "" if there is no region."""

    @abstractmethod
    def references(self, T_world_pano: np.ndarray) -> Sequence[ReferenceFrame]:
        """Return the reference frames of the map in which a panorama at this pose is localized."""

    @abstractmethod
    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """Return the panorama at a pose."""

    @abstractmethod
    def move(self, T_world_pano: np.ndarray, turn_rad: float, length_m: float) -> tuple[np.ndarray, bool]:
        """Return the pose (4, 4) after an agent turned and then walked straight ahead, and whether an obstacle stopped
        it."""


class FloorWorld(World):
    """A floor of a dataset that can render panoramas.

    The agent is a disc with the robot radius of the map. It walks on clear floor. Walls and obstacles stop it.

    Args:
        id: Id of the world.
        dataset: The dataset that renders panoramas.
        floor: The masks that the chart is built from.
        frames: The reference frames on the floor, from which the chart is also built.
        actual: The masks whose walls and obstacles stop the agent. They show the building as rendered by `observe`,
            which may have changed after it was mapped.
    """

    def __init__(
        self, id: str, dataset: Dataset, floor: FloorMasks, frames: Sequence[ReferenceFrame], actual: FloorMasks
    ) -> None:
        from scipy import ndimage

        settings = TopologySettings()
        self._grid = FloorGrid(floor, settings.robot_radius_m)
        super().__init__(id, FloorChart(build_topology([floor], frames, settings), self._grid, settings.robot_radius_m))
        self._dataset, self._radius_m = dataset, settings.robot_radius_m
        self._references = reference_frames(dataset)
        self._camera_z_m = float(np.median([frame.T_world_pano[2, 3] for frame in frames]))
        self._names = self._grid.names
        self._free = FloorGrid(actual, settings.robot_radius_m).clear
        self._parts = ndimage.label(self._free)[0]

    def stand_at(self, node: MapNode, yaw_rad: float) -> np.ndarray:
        x_m, y_m, _ = node.xyz_m
        return self.stand(x_m, y_m, yaw_rad)

    def stand(self, x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
        if not self._is_free(np.array([[x_m, y_m]])).all():
            raise DataError(
                f"{self.id}: ({x_m:.2f}, {y_m:.2f}) m is in a wall or obstacle, "
                f"or less than {self._radius_m:g} m from one, expected free floor"
            )
        return pose_2d(x_m, y_m, yaw_rad, self._camera_z_m)

    def joined(self, start: np.ndarray, goal: np.ndarray) -> bool:
        first, last = (self._parts[cell(self._grid.to_pixel(pose[:2, 3]))] for pose in (start, goal))
        return bool(first == last)

    def draw_start(self, rng: np.random.Generator) -> np.ndarray:
        pixels = np.argwhere(self._free & self._grid.clear & (self._grid.label > 0))
        if not len(pixels):
            raise DataError(
                f"{self.id} has no free floor in any region, expected free floor for the start of an episode"
            )
        x_m, y_m = self._grid.to_metres(rng.choice(pixels) + 0.5)
        return pose_2d(x_m, y_m, rng.uniform(-np.pi, np.pi), self._camera_z_m)

    def region(self, T_world_pano: np.ndarray) -> str:
        return self._names.get(int(self._grid.label[cell(self._grid.to_pixel(T_world_pano[:2, 3]))]), "")

    def references(self, T_world_pano: np.ndarray) -> Sequence[ReferenceFrame]:
        return self._references

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        return self._dataset.observe(T_world_pano)

    def move(self, T_world_pano: np.ndarray, turn_rad: float, length_m: float) -> tuple[np.ndarray, bool]:
        yaw_rad = pose_yaw(T_world_pano) + turn_rad
        paces = np.linspace(0, length_m, int(np.ceil(length_m / _PACE_M)) + 1)
        line = T_world_pano[:2, 3] + paces[:, None] * (np.cos(yaw_rad), np.sin(yaw_rad))
        free = self._is_free(line[1:])
        steps = len(free) if free.all() else int(free.argmin())
        x_m, y_m = line[steps]
        return pose_2d(x_m, y_m, yaw_rad, T_world_pano[2, 3]), steps < len(free)

    def _is_free(self, xy_m: np.ndarray) -> np.ndarray:
        """Return whether the agent fits at positions (N, 2), (N,) bool."""
        pixel = np.floor(self._grid.to_pixel(xy_m)).astype(int)
        inside = ((pixel >= 0) & (pixel < self._free.shape)).all(1)
        row, column = np.where(inside[:, None], pixel, 0).T
        return inside & self._free[row, column]


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
        raise InputMissing(f"the dataset {dataset.name} cannot render panoramas at new poses, which navigation needs")
    return floor_worlds(dataset)


def floor_worlds(dataset: Dataset, actual: Sequence[FloorMasks] | None = None) -> list[FloorWorld]:
    """Return a world for each floor of a dataset that can render.

    Args:
        dataset: The dataset.
        actual: As in FloorWorld, in the order of `dataset.floors()`; None: the masks of the dataset.

    Raises:
        DataError: The dataset has no floor, or a floor has no reference frame.
    """
    floors = dataset.floors()
    if not floors:
        raise DataError(f"the dataset {dataset.name} has no floor masks, which navigation needs to detect collisions")
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
            f"the dataset {dataset.name} has no reference frame on its floor at z = {without_frames[0]:g} m, "
            "expected at least one"
        )
    names = ["floor" if len(floors) == 1 else f"floor-{number}" for number in range(len(floors))]
    return [
        FloorWorld(id=name, dataset=dataset, floor=floor, frames=frames, actual=masks)
        for name, floor, frames, masks in zip(names, floors, frames_by_floor, actual or floors, strict=True)
    ]
