"""The map as GeoJSON: floors, places, objects, nodes and edges."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from salframe.framework.errors import ConfigError
from salframe.graphs.graph import SaliencyGraph, box_footprints
from salframe.graphs.packing import GRAPH_ARRAYS, graph_from_arrays
from salframe.localization.map import LocalizationMap
from salframe.panoramas.floor_outlines import floor_outlines
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_yaw, transform_points
from salframe.topology.topological_map import TopologicalMap

COORDINATES = (
    "x, y, z in metres in the map's world frame, z up; "
    "not longitude and latitude, although GeoJSON readers interpret them as WGS 84"
)
"""Coordinates of GeoJSON without an anchor, stated in every file."""
GEOGRAPHIC = "longitude and latitude in degrees (WGS 84), and z in metres in the map's world frame"
"""Coordinates of GeoJSON with an anchor, stated in every file."""
EQUATOR_M, ECCENTRICITY_SQUARED = 6378137.0, 6.69437999014e-3
"""Semi-major axis and squared first eccentricity of the WGS 84 ellipsoid."""
MAX_LATITUDE_DEG = 89.0
"""Maximum latitude of an anchor. Nearer to a pole, metres are not proportional to degrees of longitude."""


@dataclass(frozen=True)
class GeoAnchor:
    """Geographic position and orientation of the world frame of a map.

    Attributes:
        latitude_deg: Latitude of the origin in degrees.
        longitude_deg: Longitude of the origin in degrees.
        bearing_deg: Compass bearing of the y axis in degrees, clockwise from north; 0 if y points north and x east.
    """

    latitude_deg: float
    longitude_deg: float
    bearing_deg: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the anchor of a text "LATITUDE,LONGITUDE,BEARING" in degrees. Raises ConfigError."""
        try:
            latitude, longitude, bearing = (float(part) for part in text.split(","))
        except ValueError:
            latitude = np.nan
        if not (abs(latitude) <= MAX_LATITUDE_DEG and abs(longitude) <= 180 and abs(bearing) <= 360):
            raise ConfigError(
                f"the anchor is {text!r}, expected LATITUDE,LONGITUDE,BEARING in degrees, such as 52.5163,13.3777,0 "
                f"(limits: +-{MAX_LATITUDE_DEG:g}, +-180, +-360); BEARING is the compass bearing of the y axis"
            )
        return cls(latitude, longitude, bearing)

    def geographic(self, xy_m: np.ndarray) -> np.ndarray:
        """Return longitudes and latitudes (..., 2) in degrees of positions (..., 2) in the world frame.

        The tangent plane at the origin is used. At 1 km from the origin, the error is below 0.2 m at latitudes up to
        60 deg.
        """
        bearing = np.radians(self.bearing_deg)
        c, s = np.cos(bearing), np.sin(bearing)
        east_m, north_m = np.moveaxis(np.asarray(xy_m, float) @ np.array([[c, -s], [s, c]]), -1, 0)
        latitude = np.radians(self.latitude_deg)
        curvature = 1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
        meridian_m = EQUATOR_M * (1 - ECCENTRICITY_SQUARED) / curvature**1.5
        parallel_m = EQUATOR_M / np.sqrt(curvature) * np.cos(latitude)
        longitude_deg = (self.longitude_deg + np.degrees(east_m / parallel_m) + 180) % 360 - 180
        return np.stack([longitude_deg, self.latitude_deg + np.degrees(north_m / meridian_m)], -1)


def map_geojson(
    name: str,
    localization: LocalizationMap | None,
    topology: TopologicalMap | None,
    anchor: GeoAnchor | None = None,
    max_places_with_objects: int | None = None,
) -> dict[str, Any]:
    """Return a map as a GeoJSON FeatureCollection.

    Each feature has the property `layer`:

    - `floor`: outline of the free floor of a storey, with its height `z_m`.
    - `region`: outline of a place on a floor, with `place` and `z_m`.
    - `place`: position of the first scene frame (reference frame in the room) of a place, with `place`.
    - `object`: footprint of an object in the first scene frame of its place, with `label`, `place` and the height `z_m`
      of its centre.
    - `node`: position of a node of the topology.
    - `edge`: path of an edge of the topology.

    Args:
        name: Name of the map.
        localization: The localization map; None if the map has none.
        topology: The topological map; None if the map has none.
        anchor: Geographic anchor of the world frame; None: the coordinates are metres.
        max_places_with_objects: Maximum number of places whose objects are listed; None: all.
    """
    features: list[dict[str, Any]] = []
    for floor in () if topology is None else topology.floors:
        features += _floor_features(floor)
    properties: dict[str, Any] = {"name": name, "coordinates": COORDINATES, "has_topology": topology is not None}
    if localization is not None:
        first = find_places(localization)
        for place, frame in first.items():
            features.append(geojson_feature("Point", frame.T_world_pano[:3, 3].tolist(), layer="place", place=place))
        for place, frame in list(first.items())[:max_places_with_objects]:
            features += _object_features(localization, frame, place)
        localizer = localization.localizer
        properties |= {"method": localizer.name, "needs": sorted(localizer.needs)}
        properties |= {"places": len(first), "frames": len(localization.frames)}
    if topology is not None:
        features += _topology_features(topology)
    if anchor is not None:
        properties |= {"coordinates": GEOGRAPHIC, "anchor": vars(anchor)}
        for feature in features:
            geometry = feature["geometry"]
            geometry["coordinates"] = _geographic(geometry["coordinates"], anchor)
    return {"type": "FeatureCollection", "properties": properties, "features": features}


def _geographic(coordinates: Any, anchor: GeoAnchor) -> Any:
    """Convert nested coordinates (x, y) in metres to longitude and latitude. Heights are not changed."""
    if not isinstance(coordinates[0], float):
        return [_geographic(part, anchor) for part in coordinates]
    x, y, *height = coordinates
    return [*anchor.geographic(np.array([x, y])).round(9).tolist(), *height]


def _topology_features(topology: TopologicalMap) -> Iterator[dict[str, Any]]:
    """Yield a point for each node and a line for each edge."""
    height = {node.id: node.xyz_m[2] for node in topology.nodes}
    place = {node.id: node.xyz_m[:2] for node in topology.nodes}
    for node in topology.nodes:
        properties = {"id": node.id, "kind": node.kind, "regions": node.regions, "frames": node.frames}
        yield geojson_feature("Point", [float(value) for value in node.xyz_m], layer="node", **properties)
    for edge in topology.edges:
        corners = edge.path_m or (place[edge.start], place[edge.end])
        line = [[float(x), float(y), float(height[edge.start])] for x, y in corners]
        line[-1][2] = float(height[edge.end])
        azimuth_deg = float(np.degrees(edge.azimuth_rad))
        names = {"layer": "edge", "start": edge.start, "end": edge.end, "kind": edge.kind}
        yield geojson_feature("LineString", line, **names, length_m=edge.length_m, azimuth_deg=azimuth_deg)


def geojson_feature(geometry: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """Return a GeoJSON feature.

    Args:
        geometry: Type of the geometry, such as "Point".
        coordinates: Nested coordinates in metres.
        properties: Properties of the feature.
    """
    return {"type": "Feature", "geometry": {"type": geometry, "coordinates": coordinates}, "properties": properties}


def find_places(localization: LocalizationMap) -> dict[str, ReferenceFrame]:
    """Return a mapping from the name of each place to its first scene frame (reference frame in a room)."""
    first: dict[str, ReferenceFrame] = {}
    for frame in localization.frames:
        if frame.kind is FrameKind.SCENE:
            first.setdefault(frame.place, frame)
    return first


def graph_of_reference(localization: LocalizationMap, frame_id: str) -> SaliencyGraph | None:
    """Return the saliency graph of a reference frame; None if its description is not a saliency graph."""
    _, description = localization.reference(frame_id)
    return graph_from_arrays(description) if description.keys() >= GRAPH_ARRAYS else None


def _object_features(localization: LocalizationMap, frame: ReferenceFrame, place: str) -> Iterator[dict[str, Any]]:
    """Yield the objects of a reference frame; none if its description is not a saliency graph."""
    graph = graph_of_reference(localization, frame.id)
    if graph is None:
        return
    T_world_pano = frame.T_world_pano
    c, s = np.cos(pose_yaw(T_world_pano)), np.sin(pose_yaw(T_world_pano))
    corners = box_footprints(graph) @ np.array([[c, s], [-s, c]]) + T_world_pano[:2, 3]
    height_m = transform_points(T_world_pano, graph.centroid_m)[:, 2]
    for label, ring, z_m in zip(graph.labels, corners, height_m, strict=True):
        if np.isfinite(ring).all():
            yield geojson_feature("Polygon", [_closed(ring)], layer="object", label=label, place=place, z_m=float(z_m))


def _floor_features(floor: FloorMasks) -> Iterator[dict[str, Any]]:
    """Yield the outlines of the free floor and of the places of a storey."""
    yield geojson_feature("MultiPolygon", mask_outlines(floor, floor.free), layer="floor", z_m=floor.z_m)
    for number, place in sorted(floor.regions.items()):
        polygons = mask_outlines(floor, floor.region == number)
        if polygons:
            yield geojson_feature("MultiPolygon", polygons, layer="region", place=place, z_m=floor.z_m)


def mask_outlines(floor: FloorMasks, mask: np.ndarray) -> list[list[list[list[float]]]]:
    """Return the polygons of a mask in world coordinates, rounded to millimetres. Each polygon is an outer ring and its
    holes."""
    return [[_rounded(ring) for ring in polygon] for polygon in floor_outlines(floor, mask)]


def _closed(corners: np.ndarray) -> list[list[float]]:
    """Return the closed ring of corners (K, 2): its last position equals its first position."""
    return _rounded(np.vstack([corners, corners[:1]]))


def _rounded(ring: np.ndarray) -> list[list[float]]:
    """Return positions (K, 2) in metres, rounded to millimetres."""
    return ring.round(3).tolist()  # type: ignore[no-any-return]
