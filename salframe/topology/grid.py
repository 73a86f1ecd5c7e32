"""The pixels of a floor: the pixels where a robot fits, the region of each pixel, lines of sight, and the graph for
shortest paths."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from salframe.panoramas.floors import FloorMasks

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

_CROSSINGS_AT_ONCE = 4_000_000
"""Number of crossings of lines and pixel columns that are tested at once. It limits memory."""


class FloorGrid:
    """The pixels of a floor, for a robot with the radius `robot_radius_m`.

    Positions are (row, column) in pixels. The centre of the first pixel is (0.5, 0.5).

    Attributes:
        floor: The masks of the floor.
        walkable: (rows, columns) bool, free floor without obstacles.
        clearance_m: (rows, columns) float64, distance from the centre of each pixel to the nearest blocked pixel (exact
            along rows and columns).
        clear: (rows, columns) bool, walkable pixels whose clearance is at least the radius of the robot.
    """

    def __init__(self, floor: FloorMasks, robot_radius_m: float) -> None:
        from scipy import ndimage

        self.floor = floor
        self.walkable = floor.free & ~floor.obstacle
        centre_distance = ndimage.distance_transform_edt(np.pad(self.walkable, 1))[1:-1, 1:-1]
        self.clearance_m = (centre_distance - 0.5) * floor.resolution_m
        self.clear = self.walkable & (self.clearance_m >= robot_radius_m - 1e-9)

    @cached_property
    def label(self) -> np.ndarray:
        """The label of the region of each walkable pixel, (rows, columns) int32; 0: no region.

        A free pixel without a region gets the label of the region with the shortest walking distance. The labels of two
        regions therefore meet in the middle of the threshold of a door, for any thickness of the wall
        (docs/how-to/maps.md#what-the-map-is-made-of). Pixels from which no region can be reached have the label 0.
        """
        from scipy import ndimage
        from scipy.sparse.csgraph import dijkstra

        label = np.where(self.floor.free, self.floor.region, 0)
        vacant = self.floor.free & (label == 0)
        around = ndimage.binary_dilation(vacant, np.ones((3, 3), bool)) & self.floor.free
        seeds = np.flatnonzero(label[around])
        if len(seeds) and vacant.any():
            _, _, nearest = dijkstra(pixel_graph(around), indices=seeds, min_only=True, return_predecessors=True)
            region = label[around]
            label[around] = np.where(nearest >= 0, region[np.maximum(nearest, 0)], region)
        return np.where(self.walkable, label, 0)

    @property
    def names(self) -> dict[int, str]:
        """Mapping from each region label to the name of its place. A region without a name is called "region-LABEL"."""
        return {
            int(label): self.floor.regions.get(int(label), f"region-{label}")
            for label in np.unique(self.label)
            if label
        }

    def to_pixel(self, xy_m: np.ndarray) -> np.ndarray:
        """Return the pixels (row, column), (..., 2) float64, of world positions (x, y) in metres."""
        x, y = np.moveaxis(np.asarray(xy_m, np.float64), -1, 0)
        left_m, top_m = self.floor.origin_m
        return np.stack([(top_m - y) / self.floor.resolution_m, (x - left_m) / self.floor.resolution_m], -1)

    def to_metres(self, pixel: np.ndarray) -> np.ndarray:
        """Return the world positions (x, y) in metres, (..., 2), of pixels (row, column)."""
        row, column = np.moveaxis(np.asarray(pixel, np.float64), -1, 0)
        left_m, top_m = self.floor.origin_m
        return np.stack([left_m + column * self.floor.resolution_m, top_m - row * self.floor.resolution_m], -1)

    def inside(self, pixel: np.ndarray) -> np.ndarray:
        """Return whether pixels (row, column) lie on the masks, (...,) bool."""
        return np.all((pixel >= 0) & (pixel < np.array(self.floor.free.shape)), axis=-1)

    def world(self, pixel: np.ndarray) -> tuple[float, float, float]:
        """Return the point (x, y, z) in metres on the floor at one pixel (row, column)."""
        x, y = self.to_metres(pixel)
        return float(x), float(y), float(self.floor.z_m)


def cell(position: np.ndarray) -> tuple[int, int]:
    """Return the pixel (row, column) that contains a position in the same order."""
    row, column = np.floor(position).astype(int)
    return int(row), int(column)


def nearest_pixel(allowed: np.ndarray, position: np.ndarray) -> np.ndarray | None:
    """Return the position (row, column), (2,), unchanged if its pixel is true in `allowed` (rows, columns); otherwise
    the centre of the nearest true pixel; None if no pixel is true."""
    if allowed[cell(position)]:
        return position
    centres = np.argwhere(allowed) + 0.5
    return centres[np.linalg.norm(centres - position, axis=1).argmin()] if len(centres) else None


def has_line_of_sight(clear: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return whether all pixels on the straight line from start to end are clear.

    The test is exact: it includes every pixel that the line crosses.

    Args:
        clear: (rows, columns) bool.
        start: (P, 2) float64, positions (row, column) on `clear`.
        end: (P, 2) float64, positions (row, column) on `clear`.

    Returns:
        (P,) bool.
    """
    visible = _at(clear, start) & _at(clear, end)
    steep = np.abs(end[:, 0] - start[:, 0]) > np.abs(end[:, 1] - start[:, 1])
    for image, selected, axes in ((clear, ~steep, [0, 1]), (clear.T, steep, [1, 0])):
        pairs = np.flatnonzero(selected & visible)
        visible[pairs] = _is_flat_line_clear(image, start[pairs][:, axes], end[pairs][:, axes])
    return visible


def _at(image: np.ndarray, position: np.ndarray) -> np.ndarray:
    row, column = np.floor(position).astype(int).T
    return image[row, column]


def _is_flat_line_clear(clear: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the result of `has_line_of_sight` for lines that cross at least as many columns as rows. Such a line is
    clear if, at each crossing from one column to the next, the pixels on both sides are clear."""
    swap = start[:, 1] > end[:, 1]
    start, end = np.where(swap[:, None], end, start), np.where(swap[:, None], start, end)
    across = end[:, 1] - start[:, 1]
    slope = np.divide(end[:, 0] - start[:, 0], across, out=np.zeros(len(across)), where=across > 0)
    first = np.floor(start[:, 1]).astype(int) + 1
    count = np.floor(end[:, 1]).astype(int) + 1 - first
    passable = clear[:, :-1] & clear[:, 1:]  # [row, column - 1]: from a column to the next
    visible = np.ones(len(start), bool)
    chunk = np.cumsum(count) // _CROSSINGS_AT_ONCE
    for number in np.unique(chunk):
        pairs = np.flatnonzero(chunk == number)
        owner = np.repeat(pairs, count[pairs])
        before = np.repeat(np.cumsum(count[pairs]) - count[pairs], count[pairs])
        column = first[owner] + np.arange(len(owner)) - before
        row = np.floor(start[owner, 0] + (column - start[owner, 1]) * slope[owner]).astype(int)
        visible[owner[~passable[row, column - 1]]] = False
    return visible


def pixel_graph(mask: np.ndarray) -> csr_matrix:
    """Return the graph of the steps between neighbouring pixels of a mask.

    Steps lead to the 8 neighbours of a pixel. A diagonal step requires that both pixels beside it are in the mask.

    Returns:
        (N, N) symmetric sparse matrix of lengths in pixels between the N pixels of the mask, in the order of
        np.nonzero.
    """
    from scipy.sparse import coo_matrix

    number = np.full((mask.shape[0] + 1, mask.shape[1] + 1), -1)
    number[:-1, :-1][mask] = np.arange(mask.sum())
    here, right, down, diagonal = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    square = (here >= 0) & (right >= 0) & (down >= 0) & (diagonal >= 0)
    steps = [
        (here, right, (here >= 0) & (right >= 0), 1.0),
        (here, down, (here >= 0) & (down >= 0), 1.0),
        (here, diagonal, square, np.sqrt(2)),
        (right, down, square, np.sqrt(2)),
    ]
    start = np.concatenate([a[where] for a, _, where, _ in steps])
    end = np.concatenate([b[where] for _, b, where, _ in steps])
    length = np.concatenate([np.full(np.count_nonzero(where), length) for _, _, where, length in steps])
    both = (np.concatenate([length, length]), (np.concatenate([start, end]), np.concatenate([end, start])))
    return coo_matrix(both, (int(mask.sum()),) * 2).tocsr()
