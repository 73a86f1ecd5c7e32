"""Polygons of floor masks: the free floor and the region of each place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.markup import PlanDrawing
from salframe.panoramas.floors import FloorMasks, find_floor

REGION_COLOURS: tuple[tuple[int, int, int], ...] = (
    (222, 235, 247),
    (229, 241, 222),
    (253, 238, 217),
    (240, 229, 243),
    (252, 228, 226),
    (224, 242, 241),
    (249, 245, 215),
    (232, 232, 240),
)
"""Colours of regions. The index is the label of the region modulo the number of colours."""
_SIMPLIFY_PX = 0.7
"""Tolerance for simplifying the polygons, in pixels of the masks."""


def floor_outlines(floor: FloorMasks, mask: np.ndarray) -> list[list[np.ndarray]]:
    """Return the polygons around the true pixels of a mask.

    Args:
        floor: The floor, which has the position and resolution of the mask.
        mask: (rows, columns) bool.

    Returns:
        One list of rings per polygon: the outer ring, then its holes. A ring is (K, 2), in metres in the world. The
        last point of a ring equals the first.
    """
    import cv2

    contours, hierarchy = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if hierarchy is None:
        return []
    rings = []
    for contour in contours:
        pixels = cv2.approxPolyDP(contour, _SIMPLIFY_PX, True)[:, 0].astype(np.float64) + 0.5
        ring = floor.origin_m + np.array([1, -1]) * pixels * floor.resolution_m
        rings.append(np.vstack([ring, ring[:1]]))
    polygons: dict[int, list[np.ndarray]] = {}
    for i, (*_, parent) in enumerate(hierarchy[0]):
        if parent < 0 and len(rings[i]) > 3:
            polygons[i] = [rings[i]]
    for i, (*_, parent) in enumerate(hierarchy[0]):
        if parent in polygons and len(rings[i]) > 3:
            polygons[parent].append(rings[i])
    return list(polygons.values())


def draw_floor(floor: FloorMasks, points_m: np.ndarray, width_px: int = 420) -> PlanDrawing:
    """Return a drawing of a floor with the names of its places.

    Args:
        floor: The floor.
        points_m: (N, 2) points in metres. The drawn area contains them, but they are not drawn.
        width_px: Width of the drawing in pixels.
    """
    areas = {number: floor_outlines(floor, floor.region == number) for number in floor.regions}
    free = floor_outlines(floor, floor.free | (floor.region > 0))
    rings = [polygon[0] for polygon in free]
    drawing = PlanDrawing(np.concatenate([points_m, *rings]) if rings else points_m, width_px, "plan of the floor")
    drawing.fill_rings(
        [ring for polygon in free for ring in polygon], fill="#f0f1f4", stroke="#5c6068", stroke_width="2"
    )
    for number, polygons in areas.items():
        colour = "#{:02x}{:02x}{:02x}".format(*REGION_COLOURS[number % len(REGION_COLOURS)])
        drawing.fill_rings([ring for polygon in polygons for ring in polygon], fill=colour, stroke="#5c6068")
    for number, polygons in areas.items():
        if polygons:
            corners = max((polygon[0] for polygon in polygons), key=lambda ring: float(np.ptp(ring, axis=0).prod()))
            drawing.text((corners.min(0) + corners.max(0)) / 2, floor.regions[number])
    return drawing


def floor_below(floors: Sequence[FloorMasks], position_m: np.ndarray) -> FloorMasks | None:
    """Return the floor that a position (3,) is on, or the lowest floor if it is on none. None if there is no floor."""
    by_height = sorted(floors, key=lambda floor: floor.z_m)
    if not by_height:
        return None
    return by_height[find_floor(by_height, position_m) or 0]
