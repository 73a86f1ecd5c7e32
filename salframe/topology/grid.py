"""A floor's pixels: where a robot may stand, which region each pixel belongs to, what sees what, and the shortest way
between."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from salframe.panoramas.floors import FloorMasks

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

_CROSSINGS_AT_ONCE = 4_000_000


class FloorGrid:
    """The masks of a floor as a robot of this radius meets them; positions are pixels (row, column), pixel centres at
    +0.5.

    walkable (rows, columns) bool: free floor without obstacles; clear bool: walkable, and the pixel's centre at least
    the radius from what blocks (exact along the pixels' axes); label int32: the region of each walkable pixel.
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
        """Regions grown over the free floor that has none, each pixel to the region that is nearest to walk to.

        So the labels of two regions meet in the middle of a threshold however thick the wall
        (docs/how-to/maps.md#what-the-map-is-made-of). Floor from which no region can be reached keeps 0.
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
        """Place of each region label; a label without a name is called after its number."""
        return {
            int(label): self.floor.regions.get(int(label), f"region-{label}")
            for label in np.unique(self.label)
            if label
        }

    def to_pixel(self, xy_m: np.ndarray) -> np.ndarray:
        """(..., 2) pixels (row, column), float64, of world positions (x, y) in metres."""
        x, y = np.moveaxis(np.asarray(xy_m, np.float64), -1, 0)
        left_m, top_m = self.floor.origin_m
        return np.stack([(top_m - y) / self.floor.resolution_m, (x - left_m) / self.floor.resolution_m], -1)

    def to_metres(self, pixel: np.ndarray) -> np.ndarray:
        """(..., 2) world positions (x, y) in metres of pixels (row, column)."""
        row, column = np.moveaxis(np.asarray(pixel, np.float64), -1, 0)
        left_m, top_m = self.floor.origin_m
        return np.stack([left_m + column * self.floor.resolution_m, top_m - row * self.floor.resolution_m], -1)

    def inside(self, pixel: np.ndarray) -> np.ndarray:
        """(...,) bool: whether pixels (row, column) lie on the masks."""
        return np.all((pixel >= 0) & (pixel < np.array(self.floor.free.shape)), axis=-1)

    def world(self, pixel: np.ndarray) -> tuple[float, float, float]:
        """The point (x, y, z) in metres on the floor at one pixel (row, column)."""
        x, y = self.to_metres(pixel)
        return float(x), float(y), float(self.floor.z_m)


def cell(position: np.ndarray) -> tuple[int, int]:
    """The pixel that a position (row, column) lies in."""
    row, column = np.floor(position).astype(int)
    return int(row), int(column)


def nearest_pixel(allowed: np.ndarray, position: np.ndarray) -> np.ndarray | None:
    """The position (row, column) itself where its pixel is allowed, else the centre of the nearest pixel that is; None
    where none is."""
    if allowed[cell(position)]:
        return position
    centres = np.argwhere(allowed) + 0.5
    return centres[np.linalg.norm(centres - position, axis=1).argmin()] if len(centres) else None


def sees(clear: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(P,) bool: whether all pixels that the straight line from start to end passes through are clear.

    clear (rows, columns) bool; start, end (P, 2) float64 positions (row, column) on it. Exact: every pixel the line
    crosses counts.
    """
    seen = _at(clear, start) & _at(clear, end)
    steep = np.abs(end[:, 0] - start[:, 0]) > np.abs(end[:, 1] - start[:, 1])
    for image, chosen, axes in ((clear, ~steep, [0, 1]), (clear.T, steep, [1, 0])):
        pairs = np.flatnonzero(chosen & seen)
        seen[pairs] = _sees_flat(image, start[pairs][:, axes], end[pairs][:, axes])
    return seen


def _at(image: np.ndarray, position: np.ndarray) -> np.ndarray:
    row, column = np.floor(position).astype(int).T
    return image[row, column]


def _sees_flat(clear: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """`sees` for lines that cross at least as many columns as rows: where such a line crosses from a column to the
    next, both pixels count."""
    swap = start[:, 1] > end[:, 1]
    start, end = np.where(swap[:, None], end, start), np.where(swap[:, None], start, end)
    across = end[:, 1] - start[:, 1]
    slope = np.divide(end[:, 0] - start[:, 0], across, out=np.zeros(len(across)), where=across > 0)
    first = np.floor(start[:, 1]).astype(int) + 1
    count = np.floor(end[:, 1]).astype(int) + 1 - first
    passable = clear[:, :-1] & clear[:, 1:]  # [row, column - 1]: from a column to the next
    seen = np.ones(len(start), bool)
    chunk = np.cumsum(count) // _CROSSINGS_AT_ONCE
    for number in np.unique(chunk):
        pairs = np.flatnonzero(chunk == number)
        owner = np.repeat(pairs, count[pairs])
        before = np.repeat(np.cumsum(count[pairs]) - count[pairs], count[pairs])
        column = first[owner] + np.arange(len(owner)) - before
        row = np.floor(start[owner, 0] + (column - start[owner, 1]) * slope[owner]).astype(int)
        seen[owner[~passable[row, column - 1]]] = False
    return seen


def pixel_graph(mask: np.ndarray) -> csr_matrix:
    """Steps between the N pixels of a mask, in the order of np.nonzero, as an (N, N) sparse matrix of lengths in
    pixels, each both ways.

    Steps go to 8 neighbours; a diagonal one only where both pixels beside it are in the mask too.
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
