"""The topological map T = (V, A) (method.md 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.geometry import wrap_angle


class NodeKind(StrEnum):
    """A scene, a doorway between two regions, or a mere corner of the way."""

    SCENE = "scene"
    TRANSITION = "transition"
    CORNER = "corner"


@dataclass(frozen=True)
class MapNode:
    """A node of the topological map: xyz_m on the floor in the world, its region(s), the mapping frames taken there."""

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


@dataclass(frozen=True)
class TopologicalMap:
    """Scene and transition nodes and the edges between them (method.md 1), each edge once.

    floors: the masks it was made from; parameters: what it was made with, by name; notes: what its reader must know
    (regions out of reach, edges that sight alone did not give, frames moved or left out), a line each.
    """

    nodes: tuple[MapNode, ...]
    edges: tuple[MapEdge, ...]
    floors: tuple[FloorMasks, ...] = field(default=(), compare=False)
    parameters: Mapping[str, float | bool] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
