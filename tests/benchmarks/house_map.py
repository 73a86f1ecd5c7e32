"""The rooms of generated houses, of which benchmarks make maps of any size."""

from __future__ import annotations

from functools import cache

import numpy as np
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_house.building import Style, generate_building
from salframe_house.frames import choose_frames
from salframe_house.render import HouseRenderer

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import graph_from_arrays
from salframe.graphs.synthetic_map import SyntheticMap
from salframe.localization.localizer import Localizer
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Annotations, Panorama


def describe_rooms(
    style: Style, rooms: int, seed: int, method: type[Localizer] = SaliencyGraphLocalizer
) -> list[tuple[dict[str, np.ndarray], ReferenceFrame]]:
    """What `saliency-graph`, or another method of graphs, remembers of the rooms of a building, from annotations, each
    with its reference frame."""
    localizer = method(method.Config(detector="annotations"))
    building = generate_building(style, rooms, seed)
    renderer, described = HouseRenderer(building.scene(), "day"), []
    for spec in choose_frames(building, building, seed, queries_per_room=1):
        if spec.role == "map" and spec.place not in [frame.place for _, frame in described]:
            T_world_pano = pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m)
            range_m, instance_id = renderer.geometry(T_world_pano)
            seen = Panorama(spec.id, range_m=range_m, annotations=Annotations(instance_id, building.labels))
            described.append((dict(localizer.describe(seen)), ReferenceFrame(spec.id, spec.place, T_world_pano)))
    return described


@cache
def house_graphs() -> tuple[SaliencyGraph, ...]:
    """The rooms of a home, an office and a hotel of 24 rooms each, but those with fewer than three objects."""
    described = [room for style in ("home", "office", "hotel") for room in describe_rooms(style, 24, 7)]
    graphs = (graph_from_arrays(description) for description, _ in described)
    return tuple(graph for graph in graphs if len(graph) >= 3)


def map_of_houses(seed: int) -> SyntheticMap:
    """A synthetic map of their rooms."""
    return SyntheticMap(seed, house_graphs())
