"""Floor masks of a mesh: where the floor is, where obstacles stand, and to which room each cell belongs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_as
from salframe.framework.validation import Settings
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.house_file import read_house
from salframe_mesh.mesh_file import MeshSurface
from salframe_mesh.renderer import MeshRenderer

BAND_M = 0.1, 1.5
"""Heights above the floor, in metres, between which a surface is an obstacle for a robot."""
_SLICES = 8
"""Number of horizontal cuts through the mesh. Cuts are needed for walls and tall furniture: a vertical ray from the top
of BAND_M would start inside them and miss their surface."""
_BELOW_M = 0.3
"""Maximum distance in metres of the floor below its stated height, because a scanned floor is uneven."""
_MARGIN_M = 0.4
"""Distance in metres by which rooms are extended. Outlines end at the walls, but the floor in a doorway belongs to a
room too."""
_POCKET_M2 = 1.0
"""Minimum area in square metres of a connected free area. Smaller areas are inside furniture and walls."""
_MAX_CELLS = 1 << 23
"""Maximum number of cells of a floor's masks: 145 m x 145 m at 0.05 m."""


@dataclass(frozen=True, eq=False)
class FloorRegion:
    """The floor area of a place.

    Attributes:
        place: Name of the place.
        outlines_m: Polygons (n, 2) around the area, in metres in the world.
        floor_m: Height of the floor in metres.
        level: Index of the level (storey).
    """

    place: str
    outlines_m: tuple[np.ndarray, ...]
    floor_m: float
    level: int


class _PlaceRegion(Settings):
    """A place in regions.json."""

    outline_m: tuple[tuple[float, float], ...] = Field(min_length=3)
    floor_m: float


def read_rooms(root: Path) -> tuple[FloorRegion, ...]:
    """Read the rooms of a folder from regions.json or, if it does not exist, from .house files.

    The result is empty if there are no such files.

    Format of regions.json: {place: {"outline_m": [[x, y], ...], "floor_m": z}}.

    Raises:
        DataError: A file is malformed.
    """
    path = root / "regions.json"
    if not path.exists():
        return tuple(room for house in sorted(root.glob("*.house")) for room in _house_rooms(house))
    content: dict[str, _PlaceRegion] = read_as(path, dict[str, _PlaceRegion])
    heights = sorted({entry.floor_m for entry in content.values()})
    return tuple(
        FloorRegion(place, (np.array(entry.outline_m),), entry.floor_m, heights.index(entry.floor_m))
        for place, entry in content.items()
    )


def _house_rooms(path: Path) -> list[FloorRegion]:
    regions = read_house(path).regions
    return [FloorRegion(f"{path.stem}/region-{r.index}", r.outlines_m, float(r.low_m[2]), r.level) for r in regions]


def floor_masks(
    surface: MeshSurface, renderer: MeshRenderer, rooms: Sequence[FloorRegion], resolution_m: float
) -> FloorMasks:
    """Compute the floor masks of the rooms of one level.

    A cell is free if a vertical ray from above hits the floor. It is an obstacle if the ray hits something 0.1 to 1.5 m
    above the floor, or if a horizontal cut of the mesh at one of several heights in this interval passes through the
    cell.

    Args:
        surface: Mesh.
        renderer: Renderer of the mesh.
        rooms: Rooms of the level.
        resolution_m: Cell size in metres.

    Raises:
        DataError: The outlines span too many cells.
    """
    import cv2

    floor_m = float(np.median([room.floor_m for room in rooms]))
    corners = np.concatenate([outline for room in rooms for outline in room.outlines_m])
    left_m, top_m = corners[:, 0].min() - _MARGIN_M, corners[:, 1].max() + _MARGIN_M
    with np.errstate(over="ignore"):
        width_m, height_m = corners[:, 0].max() + _MARGIN_M - left_m, top_m - corners[:, 1].min() + _MARGIN_M
        cells = width_m / resolution_m * (height_m / resolution_m)
    if not cells <= _MAX_CELLS:
        raise DataError(
            f"the outlines of {rooms[0].place} and other rooms span {width_m:g} x {height_m:g} m, which is {cells:.3g} "
            f"cells of {resolution_m:g} m, expected at most {_MAX_CELLS} cells: check the unit of the outlines"
        )
    columns, rows = int(np.ceil(width_m / resolution_m)), int(np.ceil(height_m / resolution_m))
    origin_m = np.array([left_m, top_m])

    def pixels(xy_m: np.ndarray) -> np.ndarray:
        """Convert positions in metres to columns and rows (..., 2) in pixels."""
        return (xy_m - origin_m) * [1, -1] / resolution_m

    column, row = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    above = np.stack(
        [left_m + column * resolution_m, top_m - row * resolution_m, np.full_like(row, floor_m + BAND_M[1])], -1
    ).reshape(-1, 3)
    down_m = renderer.trace(above, np.broadcast_to(np.array([0, 0, -1], np.float32), above.shape))[0].reshape(
        rows, columns
    )
    up_m = BAND_M[1] - down_m
    is_floor = up_m > -_BELOW_M
    obstacle = up_m > BAND_M[0]
    cuts = np.zeros((rows, columns), np.uint8)
    for height in np.linspace(*BAND_M, _SLICES):
        cv2.polylines(
            cuts, np.floor(pixels(_cut_mesh(surface, floor_m + height))).astype(np.int32), isClosed=False, color=1
        )
    obstacle |= cuts > 0

    region = np.zeros((rows, columns), np.int32)
    for number, room in enumerate(rooms, 1):
        cv2.fillPoly(region, [np.round(pixels(outline) - 0.5).astype(np.int32) for outline in room.outlines_m], number)
    region = _extend_labels(region, _MARGIN_M / resolution_m)
    free = (region > 0) & (is_floor | obstacle)
    obstacle |= _small_patches(free & ~obstacle, _POCKET_M2 / resolution_m**2)
    places = {number: room.place for number, room in enumerate(rooms, 1)}
    return FloorMasks(
        free, np.where(free, region, 0), obstacle & free, resolution_m, (float(left_m), float(top_m)), places, floor_m
    )


def _cut_mesh(surface: MeshSurface, height_m: float) -> np.ndarray:
    """Return the segments (N, 2, 2), x and y of their ends, in which a horizontal plane cuts the triangles."""
    corners = surface.vertices_m[surface.triangles]
    above = corners[..., 2] >= height_m
    corners, above = (part[above.any(1) & ~above.all(1)] for part in (corners, above))
    following = np.roll(corners, -1, axis=1)
    crossed = above != np.roll(above, -1, axis=1)  # exactly two of the three edges
    share = (height_m - corners[crossed][:, 2]) / (following[crossed][:, 2] - corners[crossed][:, 2])
    return (corners[crossed] + share[:, None] * (following[crossed] - corners[crossed]))[:, :2].reshape(-1, 2, 2)


def _extend_labels(region: np.ndarray, reach_px: float) -> np.ndarray:
    """Give unlabelled cells within `reach_px` of a room the label of the nearest room."""
    from scipy import ndimage

    distance, nearest = ndimage.distance_transform_edt(region == 0, return_indices=True)
    return np.where(distance <= reach_px, region[tuple(nearest)], 0).astype(np.int32)


def _small_patches(clear: np.ndarray, pixels: float) -> np.ndarray:
    """Return a mask of the connected areas of `clear` with fewer than `pixels` pixels."""
    from scipy import ndimage

    parts, _ = ndimage.label(clear)
    return clear & (np.bincount(parts.ravel())[parts] < pixels)
