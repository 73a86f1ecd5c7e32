"""Pose of a query panorama from bearings and map points: P3P hypotheses, then refinement on the sphere."""

from __future__ import annotations

import numpy as np

REFINEMENTS = 4
STEPS = 5


def robust_pose(
    bearings: np.ndarray, points_m: np.ndarray, inlier_rad: float, hypotheses: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate a pose from matches with outliers.

    Random samples of three matches are solved by P3P. The best solution minimises the sum of squared errors, each
    truncated at the inlier bound (MSAC, Torr and Zisserman 2000). The best solution is refined in a few rounds. Each
    round minimises the squared angles of the inliers and then selects the inliers again.

    Args:
        bearings: (M, 3) unit vectors in the query frame.
        points_m: (M, 3) matched points in the reference frame, in metres.
        inlier_rad: Maximum angle between the bearing of an inlier and the direction to its point.
        hypotheses: Number of random samples.
        rng: Random generator of the samples.

    Returns:
        T_reference_query (4, 4) and the inliers (M,) bool. With fewer than 4 matches, the identity and no inlier.
    """
    count = len(bearings)
    if count < 4:
        return np.eye(4), np.zeros(count, bool)
    samples = rng.integers(0, count, (hypotheses, 3))  # a sample with a repeated match is degenerate and gives no pose
    rotations, centres = solve_p3p(bearings[samples], points_m[samples])
    if not len(rotations):
        return np.eye(4), np.zeros(count, bool)
    cosine = np.cos(inlier_rad)
    # 1 - cos is half the squared angle. The number of inliers is a worse criterion: refinement of the solution with the
    # largest number of inliers often loses a few of them
    cost = np.minimum(1 - _cosines(rotations, centres, bearings, points_m), 1 - cosine).sum(1)
    best = int(cost.argmin())
    rotation, centre = rotations[best], centres[best]
    inliers = _cosines(rotation[None], centre[None], bearings, points_m)[0] > cosine
    for _ in range(REFINEMENTS):
        rotation, centre = _refine(rotation, centre, bearings[inliers], points_m[inliers])
        inliers = _cosines(rotation[None], centre[None], bearings, points_m)[0] > cosine
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, centre
    return pose, inliers


def _cosines(rotations, centres, bearings, points_m):
    """Return (H, M) cosines between bearings and the directions to the points, for camera centres (H, 3) and rotations
    (H, 3, 3) from the query to the reference frame."""
    directions = np.einsum("hij,mj->hmi", rotations, bearings)
    along = np.einsum("hmi,mi->hm", directions, points_m) - np.einsum("hmi,hi->hm", directions, centres)
    squared = (points_m**2).sum(1) - 2 * centres @ points_m.T + (centres**2).sum(1)[:, None]
    return along / np.sqrt(np.maximum(squared, 1e-12))


def solve_p3p(bearings: np.ndarray, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve the perspective-three-point problem for many samples at once.

    The method is Grunert's solution in Haralick et al., "Review and analysis of solutions of the three point
    perspective pose estimation problem" (1994). Degenerate samples have no solution.

    Args:
        bearings: (S, 3, 3) unit vectors in the query frame: sample, match, coordinates.
        points_m: (S, 3, 3) points in the reference frame.

    Returns:
        Rotations (H, 3, 3) and translations (H, 3) from the query to the reference frame, all solutions of all samples.
    """
    f, p = bearings, points_m
    a2, b2, c2 = (((p[:, i] - p[:, j]) ** 2).sum(1) for i, j in ((1, 2), (0, 2), (0, 1)))
    cos_a, cos_b, cos_c = ((f[:, i] * f[:, j]).sum(1) for i, j in ((1, 2), (0, 2), (0, 1)))
    with np.errstate(divide="ignore", invalid="ignore"):
        q, r = (a2 - c2) / b2, (a2 + c2) / b2
        quartic = np.stack(
            [
                (q - 1) ** 2 - 4 * c2 / b2 * cos_a**2,
                4 * (q * (1 - q) * cos_b - (1 - r) * cos_a * cos_c + 2 * c2 / b2 * cos_a**2 * cos_b),
                2
                * (
                    q**2
                    - 1
                    + 2 * q**2 * cos_b**2
                    + 2 * (b2 - c2) / b2 * cos_a**2
                    - 4 * r * cos_a * cos_b * cos_c
                    + 2 * (b2 - a2) / b2 * cos_c**2
                ),
                4 * (-q * (1 + q) * cos_b + 2 * a2 / b2 * cos_c**2 * cos_b - (1 - r) * cos_a * cos_c),
                (1 + q) ** 2 - 4 * a2 / b2 * cos_c**2,
            ],
            1,
        )
        monic = quartic[:, 1:] / quartic[:, :1]
    usable = np.flatnonzero(np.isfinite(monic).all(1))
    companion = np.zeros((len(usable), 4, 4))
    companion[:, 0] = -monic[usable]
    companion[:, [1, 2, 3], [0, 1, 2]] = 1
    roots = np.linalg.eigvals(companion)
    row, root = np.nonzero(np.abs(roots.imag) < 1e-4 * (1 + np.abs(roots.real)))
    v, sample = roots.real[row, root], usable[row]
    cos_a, cos_b, cos_c, q, b2 = cos_a[sample], cos_b[sample], cos_c[sample], q[sample], b2[sample]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((q - 1) * v**2 - 2 * q * cos_b * v + 1 + q) / (2 * (cos_c - v * cos_a))
        first = np.sqrt(b2 / (1 + v**2 - 2 * v * cos_b))
        ranges = np.stack([first, u * first, v * first], 1)
    good = (np.isfinite(ranges) & (ranges > 0)).all(1)
    sample, ranges = sample[good], ranges[good]
    return _align(f[sample] * ranges[..., None], p[sample])


def _align(source, target):
    """Return rotations (H, 3, 3) and translations (H, 3) that move source triangles (H, 3, 3) to target triangles."""
    rotations = np.einsum("hij,hkj->hik", _triangle_axes(target), _triangle_axes(source))
    shifts = target.mean(1) - np.einsum("hij,hj->hi", rotations, source.mean(1))
    finite = np.isfinite(rotations).all((1, 2))
    return rotations[finite], shifts[finite]


def _triangle_axes(points):
    along = points[:, 1] - points[:, 0]
    normal = np.cross(along, points[:, 2] - points[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([along, np.cross(normal, along), normal], 2)


def _refine(rotation, centre, bearings, points_m):
    """Minimise the angles between bearings and the directions to their points by Gauss-Newton.

    Returns:
        Rotation (3, 3) and camera centre (3,).
    """
    tangents = np.linalg.svd(bearings[:, None, :])[2][:, 1:]  # (M, 2, 3): two axes orthogonal to each bearing
    for _ in range(STEPS):
        local = (points_m - centre) @ rotation
        distance = np.linalg.norm(local, axis=1)
        direction = local / distance[:, None]
        residual = np.einsum("mki,mi->mk", tangents, direction).ravel()
        # direction changes by direction x w for a rotation w of the query, and by -(I - d d^T) R^T t / distance for a
        # translation t
        by_rotation = np.einsum("mki,mij->mkj", tangents, _cross_matrices(direction))
        projection = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        by_translation = -np.einsum("mki,mij,lj->mkl", tangents, projection, rotation) / distance[:, None, None]
        jacobian = np.concatenate([by_rotation, by_translation], 2).reshape(-1, 6)
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        rotation, centre = rotation @ _rotation(step[:3]), centre + step[3:]
    return rotation, centre


def _cross_matrices(vectors):
    """Return the (M, 3, 3) matrices that map w to vector x w."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def _rotation(vector):
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()
