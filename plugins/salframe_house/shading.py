"""Irradiance on a coarse grid of pixels, smoothed and interpolated to surfaces without crossing edges."""

from __future__ import annotations

import numpy as np

from salframe_house.tracing import RayHits, chunks, rows

# Smoothing filter, (shift, weight): the 4 interleaved sample sets have equal total weights.
_TAPS = ((-2, 0.125), (-1, 0.25), (0, 0.25), (1, 0.25), (2, 0.125))
# Weight of a neighbour on another surface: matters only if no neighbour lies on the same surface.
_MIN_WEIGHT = np.float32(1e-5)


class IrradianceGrid:
    """Irradiance at every `step`-th row and column of a panorama.

    Args:
        surface: Hits of all H * 2H pixels, row by row.
        height: Height of the panorama.
        step: Spacing of the grid in pixels.

    Attributes:
        index: Indices of the N grid points among the pixels.
        sample_set: Sample set of each point, (N,) int; each block of 4 x 4 points uses all 16 sets.
        point_m: Positions of the grid points, (N, 3).
        normal: Normals of the grid points, (N, 3).
    """

    def __init__(self, surface: RayHits, height: int, step: int):
        self._step = step
        self._shape = self._rows, self._columns = height // step, 2 * height // step
        self.index = np.arange(height * 2 * height).reshape(height, 2 * height)[::step, ::step].ravel()
        row, column = np.divmod(np.arange(len(self.index)), self._columns)
        self.sample_set = _DITHER[row % 4, column % 4]
        self.point_m, self.normal = rows(surface.point_m, self.index), rows(surface.normal, self.index)
        self._tolerance_m = _tolerance_m(surface.range_m.take(self.index))
        self._packed = np.empty((9, len(self.index)), np.float32)
        self._packed[:3], self._packed[3:6] = self.point_m.T, self.normal.T

    def fill(self, irradiance: np.ndarray) -> None:
        """Set the irradiance of the grid points, (N, 3), smoothed over neighbouring points with other sample sets."""
        point, normal, value = (a.T.reshape(3, *self._shape) for a in (self.point_m, self.normal, irradiance))
        tolerance_m = self._tolerance_m.reshape(self._shape)
        for axis in (1, 0):
            total, weights = np.zeros_like(value), np.zeros(self._shape, np.float32)
            for shift, tap in _TAPS:
                weight = _similarity(
                    point, normal, _shifted(point, shift, axis), _shifted(normal, shift, axis), tolerance_m
                )
                weight *= tap
                total += weight * _shifted(value, shift, axis)
                weights += weight
            value = total / weights
        self._packed[6:] = value.reshape(3, -1)

    def add(self, irradiance: np.ndarray) -> None:
        """Add irradiance (N, 3) without smoothing."""
        self._packed[6:] += irradiance.T

    def at(self, row: np.ndarray, column: np.ndarray, surface: RayHits) -> np.ndarray:
        """Interpolate the irradiance at surface points.

        Args:
            row: Row of the pixel that shows each surface point, (M,). It may be a fraction; whole numbers are pixel
                centres.
            column: Column of the pixel, (M,).
            surface: The M surface points, as hits of rays from the camera.

        Returns:
            (M, 3) float32 in Fortran order.
        """
        irradiance = np.empty((3, len(surface)), np.float32)
        for part in chunks(len(surface)):
            irradiance[:, part] = self._at(
                row[part], column[part], surface.point_m[part].T, surface.normal[part].T, surface.range_m[part]
            )
        return irradiance.T

    def _at(self, row, column, point_m, normal, range_m) -> np.ndarray:
        """Compute `at` for one chunk of surfaces."""
        row, column = row / np.float32(self._step), column / np.float32(self._step)
        top, left = np.floor(row).astype(np.int32), np.floor(column).astype(np.int32)
        down, right = row - top, column - left
        tolerance_m = _tolerance_m(range_m)
        total, weights = np.zeros((3, len(row)), np.float32), np.zeros(len(row), np.float32)
        grid_columns = [((left + step) % self._columns, share) for step, share in ((0, 1 - right), (1, right))]
        for step_row, share_row in ((0, 1 - down), (1, down)):
            grid_row = np.clip(top + step_row, 0, self._rows - 1) * self._columns
            for grid_column, share_column in grid_columns:
                near = self._packed.take(grid_row + grid_column, axis=1)
                weight = _similarity(point_m, normal, near[:3], near[3:6], tolerance_m)
                weight *= share_row * share_column + np.float32(1e-3)
                near[6:] *= weight
                total += near[6:]
                weights += weight
        total /= weights
        return total


_DITHER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])


def _tolerance_m(range_m: np.ndarray) -> np.ndarray:
    """Return the maximum distance of a point from the plane of a surface to which it belongs, at a viewing distance."""
    return np.float32(0.02) + np.float32(0.01) * np.fmax(range_m, 0)


def _shifted(image: np.ndarray, shift: int, axis: int) -> np.ndarray:
    """Shift an image (3, rows, columns) by some pixels.

    Columns wrap around; rows repeat the border.
    """
    if axis == 1:
        return np.roll(image, shift, axis=2)
    return image.take(np.clip(np.arange(image.shape[1]) - shift, 0, image.shape[1] - 1), axis=1)


def _similarity(point_m, normal, other_point_m, other_normal, tolerance_m) -> np.ndarray:
    """Return how likely two points are to lie on one smooth surface.

    Args:
        point_m: Points, (3, ...).
        normal: Normals, (3, ...).
        other_point_m: Other points, (3, ...).
        other_normal: Other normals, (3, ...).
        tolerance_m: Distance from the plane at which the result drops to a quarter.

    Returns:
        1 if both points lie on one plane. The value decreases with the distance from the plane and with the angle
        between the normals.
    """
    facing = np.einsum("i...,i...->...", normal, other_normal)
    np.maximum(facing, 0, out=facing)
    for _ in range(3):
        facing *= facing
    off = np.einsum("i...,i...->...", normal, other_point_m - point_m)
    off /= tolerance_m
    off *= off
    off += 1
    off *= off
    facing /= off
    facing += _MIN_WEIGHT
    return facing
