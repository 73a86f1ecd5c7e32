"""Resection: position and heading of a camera from directions (azimuth and elevation) to points of known position."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from salframe.localization.positioner import PoseEstimate, PoseStatus
from salframe.panoramas.geometry import pose_2d, wrap_angle

MAX_SD_M, MAX_SD_RAD = 1.0, np.radians(10)
"""Maximum standard deviations of a position and of a heading. Poses with larger ones are not reported."""
MIN_SD_M = 0.1
"""Lower bound of the standard deviation of a residual: objects are not points, so their visible centres vary."""
SEPARATE_M, SEPARATE_RAD = 0.5, np.radians(30)
"""Minimum differences of position and of heading; two poses are different if they exceed one of them."""
_NUM_REFINED, _ROUNDS = 20, 10
"""Number of hypotheses to refine, and maximum number of Gauss-Newton steps of each."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """The conditions of M directions on a pose, linear in v = (cos yaw, sin yaw, t).

    t (2,) is the position in the axes of the query.

    Attributes:
        lateral: (M, 4); lateral @ v is the distance of each point from the vertical plane of its direction, in metres.
        forward: (M, 4); forward @ v is the horizontal distance in that plane from the camera to each point, in metres.
        cos_elevation: (M,) cosine of the elevation.
        sin_elevation: (M,) sine of the elevation.
        z_m: (M,) height of each point above the camera in metres.
    """

    lateral: np.ndarray
    forward: np.ndarray
    cos_elevation: np.ndarray
    sin_elevation: np.ndarray
    z_m: np.ndarray

    def distance_m(self, v: np.ndarray) -> np.ndarray:
        """Return the distance (..., M) in metres of each of the M points from its ray.

        The ray of a point starts at the camera, whose poses are v (..., 4), and has the measured direction of the
        point. The distance of a point behind the camera is infinite.
        """
        forward = v @ self.forward.T
        above = self.z_m * self.cos_elevation - forward * self.sin_elevation
        in_front = forward * self.cos_elevation + self.z_m * self.sin_elevation > 0
        return np.where(in_front, np.hypot(v @ self.lateral.T, above), np.inf)


def resect(bearing: np.ndarray, reference_m: np.ndarray, tolerance_m: float, ambiguity: float) -> PoseEstimate:
    """Estimate an upright pose, at the height of the reference frame, from directions to known points.

    Every two directions give a hypothesis if their elevations determine the distances. Every three azimuths give
    another hypothesis. All directions score each hypothesis, and the best hypotheses are refined by least squares on
    their inliers. A position needs three consistent directions. Two consistent directions give at most a heading.

    Args:
        bearing: (M, 3) unit vectors in the query frame.
        reference_m: (M, 3) points in the reference frame, in metres.
        tolerance_m: Maximum distance in metres of a point from the ray of its direction.
        ambiguity: Fraction of the best pose's support. The result is ambiguous, without a pose, if a different pose has
            at least this fraction.
    """
    count = len(bearing)
    if count < 2:
        return PoseEstimate(None, PoseStatus.TOO_FEW, None, np.zeros(count, bool))
    rows = _conditions(bearing, reference_m)
    hypotheses = np.concatenate([_from_pairs(rows), _from_triples(rows)])
    squared = (rows.distance_m(hypotheses) / tolerance_m) ** 2
    support = np.maximum(1 - squared, 0).sum(1)
    top = np.argsort(-support, kind="stable")[:_NUM_REFINED]
    top = top[(squared[top] < 1).sum(1) >= 2]
    if not len(top):
        return PoseEstimate(None, PoseStatus.DEGENERATE, None, np.zeros(count, bool))
    poses = np.array([_fit(rows, hypotheses[i], squared[i] < 1) for i in top])
    support = np.maximum(1 - (rows.distance_m(poses) / tolerance_m) ** 2, 0).sum(1)
    best = int(support.argmax())
    v, inliers = poses[best], squared[top[best]] < 1
    for _ in range(5):
        tighter = _inliers(rows, v, tolerance_m)
        if tighter.sum() < 2 or (tighter == inliers).all():
            break
        inliers = tighter
        v = _fit(rows, v, inliers)
    covariance = _covariance(rows, v, inliers)
    x_m, y_m, yaw_rad = _pose(v)
    sd = np.sqrt(np.diag(covariance))
    heading = yaw_rad if sd[2] <= MAX_SD_RAD else None
    others = np.array([_pose(other) for other in poses]).reshape(-1, 3)
    is_different = (np.hypot(*(others[:, :2] - (x_m, y_m)).T) > SEPARATE_M) | (
        np.abs(wrap_angle(others[:, 2] - yaw_rad)) > SEPARATE_RAD
    )
    runner_up = float(min(support[is_different].max(initial=0) / max(support[best], 1e-12), 1))
    if runner_up >= ambiguity:
        return PoseEstimate(None, PoseStatus.AMBIGUOUS, None, inliers, runner_up)
    if inliers.sum() < 3:
        return PoseEstimate(None, PoseStatus.TOO_FEW, None, inliers, runner_up, heading)
    if heading is None or sd[:2].max() > MAX_SD_M:
        return PoseEstimate(None, PoseStatus.DEGENERATE, None, inliers, runner_up, heading)
    return PoseEstimate(pose_2d(x_m, y_m, yaw_rad), PoseStatus.OK, covariance, inliers, runner_up)


def _conditions(bearing: np.ndarray, reference_m: np.ndarray) -> _Rows:
    x, y, z = np.asarray(reference_m, float).T
    cos_elevation = np.hypot(bearing[:, 0], bearing[:, 1])
    c, s = (
        np.divide(
            bearing[:, axis], cos_elevation, out=np.ones(len(cos_elevation)) * (axis == 0), where=cos_elevation > 0
        )
        for axis in (0, 1)
    )
    return _Rows(
        np.stack([c * y - s * x, -c * x - s * y, s, -c], 1),
        np.stack([c * x + s * y, c * y - s * x, -c, -s], 1),
        cos_elevation,
        bearing[:, 2],
        z,
    )


def _from_pairs(rows: _Rows) -> np.ndarray:
    """Return a pose for each pair of directions whose elevations determine the distances, (H, 4) in all."""
    pair = np.array(list(combinations(range(len(rows.z_m)), 2)))
    matrix = np.concatenate([rows.lateral[pair], rows.sin_elevation[pair, None] * rows.forward[pair]], 1)
    heights = (rows.z_m * rows.cos_elevation)[pair]
    solvable = np.linalg.cond(matrix) < 1e4  # leaves out pairs of horizontal directions
    right = np.concatenate([np.zeros_like(heights), heights], 1)[solvable]
    return _normal(np.linalg.solve(matrix[solvable], right[..., None])[..., 0])


def _from_triples(rows: _Rows) -> np.ndarray:
    """Return a pose for each set of three azimuths, (H, 4) in all. Elevations are not used.

    A pose is the null space of the conditions of the azimuths, with the sign that puts the points in front of the
    camera.
    """
    triple = np.array(list(combinations(range(len(rows.z_m)), 3)), int).reshape(-1, 3)
    _, singular, right = np.linalg.svd(rows.lateral[triple])
    is_determined = singular[:, 2] > 1e-4 * singular[:, 0]  # fails where points and camera lie on one circle
    v = right[is_determined, 3]
    forward = np.einsum("hij,hj->hi", rows.forward[triple[is_determined]], v)
    return _normal(v * np.where(forward.sum(1) < 0, -1, 1)[:, None])


def _normal(v: np.ndarray) -> np.ndarray:
    """Return poses (H, 4) scaled so that cos^2 + sin^2 = 1; poses where both are 0 are left out."""
    norm = np.hypot(v[:, 0], v[:, 1])
    return v[norm > 1e-6] / norm[norm > 1e-6, None]


def _fit(rows: _Rows, v: np.ndarray, inliers: np.ndarray) -> np.ndarray:
    """Return the pose (4,) that minimises the squared distances to the inliers' rays, by Gauss-Newton from v."""
    for _ in range(_ROUNDS):
        residual, jacobian = _linearised(rows, v, inliers)
        step = np.linalg.lstsq(jacobian, -residual, rcond=1e-9)[0]
        yaw_rad = np.arctan2(v[1], v[0]) + step[0]
        v = np.array([np.cos(yaw_rad), np.sin(yaw_rad), *(v[2:] + step[1:])])
        if np.abs(step).max() < 1e-10:
            break
    return v


def _linearised(rows: _Rows, v: np.ndarray, inliers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the horizontal and vertical distances (2 M,) in metres of the inliers from their rays, and the derivatives
    (2 M, 3) of these residuals with respect to yaw and t."""
    matrix = np.concatenate([rows.lateral, -rows.sin_elevation[:, None] * rows.forward])[np.tile(inliers, 2)]
    constant = np.concatenate([np.zeros(len(rows.z_m)), rows.z_m * rows.cos_elevation])[np.tile(inliers, 2)]
    by_yaw = -matrix[:, 0] * v[1] + matrix[:, 1] * v[0]
    return matrix @ v + constant, np.column_stack([by_yaw, matrix[:, 2:]])


def _inliers(rows: _Rows, v: np.ndarray, tolerance_m: float) -> np.ndarray:
    """Return which directions (M,) are inliers.

    The threshold is the smaller of the tolerance and 2.5 standard deviations of the residuals, estimated from their
    median.
    """
    distance = rows.distance_m(v)
    is_near = distance < tolerance_m
    scale = 1.4826 * np.median(distance[is_near]) if is_near.any() else 0.0
    return distance < np.clip(2.5 * scale, 0.1, tolerance_m)


def _pose(v: np.ndarray) -> tuple[float, float, float]:
    """Return x_m, y_m and yaw_rad of v."""
    c, s, along, across = v
    return float(c * along - s * across), float(s * along + c * across), float(np.arctan2(s, c))


def _covariance(rows: _Rows, v: np.ndarray, inliers: np.ndarray) -> np.ndarray:
    """Return the first-order covariance (3, 3) of (x_m, y_m, yaw_rad), very large where it is not constrained."""
    residual, jacobian = _linearised(rows, v, inliers)
    freedom = max(len(residual) - 3, 1)
    variance = max(float(residual @ residual) / freedom, MIN_SD_M**2)
    # A prior with a standard deviation of one kilometre keeps the matrix regular.
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian + 1e-6 * variance * np.eye(3))
    (c, s), (x_m, y_m, _) = v[:2], _pose(v)
    jacobian_of_pose = np.array([[-y_m, c, -s], [x_m, s, c], [1, 0, 0]])
    return jacobian_of_pose @ covariance @ jacobian_of_pose.T
