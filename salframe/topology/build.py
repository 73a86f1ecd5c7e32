"""Build the topological map from floor masks and reference frames (docs/how-to/maps.md#what-the-map-is-made-of)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks, check_heights, find_floor
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.topology.connections import disconnected_note
from salframe.topology.edges import components, joining_paths, make_edge, sight_pairs
from salframe.topology.grid import FloorGrid, cell, nearest_pixel
from salframe.topology.topological_map import (
    MapEdge,
    MapNode,
    NodeKind,
    TopologicalMap,
    TopologySettings,
    TopologySources,
)
from salframe.topology.transitions import Doorway, close_doorways


def build_topology(
    floors: Sequence[FloorMasks],
    frames: Iterable[ReferenceFrame] = (),
    settings: TopologySettings | None = None,
    sources: TopologySources | None = None,
) -> TopologicalMap:
    """Build the topological map of a building from its floor masks and reference frames.

    Transition nodes are placed in the doorways of the masks. A scene node is placed at each frame of kind "scene" (in a
    room). A frame of kind "transition" (in a doorway) is assigned to the transition node near it. If there are no scene
    frames, or with the setting `choose`, each region has one scene node, at its pixel with the largest clearance.

    Clear floor is the floor where the robot fits. Edges join nodes with a line of sight over clear floor. Nodes that
    are connected by clear floor, but not by lines of sight, get edges along shortest paths.

    Args:
        floors: The masks of the floors.
        frames: The reference frames.
        settings: Settings of the map; None: `TopologySettings()`.
        sources: Where the floors come from; None: from floor masks.

    Returns:
        The map. Its `notes` list the edges along shortest paths, the frames that were moved or left out, and the
        regions and nodes that are out of reach.

    Raises:
        DataError: In any of these cases: there is no floor; two floors have the same height, and their
            masks overlap or touch; no region of a floor has free floor; two nodes have the same name.
    """
    if not floors:
        raise DataError(
            "a topology (graph for routes) needs the masks of at least one floor, received none: use data with floor "
            "masks or range"
        )
    settings = settings or TopologySettings()
    floors = sorted(floors, key=lambda floor: floor.z_m)
    references = list(frames)
    notes: list[str] = []
    frames_by_floor = _split_by_floor(references, floors, notes)
    choose = settings.choose or not any(frame.kind is FrameKind.SCENE for frame in references)
    nodes: list[MapNode] = []
    edges: list[MapEdge] = []
    for floor, floor_frames in zip(floors, frames_by_floor, strict=True):
        floor_map = _FloorMap(floor, floor_frames, settings, choose, notes)
        nodes += floor_map.nodes
        edges += floor_map.edges
    duplicates = [name for name, count in Counter(node.id for node in nodes).items() if count > 1]
    if duplicates:
        raise DataError(
            f"two nodes of the topology (graph for routes) would have the name {duplicates[0]!r}, expected different "
            "names: rename the places that have the same name on two floors"
        )
    if note := disconnected_note(floors, edges):
        notes.append(note)
    sources = sources or TopologySources()
    return TopologicalMap(tuple(nodes), tuple(edges), tuple(floors), settings, tuple(notes), sources)


def _split_by_floor(
    frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks], notes: list[str]
) -> list[list[ReferenceFrame]]:
    """Return the frames of each floor. Append a note for each frame that is on no floor."""
    check_heights(floors)
    frames_by_floor: list[list[ReferenceFrame]] = [[] for _ in floors]
    for frame in frames:
        number = find_floor(floors, frame.T_world_pano[:3, 3])
        if number is None:
            x, y, z = frame.T_world_pano[:3, 3]
            notes.append(f"frame {frame.id} at ({x:.2f}, {y:.2f}, {z:.2f}) m is left out: no floor mask covers it")
        else:
            frames_by_floor[number].append(frame)
    return frames_by_floor


class _FloorMap:
    """Nodes and edges of one floor. The constructor appends notes for the user to `notes`."""

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
                f"the floor at z = {floor.z_m:g} m has no free space in any region, expected free space in at least "
                "one: check its masks `free` and `region`"
            )
        self.nodes: list[MapNode] = []
        self._positions: list[np.ndarray] = []
        scenes = [frame for frame in frames if frame.kind is FrameKind.SCENE]
        if choose:
            self._choose_scenes(scenes)
        else:
            self._add_scenes(scenes)
        for doorway in narrow:
            notes.append(f"{self._describe(doorway)} is left out: narrower than {settings.min_doorway_m:g} m")
        self._add_transitions(doorways)
        self._assign_transition_frames([frame for frame in frames if frame.kind is FrameKind.TRANSITION])
        self.edges: list[MapEdge] = []
        if self.nodes:
            self._add_edges(np.array(self._positions))

    def _add(
        self, id: str, kind: NodeKind, pixel: np.ndarray, regions: tuple[str, ...], frames: tuple[str, ...]
    ) -> None:
        self.nodes.append(MapNode(id, kind, self._grid.world(pixel), regions, frames))
        self._positions.append(pixel)

    def _add_scenes(self, frames: Sequence[ReferenceFrame]) -> None:
        """Add a scene node at the position of each frame. Frames in the same pixel of the floor masks share a node."""
        frames_at: dict[tuple[int, int], list[tuple[ReferenceFrame, np.ndarray]]] = {}
        for frame in frames:
            pixel = self._snap(frame)
            if pixel is not None:
                frames_at.setdefault((int(pixel[0]), int(pixel[1])), []).append((frame, pixel))
        for (row, column), entries in frames_at.items():
            frame, pixel = entries[0]
            region = self._names.get(int(self._grid.label[row, column]), frame.place)
            self._add(frame.id, NodeKind.SCENE, pixel, (region,), tuple(other.id for other, _ in entries))

    def _snap(self, frame: ReferenceFrame) -> np.ndarray | None:
        """Return the position (row, column) of the node of a frame; None if it is farther than `snap_m` from the frame.

        It is the position of the frame, if the floor is clear there. Otherwise it is the centre of the nearest clear
        pixel, in the region of the place of the frame if the floor has this region.
        """
        grid, max_distance_m = self._grid, self._settings.snap_m
        labels = [label for label, name in self._names.items() if name == frame.place]
        position = grid.to_pixel(frame.T_world_pano[:2, 3])
        if grid.clear[cell(position)]:
            return position
        pixel = nearest_pixel(grid.clear & (grid.label == labels[0]) if labels else grid.clear, position)
        x, y = frame.T_world_pano[:2, 3]
        reason = f"frame {frame.id} at ({x:.2f}, {y:.2f}) m is inside a wall or obstacle, or too near to one"
        distance_m = np.inf if pixel is None else float(np.linalg.norm(pixel - position)) * grid.floor.resolution_m
        if distance_m > max_distance_m:
            self._notes.append(
                f"{reason}; the frame is left out: its region has no free floor within {max_distance_m:g} m"
            )
            return None
        self._notes.append(f"{reason}; its topology node is {distance_m:.2f} m from the frame")
        return pixel

    def _choose_scenes(self, frames: Sequence[ReferenceFrame]) -> None:
        """Add one scene node for each region, at its pixel with the largest clearance. All frames of the place are
        assigned to this node."""
        clear = np.where(self._grid.clear, self._grid.clearance_m, -1.0)
        for label, name in self._names.items():
            clearance_m = np.where(self._grid.label == label, clear, -1.0)
            if clearance_m.max() < 0:
                radius_m = self._settings.robot_radius_m
                self._notes.append(
                    f"the region {name} has no node: no part of the region is wide enough for a robot of radius "
                    f"{radius_m:g} m"
                )
                continue
            pixel = np.array(np.unravel_index(clearance_m.argmax(), clearance_m.shape)) + 0.5
            self._add(name, NodeKind.SCENE, pixel, (name,), tuple(frame.id for frame in frames if frame.place == name))

    def _describe(self, doorway: Doorway) -> str:
        x, y = self._grid.to_metres(doorway.pixels.mean(0) + 0.5)
        first, second = (self._names[label] for label in doorway.labels)
        return f"a doorway of {doorway.width_m:.2f} m between {first} and {second} at ({x:.2f}, {y:.2f}) m"

    def _add_transitions(self, doorways: Sequence[Doorway]) -> None:
        """Add a transition node in the middle of each passage between two regions."""
        count: Counter[str] = Counter()
        for doorway in doorways:
            if not doorway.points:
                radius_m = self._settings.robot_radius_m
                self._notes.append(
                    f"{self._describe(doorway)} is impassable: a robot of radius {radius_m:g} m does not fit through"
                )
            first, second = (self._names[label] for label in doorway.labels)
            name = f"{first}/{second}"
            for point in doorway.points:
                count[name] += 1
                id = name if count[name] == 1 else f"{name}/{count[name]}"
                self._add(id, NodeKind.TRANSITION, np.array(point) + 0.5, (first, second), ())

    def _assign_transition_frames(self, frames: Sequence[ReferenceFrame]) -> None:
        """Assign each transition frame to the nearest transition node within `doorway_reach_m`."""
        doors = [number for number, node in enumerate(self.nodes) if node.kind is NodeKind.TRANSITION]
        for frame in frames:
            xy = frame.T_world_pano[:2, 3]
            distance_m = [float(np.hypot(*(xy - self.nodes[door].xyz_m[:2]))) for door in doors]
            if not doors or min(distance_m) > self._settings.doorway_reach_m:
                reach = f"no node of a doorway is within {self._settings.doorway_reach_m:g} m"
                self._notes.append(
                    f"frame {frame.id} at ({xy[0]:.2f}, {xy[1]:.2f}) m belongs to no topology node: {reach}"
                )
                continue
            door = doors[int(np.argmin(distance_m))]
            self.nodes[door] = replace(self.nodes[door], frames=(*self.nodes[door].frames, frame.id))

    def _add_edges(self, positions: np.ndarray) -> None:
        grid = self._grid
        pairs = sight_pairs(grid, positions)
        paths = joining_paths(grid, positions, components(len(positions), pairs))
        names = [node.id for node in self.nodes]
        self.edges = [make_edge(grid, names[i], names[j], positions[[i, j]]) for i, j in pairs]
        self.edges += [make_edge(grid, names[i], names[j], corners) for i, j, corners in paths]
        if paths:
            listed = ", ".join(f"{names[i]} to {names[j]}" for i, j, _ in paths)
            self._notes.append(
                f"these edges follow a shortest path, because obstacles block the straight line: {listed}"
            )
        connections = np.vstack([pairs, np.array([(i, j) for i, j, _ in paths], int).reshape(-1, 2)])
        self._note_unreachable(components(len(positions), connections))

    def _note_unreachable(self, component: np.ndarray) -> None:
        """Append notes on the regions and nodes that cannot be reached from the main part of the floor. The main part
        is the connected component with the largest number of regions."""
        parts = [
            {name for node, c in zip(self.nodes, component, strict=True) if c == part for name in node.regions}
            for part in range(int(component.max()) + 1)
        ]
        main = int(np.argmax([len(part) for part in parts]))
        with_door = {name for node in self.nodes if node.kind is NodeKind.TRANSITION for name in node.regions}
        for name in self._names.values():
            if name not in parts[main]:
                reason = (
                    "no path leads from its doors to the other regions"
                    if name in with_door
                    else "no door of the region is wide enough for the robot"
                )
                self._notes.append(f"the region {name} cannot be reached from the other regions: {reason}")
        for node, c in zip(self.nodes, component, strict=True):
            if c != main and parts[main].issuperset(node.regions):
                self._notes.append(f"the node {node.id} cannot be reached: obstacles block every path to the node")
