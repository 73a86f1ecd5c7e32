"""The topological map T = (V, A) (docs/how-to/maps.md#what-the-map-is-made-of)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from xml.etree.ElementTree import Element

import numpy as np

from salframe.framework.validation import Settings
from salframe.panoramas.floors import Connection, FloorMasks, find_floor
from salframe.panoramas.geometry import wrap_angle


class NodeKind(StrEnum):
    """Kind of a node: a scene (a position in a region), a transition (a doorway between two regions), or a corner of an
    edge."""

    SCENE = "scene"
    TRANSITION = "transition"
    CORNER = "corner"


class EdgeKind(StrEnum):
    """Kind of an edge: a walk over clear floor, or stairs or a lift between two storeys."""

    WALK = "walk"
    STAIRS = "stairs"
    LIFT = "lift"


@dataclass(frozen=True)
class MapNode:
    """A node of the topological map.

    Attributes:
        id: Unique id.
        kind: Kind of the node.
        xyz_m: Position on the floor in the world frame, in metres.
        regions: Names of regions: one for a scene node, two for a transition node.
        frames: Ids of the reference frames that are assigned to the node.
    """

    id: str
    kind: NodeKind
    xyz_m: tuple[float, float, float]
    regions: tuple[str, ...]
    frames: tuple[str, ...] = ()


@dataclass(frozen=True)
class MapEdge:
    """An edge, which can be walked in both directions.

    Attributes:
        start: Id of the first node.
        end: Id of the second node.
        length_m: Length of the edge in metres.
        azimuth_rad: Azimuth of the straight line from `start` to `end` in the world frame.
        path_m: Corners (x, y) from `start` to `end`, including both, in the world frame in metres; empty for a straight
            edge.
        kind: Walk, stairs or lift.
        storeys: Numbers of the storeys of `start` and `end`, from 1 for the lowest storey; empty for a walk.
    """

    start: str
    end: str
    length_m: float
    azimuth_rad: float
    path_m: tuple[tuple[float, float], ...] = ()
    kind: EdgeKind = EdgeKind.WALK
    storeys: tuple[int, ...] = ()

    def reversed(self) -> MapEdge:
        """Return the edge from `end` to `start`."""
        azimuth_rad = float(wrap_angle(self.azimuth_rad + np.pi))
        back = replace(self, start=self.end, end=self.start, azimuth_rad=azimuth_rad)
        return replace(back, path_m=self.path_m[::-1], storeys=self.storeys[::-1])


class PartSource(StrEnum):
    """Where a part of a topological map comes from.

    FLOOR_MASKS: floor masks of the data. RANGE: range images of the reference frames. MAP_FILE: an occupancy map of a
    robot. PLACES: the places of the reference frames. FREE_SPACE: the narrow passages of the free space. MIXED: several
    sources, in a map that was extended or merged.
    """

    FLOOR_MASKS = "floor masks"
    RANGE = "derived from range"
    MAP_FILE = "map file"
    PLACES = "derived from places"
    FREE_SPACE = "derived from free space"
    MIXED = "mixed"


class TopologySources(Settings):
    """Where the free space and the regions of a topological map come from. Doorways, nodes and edges are always
    computed from the free space and the regions.

    Attributes:
        free_space: Source of the free floor and the obstacles.
        regions: Source of the regions and their names.
    """

    free_space: PartSource = PartSource.FLOOR_MASKS
    regions: PartSource = PartSource.FLOOR_MASKS

    def joined(self, other: TopologySources) -> TopologySources:
        """Return the sources of a map that is joined with another map, whose sources are `other`."""
        pairs = ((self.free_space, other.free_space), (self.regions, other.regions))
        free_space, regions = (first if first is second else PartSource.MIXED for first, second in pairs)
        return TopologySources(free_space=free_space, regions=regions)

    @property
    def note(self) -> str | None:
        """A line for the user about the sources; None if free space and regions come from floor masks."""
        if self == TopologySources():
            return None
        free_space, regions = _words(self.free_space), _words(self.regions)
        return f"floors without masks: the free space is {free_space}, the regions are {regions}"


def _words(source: PartSource) -> str:
    words = {PartSource.MAP_FILE: "from an occupancy map", PartSource.MIXED: "from several sources"}
    return words.get(source, str(source))


class TopologySettings(Settings):
    """Settings of a topological map.

    Attributes:
        robot_radius_m: Radius of the robot in metres. The free floor is eroded by this radius.
        min_doorway_m: Minimum width of a doorway in metres, measured before erosion. Narrower doorways are dropped.
        snap_m: Maximum distance in metres from a scene frame (reference frame in a room) to its node, which is at the
            nearest clear pixel. Frames farther from clear floor are left out.
        doorway_reach_m: Maximum distance in metres from a transition frame to its transition node.
        choose: Whether to place one scene node per region, where the clearance is largest, instead of one at each scene
            frame.
    """

    robot_radius_m: float = 0.18
    min_doorway_m: float = 0.5
    snap_m: float = 0.5
    doorway_reach_m: float = 0.5
    choose: bool = False


@dataclass(frozen=True)
class TopologicalMap:
    """Scene and transition nodes and the edges between them (docs/how-to/maps.md#what-the-map-is-made-of).

    Attributes:
        nodes: The nodes.
        edges: The edges. Each edge is listed once, and can be walked in both directions.
        floors: The floor masks that the map was built from.
        parameters: The settings that the map was built with.
        notes: Notes for the user, one line each: regions out of reach, edges without line of sight, frames that were
            moved or left out.
        sources: Where the floors come from.
        connections: Stairs and lifts between the floors, which are also in `edges`.
        signs: Mapping from the text of each sign, normalized by `text_key`, to the id of the nearest node. Empty unless
            `open_topology` opened the map.
    """

    nodes: tuple[MapNode, ...]
    edges: tuple[MapEdge, ...]
    floors: tuple[FloorMasks, ...] = field(default=(), compare=False)
    parameters: TopologySettings = field(default_factory=TopologySettings)
    notes: tuple[str, ...] = ()
    sources: TopologySources = field(default_factory=TopologySources)
    connections: tuple[Connection, ...] = ()
    signs: Mapping[str, str] = field(default_factory=dict, compare=False)

    def _repr_html_(self) -> str:
        """Return the map as HTML for notebooks: its numbers of nodes and edges, a plan of each floor, and its notes."""
        from salframe.framework.markup import element, to_html

        kinds = {kind: sum(node.kind is kind for node in self.nodes) for kind in NodeKind}
        counts = ", ".join(f"{count} {kind} nodes" for kind, count in kinds.items() if count)
        length_m = sum(edge.length_m for edge in self.edges)
        parts = [element("p", f"{counts or 'no nodes'}, {len(self.edges)} edges, {length_m:.1f} m in all")]
        by_height = sorted(self.floors, key=lambda floor: floor.z_m)
        for number, floor in enumerate(by_height):
            parts.append(element("p", f"floor at z = {floor.z_m:g} m"))
            parts.append(self._draw(floor, {n.id: n for n in self.nodes if find_floor(by_height, n.xyz_m) == number}))
        return to_html(*parts, *(element("p", f"note: {note}") for note in self.notes))

    def _draw(self, floor: FloorMasks, nodes: Mapping[str, MapNode]) -> Element:
        """Return the drawing of a floor with its nodes and edges. `nodes` maps ids to the nodes of the floor."""
        from salframe.panoramas.floor_outlines import draw_floor

        at_m = {id: np.array(node.xyz_m[:2]) for id, node in nodes.items()}
        drawing = draw_floor(floor, np.array(list(at_m.values())).reshape(-1, 2))
        for edge in self.edges:
            if edge.start in at_m and edge.end in at_m:
                path_m = np.array(edge.path_m) if edge.path_m else np.stack([at_m[edge.start], at_m[edge.end]])
                drawing.line(path_m, stroke="#46629a", stroke_width="1.5")
        colours = {NodeKind.SCENE: "#1f4ea0", NodeKind.TRANSITION: "#d65422", NodeKind.CORNER: "#b06208"}
        for id, node in nodes.items():
            drawing.dot(at_m[id], 4, id, fill=colours[node.kind], stroke="#ffffff")
        return drawing.svg
