"""Where an agent really stands, what it sees there, and where its walks end."""

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


class World(ABC):
    """A building to navigate in: its `id`, the `chart` that an agent is given of it, and what happens to an agent in
    it.

    An agent's pose T_world_pano (4, 4) is that of its panorama: upright, looking along its x axis.
    """

    def __init__(self, id: str, chart: Chart) -> None:
        self.id = id
        self.chart = chart
        self._nodes = {node.id: node for node in chart.map.nodes}

    def node(self, name: str) -> MapNode:
        """A node of the map. Raises UnknownName with the closest one."""
        if name not in self._nodes:
            raise UnknownName(f"{self.id}: {unknown('node', name, list(self._nodes))}")
        return self._nodes[name]

    @abstractmethod
    def stand_at(self, node: MapNode, yaw_rad: float) -> np.ndarray:
        """The pose of an agent at a node. Raises DataError where none can stand there."""

    @abstractmethod
    def stand(self, x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
        """The pose of an agent at this place. Raises DataError where none can stand there."""

    def joined(self, start: np.ndarray, goal: np.ndarray) -> bool:
        """Whether an agent could walk from one pose to another, if it knew all."""
        return True

    @abstractmethod
    def draw_start(self, rng: np.random.Generator) -> np.ndarray:
        """The pose of an agent somewhere in a region, uniform over place and heading."""

    @abstractmethod
    def region(self, T_world_pano: np.ndarray) -> str:
        """The region that an agent stands in, "" where it stands in none."""

    @abstractmethod
    def references(self, T_world_pano: np.ndarray) -> Sequence[ReferenceFrame]:
        """The map's frames that a panorama taken at this pose is compared with."""

    @abstractmethod
    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """What an agent sees."""

    @abstractmethod
    def move(self, T_world_pano: np.ndarray, turn_rad: float, length_m: float) -> tuple[np.ndarray, bool]:
        """The pose of an agent that has turned, then walked straight ahead, and whether something stopped it."""


class FloorWorld(World):
    """A floor of a data set that can render: a disc of the map's robot radius walks on its clear floor, and walls stop
    it.

    The chart is made from the masks `floor` and the reference frames taken on it. What stops the agent are the masks
    `actual`: those of the building that `observe` shows, which may have changed since it was mapped.
    """

    def __init__(
        self, id: str, dataset: Dataset, floor: FloorMasks, frames: Sequence[ReferenceFrame], actual: FloorMasks
    ) -> None:
        from scipy import ndimage

        settings = TopologySettings()
        self._grid = FloorGrid(floor, settings.robot_radius_m)
        super().__init__(id, FloorChart(build_topology([floor], frames, settings), self._grid, settings.robot_radius_m))
        self._dataset, self._radius_m = dataset, settings.robot_radius_m
        self._mapping = reference_frames(dataset)
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
        x_m, y_m = self._grid.to_metres(
            rng.choice(np.argwhere(self._free & self._grid.clear & (self._grid.label > 0))) + 0.5
        )
        return pose_2d(x_m, y_m, rng.uniform(-np.pi, np.pi), self._camera_z_m)

    def region(self, T_world_pano: np.ndarray) -> str:
        return self._names.get(int(self._grid.label[cell(self._grid.to_pixel(T_world_pano[:2, 3]))]), "")

    def references(self, T_world_pano: np.ndarray) -> Sequence[ReferenceFrame]:
        return self._mapping

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        return self._dataset.observe(T_world_pano)

    def move(self, T_world_pano: np.ndarray, turn_rad: float, length_m: float) -> tuple[np.ndarray, bool]:
        yaw_rad = pose_yaw(T_world_pano) + turn_rad
        paces = np.linspace(0, length_m, int(np.ceil(length_m / _PACE_M)) + 1)
        line = T_world_pano[:2, 3] + paces[:, None] * (np.cos(yaw_rad), np.sin(yaw_rad))
        free = self._is_free(line[1:])
        walked = len(free) if free.all() else int(free.argmin())
        x_m, y_m = line[walked]
        return pose_2d(x_m, y_m, yaw_rad, T_world_pano[2, 3]), walked < len(free)

    def _is_free(self, xy_m: np.ndarray) -> np.ndarray:
        """(N,) bool: whether the agent fits at positions (N, 2)."""
        pixel = np.floor(self._grid.to_pixel(xy_m)).astype(int)
        inside = ((pixel >= 0) & (pixel < self._free.shape)).all(1)
        row, column = np.where(inside[:, None], pixel, 0).T
        return inside & self._free[row, column]


class NavigableDataset(Dataset):
    """A data set that says itself where an agent can navigate; others that can render give their floors."""

    @abstractmethod
    def worlds(self) -> Sequence[World]:
        """Where an agent can navigate, a world a building or floor."""


def open_worlds(dataset: Dataset) -> Sequence[World]:
    """Where an agent can navigate in a data set. Raises InputMissing in one that cannot show what an agent sees."""
    if isinstance(dataset, NavigableDataset):
        return dataset.worlds()
    if type(dataset).observe is Dataset.observe:
        raise InputMissing(
            f"{dataset.name} cannot render, and navigation needs panoramas from wherever the agent stands"
        )
    return floor_worlds(dataset)


def floor_worlds(dataset: Dataset, actual: Sequence[FloorMasks] | None = None) -> list[FloorWorld]:
    """The floors of a data set that can render, each a world; `actual` as in FloorWorld, in the order of floors(), or
    None: the same.

    Raises DataError where the data set has no floor, or a floor no reference frame.
    """
    floors = dataset.floors()
    if not floors:
        raise DataError(f"{dataset.name} has no floor masks, which navigation needs to know where walls are")
    order = sorted(range(len(floors)), key=lambda number: floors[number].z_m)
    by_height = [floors[number] for number in order]
    own: list[list[ReferenceFrame]] = [[] for _ in floors]
    for frame in reference_frames(dataset):
        place = find_floor(by_height, frame.T_world_pano[:3, 3])
        if place is not None:
            own[order[place]].append(frame)
    bare = [floor.z_m for floor, taken in zip(floors, own, strict=True) if not taken]
    if bare:
        raise DataError(
            f"{dataset.name} has no reference frame on its floor at z = {bare[0]:g} m, expected at least one"
        )
    names = ["floor" if len(floors) == 1 else f"floor-{number}" for number in range(len(floors))]
    return [
        FloorWorld(id=name, dataset=dataset, floor=floor, frames=frames, actual=changed)
        for name, floor, frames, changed in zip(names, floors, own, actual or floors, strict=True)
    ]
