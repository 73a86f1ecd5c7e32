"""The pose that is answered and outlines under poses, compiled by numba: the same as in numpy but for rounding."""

from __future__ import annotations

import numba
import numpy as np

from salframe_graphs.places.likelihood import Poses
from salframe_graphs.places.outline import ERROR_LOG, MOST_SQUARED, PEAK, STRAY, MapOutlines
from salframe_graphs.places.place_index import PlaceIndex, QueryObjects
from salframe_graphs.places.rates import Rates
from salframe_graphs.places.search import SETTLING_STEPS

_compile = numba.njit(cache=True, nogil=True, error_model="numpy")


def settle(
    query: QueryObjects, index: PlaceIndex, rates: Rates, pose: Poses, share: np.ndarray, least_m: float
) -> tuple[Poses, np.ndarray]:
    """As in search."""
    place, objects = pose.place[0], share.shape[1]
    settled, information = _settle(
        np.column_stack([query.xy_m, query.ray, (rates.range_error_share * query.range_m) ** 2]),
        np.column_stack([index.xy_m[place, :objects], index.variance_m2[place, :objects] + rates.position_error_m**2]),
        np.ascontiguousarray(share),
        np.append(pose.shift_m[0], pose.yaw_rad[0]),
        SETTLING_STEPS,
    )
    covariance = np.linalg.inv(information) + np.diag([least_m**2, least_m**2, 0.0])
    return Poses(pose.place, settled[None, :2], settled[2:]), covariance


def outline_ratio(
    outlines: MapOutlines, query_m: np.ndarray, place: np.ndarray, shift_m: np.ndarray, yaw_rad: np.ndarray
) -> np.ndarray:
    """As of MapOutlines."""
    return outlines.ratio(query_m, place, shift_m, yaw_rad, _fit_outline)


def _fit_outline(offset_m: np.ndarray, yaw_rad: np.ndarray, outline_m: np.ndarray) -> np.ndarray:
    """As in outline."""
    x_m, y_m = np.ascontiguousarray(np.moveaxis(offset_m, -1, 0))
    known = x_m, y_m, np.arctan2(y_m, x_m) - yaw_rad, np.ascontiguousarray(outline_m)
    return _lie_on(*known, ERROR_LOG, STRAY, PEAK, MOST_SQUARED)  # type: ignore[no-any-return]


@_compile
def _settle(query, there, share, start, steps):  # type: ignore[no-untyped-def]
    """The pose, and the information (3, 3) that it was fitted with. query (n, 5): x, y, ray and variance of range;
    there (m, 3): x, y and variance; start (3,): x, y and yaw."""
    pose, slope = start.copy(), np.empty(3)
    information = np.empty((3, 3))
    for _ in range(steps):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        equations = np.zeros((3, 4))
        for row in range(3):
            equations[row, row] = 1e-6
        for i in range(len(query)):
            x, y = c * query[i, 0] - s * query[i, 1], s * query[i, 0] + c * query[i, 1]
            x_ray, y_ray = c * query[i, 2] - s * query[i, 3], s * query[i, 2] + c * query[i, 3]
            for j in range(len(there)):
                if share[i, j] == 0:
                    continue
                along, across = np.float32(there[j, 2] + query[i, 4]), np.float32(there[j, 2])
                x_off, y_off = there[j, 0] - (x + pose[0]), there[j, 1] - (y + pose[1])
                forth, side = x_off * x_ray + y_off * y_ray, y_off * x_ray - x_off * y_ray
                kept = share[i, j] / (1 + forth * forth / along + side * side / across)
                for off, variance, x_axis, y_axis in ((forth, along, x_ray, y_ray), (side, across, -y_ray, x_ray)):
                    slope[0], slope[1], slope[2] = x_axis, y_axis, y_axis * x - x_axis * y
                    for row in range(3):
                        equations[row, 3] += slope[row] * kept / variance * off
                        for column in range(3):
                            equations[row, column] += slope[row] * kept / variance * slope[column]
        for row in range(3):
            for column in range(3):
                information[row, column] = equations[row, column]
        for row in range(3):
            for other in range(3):
                if other != row:
                    factor = equations[other, row] / equations[row, row]
                    for column in range(row, 4):
                        equations[other, column] -= factor * equations[row, column]
        for row in range(3):
            pose[row] += equations[row, 3] / equations[row, row]
    return pose, information


@_compile
def _lie_on(x_m, y_m, azimuth_rad, outline_m, error, stray, peak, most_squared):  # type: ignore[no-untyped-def]
    """Likelihoods (P, B) are multiplied, and only then come the logarithms."""
    bins, turn = outline_m.shape[1], np.float32(2 * np.pi)
    per_radian, sharpness = np.float32(bins / (2 * np.pi)), np.float32(0.5 / error)
    total, furthest = np.empty(len(x_m)), np.exp(np.sqrt(most_squared) / sharpness)
    for p in range(len(x_m)):
        fits = 1.0
        for b in range(bins):
            azimuth = azimuth_rad[p, b]
            if not np.isfinite(azimuth):
                continue
            while azimuth < 0:
                azimuth += turn
            while azimuth >= turn:
                azimuth -= turn
            expected = outline_m[p, min(int(azimuth * per_radian), bins - 1)]
            squared = (x_m[p, b] * x_m[p, b] + y_m[p, b] * y_m[p, b]) / (expected * expected)
            if 1 / furthest < squared < furthest:
                off = sharpness * np.log(squared)
                fits *= stray + (1 - stray) * peak * np.exp(-0.5 * off * off)
            elif 0 < squared < np.inf:
                fits *= stray
        total[p] = np.log(fits)
    return total
