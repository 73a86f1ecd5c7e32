"""The free space of a storey, from range images: ray casting into an occupancy grid (Moravec and Elfes 1985)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.floors import MAX_PIXELS
from salframe.panoramas.geometry import equirectangular_rays

RESOLUTION_M = 0.05
"""Size of a grid cell in metres."""
BAND_M = 0.15, 1.8
"""Minimum and maximum height above the floor, in metres, of a surface that is an obstacle. Lower surfaces are floor."""
TALL_M = 1.5, 2.2
"""Minimum and maximum height above the floor, in metres, of a surface that makes its cell a tall obstacle: a wall or
tall furniture."""
MAX_RANGE_M = 8.0
"""Maximum horizontal distance, in metres, of the surfaces in use. Beyond it, neighbouring pixels are more than a cell
apart."""
SELF_M = 0.3
"""Horizontal distance from the camera, in metres, within which surfaces are ignored: they belong to the tripod, the
robot or the person with the camera."""
LOG_ODDS_OCCUPIED, LOG_ODDS_FREE = 1.4, -0.7
"""Changes of the log odds of a cell, for each panorama that shows a surface in the cell, and for each panorama that
shows the cell to be empty. They correspond to probabilities of 0.80 and 0.33."""
MAX_LOG_ODDS = 5.0
"""Maximum magnitude of the log odds of a cell."""
MAX_HOLE_M2 = 0.5
"""Maximum area, in square metres, of an unseen part of the floor that is treated as a low obstacle. Such a part is, for
example, hidden by a chair."""
SLIVER_M = 0.35
"""Maximum width, in metres, of an unseen strip of floor that is treated as walkable. Such a strip lies between the
areas that two panoramas show. A wider unseen part may contain an obstacle."""
MAX_ROWS = 512
"""Maximum number of rows of a range image after subsampling."""


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """The free space of a storey. Row 0 is at the largest y, as in `FloorMasks`.

    Attributes:
        walkable: (rows, columns) bool, cells without an obstacle.
        low: (rows, columns) bool, cells with an obstacle that is not tall, such as a chair, and cells of small
            areas that no panorama shows.
        origin_m: World (x, y) of the upper left corner, in metres.
        resolution_m: Size of a cell in metres.
    """

    walkable: np.ndarray
    low: np.ndarray
    origin_m: tuple[float, float]
    resolution_m: float = RESOLUTION_M

    @property
    def floor(self) -> np.ndarray:
        """(rows, columns) bool, walkable cells and low obstacles: the floor that walls and tall furniture enclose."""
        return self.walkable | self.low

    def cells(self, xy_m: np.ndarray) -> np.ndarray:
        """Return the cells (row, column), (N, 2) int, of world positions (x, y) in metres, (N, 2). The cells may lie
        outside of the grid."""
        return _cells(xy_m, self.origin_m, self.resolution_m)


class OccupancyGrid:
    """An occupancy grid of one storey, to which panoramas are added.

    A panorama votes for an obstacle in a cell if it shows a surface between the heights BAND_M above the cell. It votes
    for a free cell if it shows the floor in the cell, or if the cell lies between the camera and the nearest obstacle
    in its direction. Above such a cell, all lines of sight are unobstructed, so that the space between the heights
    BAND_M is empty. The votes are summed as log odds.
    """

    def __init__(self, camera_xy_m: np.ndarray, z_m: float) -> None:
        """Create a grid around cameras.

        Args:
            camera_xy_m: (N, 2) positions of all cameras of the storey in the world frame.
            z_m: Height of the floor in the world frame.

        Raises:
            DataError: The cameras are too far apart for one grid.
        """
        low_m = np.floor((camera_xy_m.min(0) - MAX_RANGE_M) / RESOLUTION_M).astype(int)
        high_m = np.ceil((camera_xy_m.max(0) + MAX_RANGE_M) / RESOLUTION_M).astype(int)
        columns, rows = (high_m - low_m + 1).tolist()
        if rows * columns > MAX_PIXELS:
            raise DataError(
                f"the cameras at z = {z_m:.1f} m span {columns} x {rows} cells of {RESOLUTION_M:g} m, expected at most "
                f"{MAX_PIXELS} cells: check that the poses are in metres"
            )
        self.origin_m = float(low_m[0] * RESOLUTION_M), float((high_m[1] + 1) * RESOLUTION_M)
        self._z_m = z_m
        self._log_odds = np.zeros((rows, columns), np.float32)
        self._tall = np.zeros((rows, columns), bool)

    def add(self, range_m: np.ndarray, T_world_pano: np.ndarray) -> None:
        """Add a panorama.

        Args:
            range_m: (H, 2H) range along the ray in metres, NaN where unknown.
            T_world_pano: (4, 4) pose.
        """
        step = max(1, len(range_m) // MAX_ROWS)
        rays = equirectangular_rays(len(range_m))[step // 2 :: step, step // 2 :: step]
        range_m = range_m[step // 2 :: step, step // 2 :: step]
        is_known = np.isfinite(range_m)
        offset_m = (rays[is_known] * range_m[is_known, None]) @ T_world_pano[:3, :3].T.astype(np.float32)
        height_m = offset_m[:, 2] + np.float32(T_world_pano[2, 3] - self._z_m)
        distance_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
        is_used = (height_m < TALL_M[1]) & (distance_m < MAX_RANGE_M) & (distance_m > SELF_M)
        offset_m, height_m, distance_m = offset_m[is_used, :2], height_m[is_used], distance_m[is_used]
        # Half a cell farther, so that the cell before a surface on the border of two cells stays free.
        behind_m = offset_m * (1 + RESOLUTION_M / 2 / distance_m)[:, None] + T_world_pano[:2, 3]
        in_band = (height_m >= BAND_M[0]) & (height_m <= BAND_M[1])
        is_tall = (height_m >= TALL_M[0]) & (height_m <= TALL_M[1])
        is_floor = height_m < BAND_M[0]

        free = self._polygon(offset_m, distance_m, in_band, is_floor, range_m.shape[1], T_world_pano[:2, 3])
        free[self._inside(offset_m[is_floor] + T_world_pano[:2, 3])] = True
        occupied = np.zeros(free.shape, bool)
        occupied[self._inside(behind_m[in_band])] = True
        self._tall[self._inside(behind_m[is_tall])] = True
        self._log_odds[free & ~occupied] += LOG_ODDS_FREE
        self._log_odds[occupied] += LOG_ODDS_OCCUPIED
        np.clip(self._log_odds, -MAX_LOG_ODDS, MAX_LOG_ODDS, out=self._log_odds)

    def _polygon(
        self,
        offset_m: np.ndarray,
        distance_m: np.ndarray,
        in_band: np.ndarray,
        is_floor: np.ndarray,
        num_directions: int,
        camera_xy_m: np.ndarray,
    ) -> np.ndarray:
        """Return the cells between the camera and the nearest obstacle in each direction, (rows, columns) bool. In a
        direction without an obstacle, these cells end at the farthest visible floor."""
        import cv2

        turn = np.arctan2(offset_m[:, 1], offset_m[:, 0]) / (2 * np.pi) % 1
        direction = np.minimum((turn * num_directions).astype(int), num_directions - 1)
        nearest_m = np.full(num_directions, np.inf)
        np.minimum.at(nearest_m, direction[in_band], distance_m[in_band])
        farthest_m = np.zeros(num_directions)
        np.maximum.at(farthest_m, direction[is_floor], distance_m[is_floor])
        reach_m = np.where(np.isfinite(nearest_m), nearest_m, farthest_m)
        azimuth = (np.arange(num_directions) + 0.5) * 2 * np.pi / num_directions
        corners_m = camera_xy_m + reach_m[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], 1)
        # fillPoly also fills the cells on the outline. In OpenCV, pixel centres have integer coordinates.
        pixels = (corners_m - self.origin_m) / (RESOLUTION_M, -RESOLUTION_M) - 0.5
        filled = np.zeros(self._log_odds.shape, np.uint8)
        cv2.fillPoly(filled, [np.round(pixels * 16).astype(np.int32)], 1, shift=4)
        return filled > 0

    def _inside(self, xy_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows and columns of the positions (N, 2) that lie on the grid."""
        cells = _cells(xy_m, self.origin_m)
        row, column = cells[((cells >= 0) & (cells < self._log_odds.shape)).all(1)].T
        return row, column

    def free_space(self, camera_xy_m: np.ndarray) -> FreeSpace:
        """Return the free space that is connected with a camera position, cropped to its extent.

        Args:
            camera_xy_m: (N, 2) positions of cameras in the world frame. Cells within SELF_M of a camera are free if no
                surface was seen in them.
        """
        import cv2
        from scipy import ndimage

        walkable, occupied = self._log_odds < 0, self._log_odds > 0
        cells = _cells(camera_xy_m, self.origin_m)
        stand = np.zeros(walkable.shape, np.uint8)
        for row, column in cells.tolist():
            cv2.circle(stand, (column, row), int(SELF_M / RESOLUTION_M), 1, -1)
        walkable |= (stand > 0) & ~occupied
        walkable |= _slivers(walkable, ~walkable & ~occupied, self._tall & occupied)
        low = (occupied & ~self._tall) | _small_parts(~walkable & ~occupied, MAX_HOLE_M2)
        parts, _ = ndimage.label(walkable | low)
        visited = np.unique(parts[tuple(cells.T)])
        is_connected = np.isin(parts, visited[visited > 0])
        rows, columns = (np.flatnonzero(is_connected.any(axis)) for axis in (1, 0))
        if not len(rows):
            return FreeSpace(walkable[:0, :0], walkable[:0, :0], self.origin_m)
        window = slice(rows[0] - 1, rows[-1] + 2), slice(columns[0] - 1, columns[-1] + 2)
        left_m, top_m = self.origin_m
        origin_m = float(left_m + (columns[0] - 1) * RESOLUTION_M), float(top_m - (rows[0] - 1) * RESOLUTION_M)
        return FreeSpace((walkable & is_connected)[window], (low & is_connected)[window], origin_m)


def _slivers(walkable: np.ndarray, unseen: np.ndarray, tall: np.ndarray) -> np.ndarray:
    """Return the unseen cells in gaps of at most SLIVER_M between walkable cells, (rows, columns) bool. Cells in or
    near walls are excluded."""
    import cv2

    size = round(SLIVER_M / RESOLUTION_M)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    closed = cv2.morphologyEx(walkable.astype(np.uint8), cv2.MORPH_CLOSE, disc) > 0
    near_wall = cv2.dilate(tall.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return closed & unseen & ~near_wall  # type: ignore[no-any-return]


def _small_parts(mask: np.ndarray, max_area_m2: float) -> np.ndarray:
    """Return the mask without its connected parts that are larger than a maximum area."""
    from scipy import ndimage

    parts, _ = ndimage.label(mask)
    return mask & (np.bincount(parts.ravel())[parts] * RESOLUTION_M**2 <= max_area_m2)


def _cells(xy_m: np.ndarray, origin_m: tuple[float, float], resolution_m: float = RESOLUTION_M) -> np.ndarray:
    """Return the cells (row, column), (N, 2) int, of world positions (x, y) in metres, (N, 2)."""
    column, row = np.floor((xy_m - origin_m) / (resolution_m, -resolution_m)).astype(int).T
    return np.stack([row, column], 1)
