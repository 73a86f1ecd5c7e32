"""The map as GeoJSON: floors, places, objects, nodes and edges."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from salframe.graphs.graph import box_footprints
from salframe.graphs.packing import GRAPH_ARRAYS, graph_from_arrays
from salframe.localization.map import LocalizationMap
from salframe.panoramas.floor_outlines import floor_outlines
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_yaw, transform_points
from salframe.topology.export import COORDINATES, geojson_feature, topology_geojson
from salframe.topology.topological_map import TopologicalMap

MAX_FRAMES_WITH_OBJECTS = 500
"""Maximum number of places whose objects are listed."""


def map_json(name: str, localization: LocalizationMap, topology: TopologicalMap | None) -> bytes:
    """Return a map as a GeoJSON FeatureCollection in UTF-8.

    Each feature has the property `layer`:

    - `floor`: outline of the free floor of a storey, with its height `z_m`.
    - `region`: outline of a place on a floor, with `place` and `z_m`.
    - `place`: position of the first scene frame of a place, with `place`.
    - `object`: footprint of an object seen from that frame, with `label`, `place` and the height `z_m` of its centre.
    - `node` and `edge`: those of the topology.

    Args:
        name: Name of the map.
        localization: The localization map.
        topology: The topological map; None where the map has none.
    """
    features: list[dict[str, Any]] = []
    if topology is not None:
        for floor in topology.floors:
            features += _floor_features(floor)
    first = find_places(localization)
    for place, frame in first.items():
        features.append(geojson_feature("Point", frame.T_world_pano[:3, 3].tolist(), layer="place", place=place))
    for place, frame in list(first.items())[:MAX_FRAMES_WITH_OBJECTS]:
        features += _object_features(localization, frame, place)
    if topology is not None:
        for feature in topology_geojson(topology)["features"]:
            feature["properties"]["layer"] = "node" if feature["geometry"]["type"] == "Point" else "edge"
            features.append(feature)
    localizer = localization.localizer
    properties = {
        "name": name,
        "coordinates": COORDINATES,
        "method": localizer.name,
        "needs": sorted(localizer.needs),
        "places": len(first),
        "frames": len(localization.frames),
        "has_topology": topology is not None,
    }
    collection = {"type": "FeatureCollection", "properties": properties, "features": features}
    return json.dumps(collection, allow_nan=False, separators=(",", ":")).encode()


def find_places(localization: LocalizationMap) -> dict[str, ReferenceFrame]:
    """Return the first scene frame of each place by its name."""
    first: dict[str, ReferenceFrame] = {}
    for frame in localization.frames:
        if frame.kind is FrameKind.SCENE:
            first.setdefault(frame.place, frame)
    return first


def _object_features(localization: LocalizationMap, frame: ReferenceFrame, place: str) -> Iterator[dict[str, Any]]:
    """Yield the objects of a reference frame whose description is a saliency graph."""
    _, description = localization.reference(frame.id)
    if not description.keys() >= GRAPH_ARRAYS:
        return
    graph = graph_from_arrays(description)
    T_world_pano = frame.T_world_pano
    c, s = np.cos(pose_yaw(T_world_pano)), np.sin(pose_yaw(T_world_pano))
    corners = box_footprints(graph) @ np.array([[c, s], [-s, c]]) + T_world_pano[:2, 3]
    height_m = transform_points(T_world_pano, graph.centroid_m)[:, 2]
    for label, ring, z_m in zip(graph.labels, corners, height_m, strict=True):
        if np.isfinite(ring).all():
            yield geojson_feature("Polygon", [_closed(ring)], layer="object", label=label, place=place, z_m=float(z_m))


def _floor_features(floor: FloorMasks) -> Iterator[dict[str, Any]]:
    """Yield the outlines of the free floor and of the places of a storey."""
    yield geojson_feature("MultiPolygon", _outlines(floor, floor.free), layer="floor", z_m=floor.z_m)
    for number, place in sorted(floor.regions.items()):
        polygons = _outlines(floor, floor.region == number)
        if polygons:
            yield geojson_feature("MultiPolygon", polygons, layer="region", place=place, z_m=floor.z_m)


def _outlines(floor: FloorMasks, mask: np.ndarray) -> list[list[list[list[float]]]]:
    """Return the polygons of a mask in world coordinates: an outer ring and its holes each."""
    return [[_rounded(ring) for ring in polygon] for polygon in floor_outlines(floor, mask)]


def _closed(corners: np.ndarray) -> list[list[float]]:
    """Return the ring of corners (K, 2), whose last position is its first."""
    return _rounded(np.vstack([corners, corners[:1]]))


def _rounded(ring: np.ndarray) -> list[list[float]]:
    """Return positions (K, 2) in millimetres precision."""
    return ring.round(3).tolist()  # type: ignore[no-any-return]
