"""Irradiance computed on a coarse grid of a panorama's pixels, smoothed and brought to any surface without crossing
edges."""

from __future__ import annotations

import numpy as np

from salframe_house.tracing import RayHits, chunks, rows

_TAPS = ((-2, 0.125), (-1, 0.25), (0, 0.25), (1, 0.25), (2, 0.125))  # each of 4 interleaved sample sets weighs the same
_FLOOR = np.float32(1e-5)  # the weight of a neighbour on another surface: counts only where there is no better one


class IrradianceGrid:
    """Irradiance at every `step`-th row and column of a panorama of this height.

    `surface` holds what all H * 2H pixels hit, row by row; `index` are the positions of the grid's points among them.
    """

    def __init__(self, surface: RayHits, height: int, step: int):
        self._step = step
        self._shape = self._rows, self._columns = height // step, 2 * height // step
        self.index = np.arange(height * 2 * height).reshape(height, 2 * height)[::step, ::step].ravel()
        row, column = np.divmod(np.arange(len(self.index)), self._columns)
        self.sample_set = _DITHER[row % 4, column % 4]
        """(N,) int: the set of samples of each point, all 16 in each 4 x 4 points."""
        self.point_m, self.normal = rows(surface.point_m, self.index), rows(surface.normal, self.index)
        self._tolerance_m = _tolerance_m(surface.range_m.take(self.index))
        self._packed = np.empty((9, len(self.index)), np.float32)
        self._packed[:3], self._packed[3:6] = self.point_m.T, self.normal.T

    def fill(self, irradiance: np.ndarray) -> None:
        """Take irradiance (N, 3) of the grid's points, smoothed over the interleaved samples."""
        point, normal, value = (a.T.reshape(3, *self._shape) for a in (self.point_m, self.normal, irradiance))
        tolerance_m = self._tolerance_m.reshape(self._shape)
        for axis in (1, 0):
            total, weights = np.zeros_like(value), np.zeros(self._shape, np.float32)
            for shift, tap in _TAPS:
                weight = _likeness(
                    point, normal, _shifted(point, shift, axis), _shifted(normal, shift, axis), tolerance_m
                )
                weight *= tap
                total += weight * _shifted(value, shift, axis)
                weights += weight
            value = total / weights
        self._packed[6:] = value.reshape(3, -1)

    def add(self, irradiance: np.ndarray) -> None:
        """Add irradiance (N, 3) that is smooth already."""
        self._packed[6:] += irradiance.T

    def at(self, row: np.ndarray, column: np.ndarray, surface: RayHits) -> np.ndarray:
        """(M, 3) float32 irradiance of surfaces seen at pixel coordinates `row`, `column` (M,), whole numbers at pixel
        centres; in Fortran order."""
        irradiance = np.empty((3, len(surface)), np.float32)
        for part in chunks(len(surface)):
            irradiance[:, part] = self._at(
                row[part], column[part], surface.point_m[part].T, surface.normal[part].T, surface.range_m[part]
            )
        return irradiance.T

    def _at(self, row, column, point_m, normal, range_m) -> np.ndarray:
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
                weight = _likeness(point_m, normal, near[:3], near[3:6], tolerance_m)
                weight *= share_row * share_column + np.float32(1e-3)
                near[6:] *= weight
                total += near[6:]
                weights += weight
        total /= weights
        return total


_DITHER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])


def _tolerance_m(range_m: np.ndarray) -> np.ndarray:
    """How far off a plane points of one surface may lie, seen from this far."""
    return np.float32(0.02) + np.float32(0.01) * np.fmax(range_m, 0)


def _shifted(image: np.ndarray, shift: int, axis: int) -> np.ndarray:
    """The image (3, rows, columns) moved by some pixels: around the seam along columns, repeating the border along
    rows."""
    if axis == 1:
        return np.roll(image, shift, axis=2)
    return image.take(np.clip(np.arange(image.shape[1]) - shift, 0, image.shape[1] - 1), axis=1)


def _likeness(point_m, normal, other_point_m, other_normal, tolerance_m) -> np.ndarray:
    """How far two points lie on one smooth surface: 1 on a plane, falling with the distance off it and the angle
    between the normals. Of vectors (3, ...)."""
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
    facing += _FLOOR
    return facing
