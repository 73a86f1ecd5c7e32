"""The pose of a query panorama from its bearings and points of the map: P3P hypotheses, then refinement over the whole
sphere."""

from __future__ import annotations

import numpy as np

REFINEMENTS = 4
STEPS = 5


def robust_pose(
    bearings: np.ndarray, points_m: np.ndarray, inlier_rad: float, hypotheses: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The pose that most matches agree with: T_map_query (4, 4) and inliers (M,) bool.

    bearings (M, 3): unit vectors in the query frame; points_m (M, 3): the matched points in the reference frame's axes. A
    match is an inlier where its bearing and the direction to its point differ by less than `inlier_rad`. Random samples
    of three are solved by P3P, and the best solution is that whose squared errors, each cut off at the inlier bound,
    sum to the least (MSAC, Torr and Zisserman 2000). It is refined by least squares on the angles of its inliers, taken
    anew a few times. The identity and no inlier where there are fewer than 4 matches.
    """
    count = len(bearings)
    if count < 4:
        return np.eye(4), np.zeros(count, bool)
    samples = rng.integers(0, count, (hypotheses, 3))  # a sample that repeats a match is degenerate and gives no pose
    rotations, centres = solve_p3p(bearings[samples], points_m[samples])
    if not len(rotations):
        return np.eye(4), np.zeros(count, bool)
    cosine = np.cos(inlier_rad)
    # 1 - cos is half the squared angle. The number of inliers would not do: refining the most supported solution often
    # loses a few of them
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
    """(H, M) cosines between bearings and the directions to the points, for camera centres (H, 3) and rotations (H, 3,
    3) to the map."""
    seen = np.einsum("hij,mj->hmi", rotations, bearings)
    along = np.einsum("hmi,mi->hm", seen, points_m) - np.einsum("hmi,hi->hm", seen, centres)
    squared = (points_m**2).sum(1) - 2 * centres @ points_m.T + (centres**2).sum(1)[:, None]
    return along / np.sqrt(np.maximum(squared, 1e-12))


def solve_p3p(bearings: np.ndarray, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All poses (H, 3, 3), (H, 3), query to map, that put three points each on their bearings, for many samples at
    once.

    bearings, points_m (S, 3, 3): sample, match, coordinates. Grunert's solution as given by Haralick et al., "Review
    and analysis of solutions of the three point perspective pose estimation problem" (1994); degenerate samples give
    none.
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
    which, root = np.nonzero(np.abs(roots.imag) < 1e-4 * (1 + np.abs(roots.real)))
    v, sample = roots.real[which, root], usable[which]
    cos_a, cos_b, cos_c, q, b2 = cos_a[sample], cos_b[sample], cos_c[sample], q[sample], b2[sample]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((q - 1) * v**2 - 2 * q * cos_b * v + 1 + q) / (2 * (cos_c - v * cos_a))
        first = np.sqrt(b2 / (1 + v**2 - 2 * v * cos_b))
        ranges = np.stack([first, u * first, v * first], 1)
    good = (np.isfinite(ranges) & (ranges > 0)).all(1)
    sample, ranges = sample[good], ranges[good]
    return _align(f[sample] * ranges[..., None], p[sample])


def _align(source, target):
    """Rotations (H, 3, 3) and shifts (H, 3) that move three points each, (H, 3, 3), onto three others: their triangles'
    axes."""
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
    """Gauss-Newton on the angles between bearings and the directions to their points; returns rotation and centre."""
    tangents = np.linalg.svd(bearings[:, None, :])[2][:, 1:]  # (M, 2, 3): two axes orthogonal to each bearing
    for _ in range(STEPS):
        local = (points_m - centre) @ rotation
        distance = np.linalg.norm(local, axis=1)
        direction = local / distance[:, None]
        residual = np.einsum("mki,mi->mk", tangents, direction).ravel()
        # direction moves by direction x w as the query turns by w, and by -(I - d d^T) R^T t / distance as it shifts by
        # t
        turning = np.einsum("mki,mij->mkj", tangents, _cross_matrices(direction))
        projection = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        shifting = -np.einsum("mki,mij,lj->mkl", tangents, projection, rotation) / distance[:, None, None]
        jacobian = np.concatenate([turning, shifting], 2).reshape(-1, 6)
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        rotation, centre = rotation @ _rotation(step[:3]), centre + step[3:]
    return rotation, centre


def _cross_matrices(vectors):
    """(M, 3, 3) matrices that take w to vector x w."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def _rotation(vector):
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()
