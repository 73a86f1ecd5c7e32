"""The topological map T = (V, A) (docs/how-to/maps.md#what-the-map-is-made-of)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from salframe.framework.validation import Settings
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.geometry import wrap_angle


class NodeKind(StrEnum):
    """A scene, a doorway between two regions, or a mere corner of the way."""

    SCENE = "scene"
    TRANSITION = "transition"
    CORNER = "corner"


@dataclass(frozen=True)
class MapNode:
    """A node of the topological map: xyz_m on the floor in the world, its region(s), the reference frames taken there."""

    id: str
    kind: NodeKind
    xyz_m: tuple[float, float, float]
    regions: tuple[str, ...]
    frames: tuple[str, ...] = ()


@dataclass(frozen=True)
class MapEdge:
    """An edge walked either way; azimuth_rad of the straight line from `start` to `end` in the world frame.

    path_m: the corners (x, y) of the way from `start` to `end`, both included, where it is no straight line; else
    empty.
    """

    start: str
    end: str
    length_m: float
    azimuth_rad: float
    path_m: tuple[tuple[float, float], ...] = ()

    def reversed(self) -> MapEdge:
        """The edge walked from `end` to `start`."""
        azimuth_rad = float(wrap_angle(self.azimuth_rad + np.pi))
        return MapEdge(self.end, self.start, self.length_m, azimuth_rad, self.path_m[::-1])


class TopologySettings(Settings):
    """How a topological map is made.

    robot_radius_m: what the free floor is eroded by; min_doorway_m: narrower doorways, measured before erosion, are
    dropped; snap_m: a scene point that is not clear moves to the nearest clear pixel this near, or is left out;
    doorway_reach_m: a transition frame belongs to the nearest transition node this near; choose: put one scene node
    where each region is widest, whatever frames there are.
    """

    robot_radius_m: float = 0.18
    min_doorway_m: float = 0.5
    snap_m: float = 0.5
    doorway_reach_m: float = 0.5
    choose: bool = False


@dataclass(frozen=True)
class TopologicalMap:
    """Scene and transition nodes and the edges between them (docs/how-to/maps.md#what-the-map-is-made-of), each edge
    once.

    floors: the masks it was made from; parameters: what it was made with; notes: what its reader must know (regions out
    of reach, edges that sight alone did not give, frames moved or left out), a line each.
    """

    nodes: tuple[MapNode, ...]
    edges: tuple[MapEdge, ...]
    floors: tuple[FloorMasks, ...] = field(default=(), compare=False)
    parameters: TopologySettings = field(default_factory=TopologySettings)
    notes: tuple[str, ...] = ()
