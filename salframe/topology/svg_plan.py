"""A floor plan of a map as SVG, one group per storey."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from salframe.framework.files.writing import write_text
from salframe.localization.map import LocalizationMap
from salframe.panoramas.floors import find_floor
from salframe.topology.geojson import map_geojson
from salframe.topology.topological_map import EdgeKind, TopologicalMap

MARGIN_M = 1.0
"""Margin around a storey in metres."""
CONVENTIONS = (
    "Floor plan in metres: one unit is 1 m. In each group, x is that of the map's world frame and y is -y of the world "
    "frame, because y points down in SVG. Storeys are placed below each other by the transform of their group."
)
"""Axes and units, stated in every file."""
STYLE = """
.floor { fill: #f4f5f7; stroke: #39424e; stroke-width: 0.06; fill-rule: evenodd }
.region { fill: none; stroke: #9aa5b4; stroke-width: 0.03 }
.object { fill: #c9d8ee; stroke: #5b7fb5; stroke-width: 0.02 }
.edge { fill: none; stroke: #c2662d; stroke-width: 0.03 }
.node { fill: #c2662d }
text { font: 0.3px sans-serif; fill: #1d232b; text-anchor: middle }
.title { font-size: 0.5px; text-anchor: start }
"""


def write_plan(name: str, localization: LocalizationMap | None, topology: TopologicalMap, path: Path) -> None:
    """Write the floor plan of a map: outlines of floors and places, objects, nodes and edges.

    Args:
        name: Name of the map.
        localization: The localization map with the objects; None if the map has none.
        topology: The topological map.
        path: The SVG file.
    """
    features = map_geojson(name, localization, topology)["features"]
    groups: list[str] = []
    top_m, width_m = 0.0, 0.0
    for number, floor in enumerate(topology.floors):
        rows, columns = np.array(floor.free.shape) * floor.resolution_m
        left, top = floor.origin_m
        move = f"translate({MARGIN_M - left:.3f} {top_m + MARGIN_M + top:.3f})"
        groups.append(f'<g transform="{move}" data-z-m="{floor.z_m:g}">')
        groups.append(
            f'<text class="title" x="{left:.3f}" y="{-top - 0.3:.3f}">{escape(name)}, z = {floor.z_m:g} m</text>'
        )
        for feature in features:
            if find_floor(topology.floors, _first_point(feature)) == number and not _changes_floor(feature):
                groups += _shapes(feature)
        groups.append(f'<path class="edge" d="M{left:.3f} {rows - top + 0.5:.3f}h1"/>')
        groups.append(f'<text x="{left + 0.5:.3f}" y="{rows - top + 0.4:.3f}">1 m</text>')
        groups.append("</g>")
        top_m, width_m = top_m + rows + 2 * MARGIN_M, max(width_m, columns + 2 * MARGIN_M)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width_m:.3f} {top_m:.3f}">',
        f"<title>{escape(name)}</title>",
        f"<desc>{escape(CONVENTIONS)}</desc>",
        f"<style>{STYLE}</style>",
        *groups,
        "</svg>",
    ]
    write_text(path, "\n".join(lines) + "\n")


def _changes_floor(feature: dict[str, Any]) -> bool:
    """Return whether a feature is an edge by stairs or a lift, which a plan of one floor does not show."""
    return feature["properties"].get("kind") in (EdgeKind.STAIRS, EdgeKind.LIFT)


def _first_point(feature: dict[str, Any]) -> np.ndarray:
    """Return a point (3,) of a feature in metres. The points of the outlines of a floor get a height just above the
    floor."""
    point = feature["geometry"]["coordinates"]
    while not isinstance(point[0], float):
        point = point[0]
    height_m = point[2] if len(point) > 2 else feature["properties"]["z_m"] + 1e-3
    return np.array([point[0], point[1], height_m])


def _shapes(feature: dict[str, Any]) -> Iterator[str]:
    """Yield the SVG elements of a feature."""
    geometry, properties = feature["geometry"], feature["properties"]
    layer, coordinates = properties["layer"], geometry["coordinates"]
    if layer == "node":
        x, y = coordinates[:2]
        title = f"<title>{escape(properties['id'])}</title>"
        yield f'<circle class="node" cx="{x:.3f}" cy="{-y:.3f}" r="0.08">{title}</circle>'
    elif layer == "place":
        x, y = coordinates[:2]
        yield f'<text x="{x:.3f}" y="{-y:.3f}">{escape(properties["place"])}</text>'
    elif layer == "edge":
        yield f'<path class="edge" d="{_line(coordinates)}"/>'
    else:
        polygons = coordinates if geometry["type"] == "MultiPolygon" else [coordinates]
        outline = "".join(_line(ring) + "Z" for polygon in polygons for ring in polygon)
        name = quoteattr(properties.get("label") or properties.get("place") or "floor")
        yield f'<path class="{layer}" data-name={name} d="{outline}"/>'


def _line(points: list[list[float]]) -> str:
    return "M" + "L".join(f"{x:.3f} {-y:.3f}" for x, y, *_ in points)
