"""The pose that is answered and outlines under poses, compiled by numba: the same as in numpy but for rounding."""

from __future__ import annotations

import numba
import numpy as np

from salframe_graphs.agreement import TURN_RAD
from salframe_graphs.places.compiled_functions import FREE, exp, log
from salframe_graphs.places.likelihood import Poses
from salframe_graphs.places.outline import ERROR_LOG, MOST_SQUARED, PEAK, STRAY, MapOutlines, own_corners
from salframe_graphs.places.place_index import PlaceIndex, QueryObjects
from salframe_graphs.places.rates import Rates
from salframe_graphs.places.search import SETTLING_STEPS

_F4 = np.float32
_compile = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FREE)


def settle(
    query: QueryObjects, index: PlaceIndex, rates: Rates, pose: Poses, share: np.ndarray, least_m: float
) -> tuple[Poses, np.ndarray]:
    """As in search."""
    place, start = pose.place[0], (pose.shift_m[0, 0], pose.shift_m[0, 1], pose.yaw_rad[0])
    asked = query.xy_m, query.ray, (rates.range_error_share * query.range_m) ** 2
    there = index.xy_m[place], index.variance_m2[place] + rates.position_error_m**2
    settled, covariance = _settle(asked, there, share, np.array(start), SETTLING_STEPS)
    covariance[0, 0], covariance[1, 1] = covariance[0, 0] + least_m**2, covariance[1, 1] + least_m**2
    return Poses(pose.place, settled[None, :2], settled[2:]), covariance


def outline_ratio(
    outlines: MapOutlines, query_m: np.ndarray, place: np.ndarray, shift_m: np.ndarray, yaw_rad: np.ndarray
) -> np.ndarray:
    """As of MapOutlines."""
    query_m, shift_m, yaw_rad = (a.astype(np.float32) for a in (query_m, shift_m, yaw_rad))
    row, frame = np.nonzero(outlines.known[place])
    seen, turn = (place[row], frame), (np.cos(yaw_rad), np.sin(yaw_rad))
    x_m, y_m = _offsets(outlines.corners_m, outlines.pose, *seen, own_corners(query_m), turn, shift_m, row)
    turned = np.arctan2(y_m, x_m), outlines.pose, yaw_rad
    return _lie_on(  # type: ignore[no-any-return]
        (x_m, y_m), turned, outlines.range_m, query_m, *seen, row, (ERROR_LOG, STRAY, PEAK, MOST_SQUARED)
    )


def agreed(score: np.ndarray, T_world_query: np.ndarray, share: float, radius_m: float) -> np.ndarray:
    """As in agreement."""
    return _agreed(score, T_world_query, share, radius_m, TURN_RAD)  # type: ignore[no-any-return]


def label_evidence(label: np.ndarray, index: PlaceIndex, places: np.ndarray) -> np.ndarray:
    """As in evidence."""
    return _label_evidence(label, index.label, places, index.rarity, index.weight)  # type: ignore[no-any-return]


@_compile
def _agreed(score, T_world_query, share, radius_m, turn_rad):  # type: ignore[no-untyped-def]
    raised, pose = score.copy(), np.empty((len(score), 4))
    for k in range(len(score)):
        for axis in range(3):
            pose[k, axis] = T_world_query[k, axis, 3]
        pose[k, 3] = np.arctan2(T_world_query[k, 1, 0], T_world_query[k, 0, 0])
    for k in range(len(score)):
        for other in range(len(score)):
            x, y, z = pose[k, 0] - pose[other, 0], pose[k, 1] - pose[other, 1], pose[k, 2] - pose[other, 2]
            turn = (pose[k, 3] - pose[other, 3] + np.pi) % (2 * np.pi) - np.pi
            near, along = 1 - np.sqrt(x * x + y * y + z * z) / radius_m, 1 - abs(turn) / turn_rad
            if other != k and near > 0 and along > 0:
                raised[k] += share * near * along * score[other]
    return raised


@_compile
def _label_evidence(asked, label, places, rarity, weight):  # type: ignore[no-untyped-def]
    """The rarities of labels that query and place share."""
    found, own = np.empty((len(places), 2)), rarity[asked].sum()
    wanted, left = np.zeros(len(rarity), np.int64), np.zeros(len(rarity), np.int64)
    for one in asked:
        wanted[one] += 1
    for k in range(len(places)):
        shared = 0.0
        left[:] = wanted
        for one in label[places[k]]:
            if one >= 0 and left[one] > 0:
                shared, left[one] = shared + rarity[one], left[one] - 1
        found[k, 0], found[k, 1] = shared / own, shared / (weight[places[k]] + own - shared)
    return found


@_compile
def _settle(query, there, share, start, steps):  # type: ignore[no-untyped-def]
    """The pose, and the inverse (3, 3) of the information that it was fitted with. query: x and y, ray (n, 2) and
    variance of range (n,); there: x and y (M, 2) and variance (M,) of the place's m objects and of padding; share (n,
    m); start (3,): x, y and yaw."""
    (xy_m, ray, of_range), (xy_there_m, variance_there), pose, slope = query, there, start.copy(), np.empty(3)
    information = np.empty((3, 3))
    for _ in range(steps):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        equations = np.zeros((3, 4))
        for row in range(3):
            equations[row, row] = 1e-6
        for i in range(len(xy_m)):
            x, y = c * xy_m[i, 0] - s * xy_m[i, 1], s * xy_m[i, 0] + c * xy_m[i, 1]
            x_ray, y_ray = c * ray[i, 0] - s * ray[i, 1], s * ray[i, 0] + c * ray[i, 1]
            for j in range(share.shape[1]):
                if share[i, j] == 0:
                    continue
                along, across = np.float32(variance_there[j] + of_range[i]), np.float32(variance_there[j])
                x_off, y_off = xy_there_m[j, 0] - (x + pose[0]), xy_there_m[j, 1] - (y + pose[1])
                forth, side = x_off * x_ray + y_off * y_ray, y_off * x_ray - x_off * y_ray
                kept = share[i, j] / (1 + forth * forth / along + side * side / across)
                for off, variance, x_axis, y_axis in ((forth, along, x_ray, y_ray), (side, across, -y_ray, x_ray)):
                    slope[0], slope[1], slope[2] = x_axis, y_axis, y_axis * x - x_axis * y
                    for row in range(3):
                        equations[row, 3] += slope[row] * kept / variance * off
                        for column in range(3):
                            equations[row, column] += slope[row] * kept / variance * slope[column]
        information[:] = equations[:, :3]
        pose += np.linalg.solve(information, equations[:, 3].copy())
    return pose, np.linalg.inv(information)


@numba.njit(cache=True, nogil=True, error_model="numpy")  # to the last bit, which decides in which bin a point is
def _offsets(corners_m, pose, place, frame, own_m, turn, shift_m, row):  # type: ignore[no-untyped-def]
    """Of P frames, each under the query's pose of its row: x and y (P, 2, B) of its outline's points from the query,
    and of the query's from it."""
    bins = corners_m.shape[2]
    x_m, y_m = np.empty((len(row), 2, bins), np.float32), np.empty((len(row), 2, bins), np.float32)
    for p in range(len(row)):
        there, stood, shift = corners_m[place[p], frame[p]], pose[place[p], frame[p]], shift_m[row[p]]
        c, s = turn[0][row[p]], turn[1][row[p]]
        for b in range(bins):
            x_m[p, 0, b], y_m[p, 0, b] = there[b, 0] - shift[0], there[b, 1] - shift[1]
            x, y = c * own_m[b, 0] - s * own_m[b, 1], s * own_m[b, 0] + c * own_m[b, 1]
            x_m[p, 1, b], y_m[p, 1, b] = x + shift[0] - stood[0], y + shift[1] - stood[1]
    return x_m, y_m


@_compile
def _lie_on(offset_m, turned, range_m, query_m, place, frame, row, constants):  # type: ignore[no-untyped-def]
    """(C,) the best of each pose's frames, 0 where it has none. Likelihoods are multiplied, and only then come the
    logarithms."""
    (x_m, y_m), (azimuth_rad, pose, yaw_rad), bins = offset_m, turned, len(query_m)
    error, stray, peak, most_squared = constants
    furthest = _F4(np.exp(2 * error * np.sqrt(most_squared)))
    sharpness, fitting, stray = _F4(0.5 / error), _F4((1 - stray) * peak), _F4(stray)
    turn, per_radian, expected = _F4(2 * np.pi), _F4(bins / (2 * np.pi)), np.empty(bins, np.float32)
    best, known = np.zeros(len(yaw_rad)), np.zeros(len(yaw_rad), np.bool_)
    for p in range(len(row)):
        total = 0.0
        for side in range(2):
            outline_m = query_m if side == 0 else range_m[place[p], frame[p]]
            yaw = yaw_rad[row[p]] if side == 0 else pose[place[p], frame[p], 2]
            for b in range(bins):
                azimuth = azimuth_rad[p, side, b] - yaw
                if np.isfinite(azimuth):
                    while azimuth < 0:
                        azimuth += turn
                    while azimuth >= turn:
                        azimuth -= turn
                    expected[b] = outline_m[min(int(azimuth * per_radian), bins - 1)]
            x, y, fits = x_m[p, side], y_m[p, side], 1.0
            for b in range(bins):
                squared = (x[b] * x[b] + y[b] * y[b]) / (expected[b] * expected[b])
                off = sharpness * log(min(max(squared, 1 / furthest), furthest))
                ratio = stray + fitting * exp(_F4(-0.5) * off * off)
                fits *= ratio if 0 < squared < np.inf else _F4(1)
            total += np.log(fits)
        if not known[row[p]] or total > best[row[p]]:
            best[row[p]], known[row[p]] = total, True
    return best
