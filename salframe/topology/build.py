"""From floor masks and reference frames to the topological map (docs/how-to/maps.md#what-the-map-is-made-of)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks, find_floor
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.topology.edges import components, joining_paths, make_edge, sight_pairs
from salframe.topology.grid import FloorGrid, cell, nearest_pixel
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap, TopologySettings
from salframe.topology.transitions import Doorway, close_doorways


def build_topology(
    floors: Sequence[FloorMasks], frames: Iterable[ReferenceFrame] = (), settings: TopologySettings | None = None
) -> TopologicalMap:
    """The topological map of floors: transition nodes from the masks, scene nodes from reference frames, edges by sight
    over clear floor.

    Frames of kind "scene" are scene points, those of kind "transition" are handed to the transition node they stand at.
    Without scene frames, or with `choose`, each region has one scene node, in its clear pixel of greatest clearance.
    Where sight leaves nodes of a floor apart that clear floor joins, the shortest ways over it are added. `notes` of
    the map tell what was added, moved, dropped or is out of reach. Raises DataError without floors, with floors that
    cannot be told apart, on a floor without a region, on frames without a pose.
    """
    if not floors:
        raise DataError("a topological map needs floor masks, received none: the dataset has no floors")
    settings = settings or TopologySettings()
    floors = sorted(floors, key=lambda floor: floor.z_m)
    mapped = list(frames)
    notes: list[str] = []
    frames_of = _share_out(mapped, floors, notes)
    choose = settings.choose or not any(frame.kind is FrameKind.SCENE for frame in mapped)
    nodes: list[MapNode] = []
    edges: list[MapEdge] = []
    for floor, own in zip(floors, frames_of, strict=True):
        made = _FloorMap(floor, own, settings, choose, notes)
        nodes += made.nodes
        edges += made.edges
    twice = [name for name, count in Counter(node.id for node in nodes).items() if count > 1]
    if twice:
        raise DataError(
            f"two nodes of the map would be called {twice[0]!r}, "
            "expected places with different names on different floors"
        )
    if len(floors) > 1:
        heights = ", ".join(f"{floor.z_m:.2f}" for floor in floors)
        notes.append(
            f"the {len(floors)} floors at z = {heights} m are not connected: no edge leads from one to another"
        )
    return TopologicalMap(tuple(nodes), tuple(edges), tuple(floors), settings, tuple(notes))


def _share_out(
    frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks], notes: list[str]
) -> list[list[ReferenceFrame]]:
    """The frames of each floor."""
    for lower, upper in pairwise(floors):
        if lower.z_m == upper.z_m:
            raise DataError(f"two floors are at z = {lower.z_m:g} m, expected a z_m of its own for each floor")
    frames_of: list[list[ReferenceFrame]] = [[] for _ in floors]
    for frame in frames:
        number = find_floor(floors, frame.T_world_pano[:3, 3])
        if number is None:
            x, y, z = frame.T_world_pano[:3, 3]
            notes.append(
                f"frame {frame.id} at ({x:.2f}, {y:.2f}, {z:.2f}) m is left out: it stands on no floor's masks"
            )
        else:
            frames_of[number].append(frame)
    return frames_of


class _FloorMap:
    """Nodes and edges of one floor; what a reader must know is added to `notes`."""

    def __init__(
        self,
        floor: FloorMasks,
        frames: Sequence[ReferenceFrame],
        settings: TopologySettings,
        choose: bool,
        notes: list[str],
    ) -> None:
        self._grid = FloorGrid(floor, settings.robot_radius_m)
        self._settings = settings
        self._notes = notes
        doorways, narrow = close_doorways(self._grid, settings.min_doorway_m)
        self._names = self._grid.names
        if not self._names:
            raise DataError(
                f"the floor at z = {floor.z_m:g} m has no free floor in any region, expected labelled free floor"
            )
        self.nodes: list[MapNode] = []
        self._positions: list[np.ndarray] = []
        scenes = [frame for frame in frames if frame.kind is FrameKind.SCENE]
        if choose:
            self._choose_scenes(scenes)
        else:
            self._add_scenes(scenes)
        for doorway in narrow:
            notes.append(f"{self._describe(doorway)} is dropped: it is under {settings.min_doorway_m:g} m")
        self._add_transitions(doorways)
        self._hand_frames([frame for frame in frames if frame.kind is FrameKind.TRANSITION])
        self.edges: list[MapEdge] = []
        if self.nodes:
            self._add_edges(np.array(self._positions))

    def _add(
        self, id: str, kind: NodeKind, pixel: np.ndarray, regions: tuple[str, ...], frames: tuple[str, ...]
    ) -> None:
        self.nodes.append(MapNode(id, kind, self._grid.world(pixel), regions, frames))
        self._positions.append(pixel)

    def _add_scenes(self, frames: Sequence[ReferenceFrame]) -> None:
        """A scene node where each frame stands; frames over one pixel share it."""
        at: dict[tuple[int, int], list[tuple[ReferenceFrame, np.ndarray]]] = {}
        for frame in frames:
            pixel = self._snap(frame)
            if pixel is not None:
                at.setdefault((int(pixel[0]), int(pixel[1])), []).append((frame, pixel))
        for (row, column), here in at.items():
            frame, pixel = here[0]
            region = self._names.get(int(self._grid.label[row, column]), frame.place)
            self._add(frame.id, NodeKind.SCENE, pixel, (region,), tuple(other.id for other, _ in here))

    def _snap(self, frame: ReferenceFrame) -> np.ndarray | None:
        """The clear pixel position nearest to a frame, one of the frame's own place where the floor has it; None where
        there is none near."""
        grid, reach_m = self._grid, self._settings.snap_m
        own = [label for label, name in self._names.items() if name == frame.place]
        stands = grid.to_pixel(frame.T_world_pano[:2, 3])
        if grid.clear[cell(stands)]:
            return stands
        pixel = nearest_pixel(grid.clear & (grid.label == own[0]) if own else grid.clear, stands)
        x, y = frame.T_world_pano[:2, 3]
        why = f"frame {frame.id} at ({x:.2f}, {y:.2f}) m stands in a wall or too near to one"
        away_m = np.inf if pixel is None else float(np.linalg.norm(pixel - stands)) * grid.floor.resolution_m
        if away_m > reach_m:
            self._notes.append(f"{why} and is left out: no clear floor of its region within {reach_m:g} m")
            return None
        self._notes.append(f"{why}: its node is {away_m:.2f} m from it")
        return pixel

    def _choose_scenes(self, frames: Sequence[ReferenceFrame]) -> None:
        """A scene node where each region is widest; it takes the frames of its place."""
        clear = np.where(self._grid.clear, self._grid.clearance_m, -1.0)
        for label, name in self._names.items():
            widest = np.where(self._grid.label == label, clear, -1.0)
            if widest.max() < 0:
                self._notes.append(f"{name} has no scene node: the robot fits nowhere in it")
                continue
            pixel = np.array(np.unravel_index(widest.argmax(), widest.shape)) + 0.5
            self._add(name, NodeKind.SCENE, pixel, (name,), tuple(frame.id for frame in frames if frame.place == name))

    def _describe(self, doorway: Doorway) -> str:
        x, y = self._grid.to_metres(doorway.pixels.mean(0) + 0.5)
        first, second = (self._names[label] for label in doorway.labels)
        return f"a doorway of {doorway.width_m:.2f} m between {first} and {second} at ({x:.2f}, {y:.2f}) m"

    def _add_transitions(self, doorways: Sequence[Doorway]) -> None:
        """A transition node in the middle of each passage between two regions."""
        count: Counter[str] = Counter()
        for doorway in doorways:
            if not doorway.points:
                radius_m = self._settings.robot_radius_m
                self._notes.append(
                    f"{self._describe(doorway)} is no way: a robot of radius {radius_m:g} m does not fit through"
                )
            first, second = (self._names[label] for label in doorway.labels)
            name = f"{first}/{second}"
            for point in doorway.points:
                count[name] += 1
                id = name if count[name] == 1 else f"{name}/{count[name]}"
                self._add(id, NodeKind.TRANSITION, np.array(point) + 0.5, (first, second), ())

    def _hand_frames(self, frames: Sequence[ReferenceFrame]) -> None:
        """Hand each transition frame to the transition node it stands at."""
        doors = [number for number, node in enumerate(self.nodes) if node.kind is NodeKind.TRANSITION]
        for frame in frames:
            xy = frame.T_world_pano[:2, 3]
            away_m = [float(np.hypot(*(xy - self.nodes[door].xyz_m[:2]))) for door in doors]
            if not doors or min(away_m) > self._settings.doorway_reach_m:
                reach = f"no transition node within {self._settings.doorway_reach_m:g} m"
                self._notes.append(f"frame {frame.id} at ({xy[0]:.2f}, {xy[1]:.2f}) m belongs to no node: {reach}")
                continue
            door = doors[int(np.argmin(away_m))]
            self.nodes[door] = replace(self.nodes[door], frames=(*self.nodes[door].frames, frame.id))

    def _add_edges(self, positions: np.ndarray) -> None:
        grid = self._grid
        pairs = sight_pairs(grid, positions)
        paths = joining_paths(grid, positions, components(len(positions), pairs))
        names = [node.id for node in self.nodes]
        self.edges = [make_edge(grid, names[i], names[j], positions[[i, j]]) for i, j in pairs]
        self.edges += [make_edge(grid, names[i], names[j], corners) for i, j, corners in paths]
        if paths:
            apart = ", ".join(f"{names[i]} to {names[j]}" for i, j, _ in paths)
            self._notes.append(f"sight alone leaves nodes apart, joined by the shortest way over clear floor: {apart}")
        joined = np.vstack([pairs, np.array([(i, j) for i, j, _ in paths], int).reshape(-1, 2)])
        self._tell_reach(components(len(positions), joined))

    def _tell_reach(self, component: np.ndarray) -> None:
        """Note what cannot be reached from the greatest connected part of the floor, the one with the most regions:
        regions, and other nodes."""
        parts = [
            {name for node, c in zip(self.nodes, component, strict=True) if c == part for name in node.regions}
            for part in range(int(component.max()) + 1)
        ]
        main = int(np.argmax([len(part) for part in parts]))
        with_door = {name for node in self.nodes if node.kind is NodeKind.TRANSITION for name in node.regions}
        for name in self._names.values():
            if name not in parts[main]:
                why = "its doors lead elsewhere" if name in with_door else "it has no door that the robot fits through"
                self._notes.append(f"{name} is out of reach of the floor's other regions: {why}")
        for node, c in zip(self.nodes, component, strict=True):
            if c != main and parts[main].issuperset(node.regions):
                self._notes.append(f"node {node.id} is out of reach: no clear floor leads to it")
