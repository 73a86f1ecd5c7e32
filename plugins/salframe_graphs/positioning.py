"""Pose of the query frame in the reference frame, from matched nodes
(docs/explanation/saliency-graph.md#from-matched-nodes-to-a-pose; paper section "Positioning")."""

from __future__ import annotations

from itertools import combinations
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.localization.positioner import PoseEstimate, PoseStatus, Positioner
from salframe.panoramas.geometry import pose_2d, wrap_angle
from salframe_graphs.resection import resect


def fit_rigid(query: np.ndarray, reference: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares rigid motions that align query points with reference points (Umeyama 1991, no scale).

    Args:
        query: (..., K, D) points.
        reference: (..., K, D) corresponding points.
        share: (..., K) weights of the points: 1 for inliers, 0 for the others. Each set has at least one inlier.

    Returns:
        Rotations (..., D, D) and translations (..., D).
    """
    share = (share / share.sum(-1, keepdims=True))[..., None]
    query_mean, reference_mean = (query * share).sum(-2, keepdims=True), (reference * share).sum(-2, keepdims=True)
    covariance = np.swapaxes((reference - reference_mean) * share, -1, -2) @ (query - query_mean)
    left, _, right = np.linalg.svd(covariance)
    # Where points are few or coplanar, the best fit may be a reflection: reverse the weakest axis.
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[..., None]
    rotation = left @ right
    return rotation, (reference_mean - query_mean @ np.swapaxes(rotation, -1, -2))[..., 0, :]


def _failure(status: PoseStatus, count: int) -> PoseEstimate:
    return PoseEstimate(None, status, None, np.zeros(count, bool))


def _as_pose(rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[: len(shift), : len(shift)] = rotation
    pose[: len(shift), 3] = shift
    return pose


class RobustPositioner(Positioner):
    """Computes a pose from each minimal set of matches, and refines the poses with the highest scores.

    A minimal set has two matches for SE(2), which ignores height, and three for SE(3). The score of a pose counts the
    matches that agree with it (inliers). Inliers with smaller errors count more. Umeyama's method fits the best poses
    to their inliers, with equal weights. The result contains a covariance, and the ratio of the scores of the second
    and the best pose.
    """

    name = "robust"
    version = "1"

    class Config(ComponentConfig):
        group: Literal["SE(2)", "SE(3)"] = Field(
            "SE(2)",
            description="degrees of freedom of the pose. SE(2): x, y and yaw; SE(3): position and all three "
            "rotations. No effect on a query without range, whose pose always consists of x, y and yaw",
        )
        tolerance_m: float = Field(
            0.8,
            gt=0,
            description="maximum error (m) of an inlier: the distance between an object of the query, transformed to "
            "the map by the pose, and the matched object of the map",
        )
        min_inliers: int = Field(2, ge=2, description="minimum number of inliers of a pose, at least 3 for SE(3)")
        ambiguity: float = Field(
            0.95,
            gt=0,
            le=1,
            description="threshold (0 to 1) of ambiguity. The result is ambiguous and has no pose if the score of the "
            "second-best pose, divided by the score of the best pose, is at least this threshold. Poses within 0.5 m "
            "and 30 deg of the best pose do not count as second-best",
        )

    _separate_m: ClassVar[float] = 0.5
    _separate_rad: ClassVar[float] = np.radians(30)
    """Minimum differences of position and of heading; two poses are different if they exceed one of them."""

    def solve(self, query_m: np.ndarray, reference_m: np.ndarray, weights: np.ndarray | None = None) -> PoseEstimate:
        dimension = 2 if self.config.group == "SE(2)" else 3
        query, reference = np.asarray(query_m, float)[:, :dimension], np.asarray(reference_m, float)[:, :dimension]
        count = len(query)
        if count < dimension:
            return _failure(PoseStatus.TOO_FEW, count)
        minimal = np.array(list(combinations(range(count), dimension)))
        spans = query[minimal] - query[minimal].mean(1, keepdims=True)
        # Leave out degenerate sets. For triples the second largest spread distinguishes a triangle from points on a
        # line; for pairs the largest spread shows whether the points coincide.
        spread = np.linalg.svd(spans, compute_uv=False)[:, dimension - 2]
        minimal = minimal[spread > 0.05]
        if not len(minimal):
            return _failure(PoseStatus.DEGENERATE, count)
        rotation, shift = fit_rigid(query[minimal], reference[minimal], np.ones(minimal.shape))
        support, is_inlier = self._support(query, reference, rotation, shift, weights)
        # Fit the best few again to all of their inliers, because a minimal set has the noise of two or three points.
        min_inliers = max(self.config.min_inliers, dimension)
        top = np.argsort(-support, kind="stable")[:20]
        top = top[is_inlier[top].sum(1) >= min_inliers]
        if not len(top):
            return _failure(PoseStatus.INCONSISTENT, count)
        rotations, translations = fit_rigid(query, reference, is_inlier[top])
        best = int(self._support(query, reference, rotations, translations, weights)[0].argmax())
        best_rotation, best_translation = rotations[best], translations[best]
        inliers = is_inlier[top[best]]
        for _ in range(5):
            distance = np.linalg.norm(query @ best_rotation.T + best_translation - reference, axis=1)
            # The threshold is 2.5 standard deviations of the residuals, estimated from their median, and at most the
            # tolerance.
            scale = 1.4826 * np.median(distance[inliers])
            tighter = distance < np.clip(2.5 * scale, 0.1, self.config.tolerance_m)
            if tighter.sum() < min_inliers or (tighter == inliers).all():
                break
            inliers = tighter
            best_rotation, best_translation = fit_rigid(query, reference, inliers)
        residual = (query @ best_rotation.T + best_translation - reference)[inliers]
        runner_up = self._runner_up(
            query, reference, weights, (rotation, shift, support), (best_rotation, best_translation), inliers
        )
        if runner_up >= self.config.ambiguity:
            return PoseEstimate(None, PoseStatus.AMBIGUOUS, None, inliers, runner_up)
        return PoseEstimate(
            _as_pose(best_rotation, best_translation),
            PoseStatus.OK,
            _covariance(reference[inliers], best_translation, residual),
            inliers,
            runner_up,
        )

    def resect(self, bearing: np.ndarray, reference_m: np.ndarray) -> PoseEstimate:
        """Return the upright pose at the height of the reference frame, regardless of the setting `group`."""
        return resect(bearing, reference_m, self.config.tolerance_m, self.config.ambiguity)

    def _support(self, query, reference, rotation, shift, weights):
        """Return the truncated quadratic support (H,) of each pose, and its inliers (H, M)."""
        moved_query = query @ np.swapaxes(rotation, -1, -2) + shift[:, None]
        squared = ((moved_query - reference) ** 2).sum(-1) / self.config.tolerance_m**2
        return (np.maximum(1 - squared, 0) * (1 if weights is None else weights)).sum(1), squared < 1

    def _runner_up(self, query, reference, weights, hypotheses, best, inliers) -> float:
        """Return the support of the best different pose, divided by the support of the best pose.

        The best pose turned by 180 degrees about its inliers is among the different poses.
        """
        rotation, shift, support = hypotheses
        best_rotation, best_translation = best
        best_support = self._support(query, reference, best_rotation[None], best_translation[None], weights)[0][0]
        centre = reference[inliers].mean(0)
        flip = np.diag([-1.0, -1.0, 1.0][: len(best_translation)])
        opposite = self._support(
            query, reference, (flip @ best_rotation)[None], (flip @ (best_translation - centre) + centre)[None], weights
        )[0][0]
        angle = np.arccos(
            np.clip((np.einsum("hij,ij->h", rotation, best_rotation) - len(best_translation) + 2) / 2, -1, 1)
        )
        # Compare positions of the inliers' centre, not of the origin, which may be far from the objects.
        is_far = (
            np.linalg.norm(query[inliers].mean(0) @ np.swapaxes(rotation, -1, -2) + shift - centre, axis=1)
            > self._separate_m
        )
        other_support = support[is_far | (angle > self._separate_rad)]
        return (
            float(min(max(other_support.max(initial=0.0), opposite) / best_support, 1.0)) if best_support > 0 else 1.0
        )


def _covariance(reference: np.ndarray, shift: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return the first-order covariance of (x, y, yaw) or (x, y, z, rotation vector).

    Rotations are about the axes of the reference frame, at the query's origin.
    """
    arm = reference - shift
    count, dimension = arm.shape
    if dimension == 2:
        jacobian = np.concatenate(
            [np.broadcast_to(np.eye(2), (count, 2, 2)), np.stack([-arm[:, 1], arm[:, 0]], 1)[..., None]], axis=2
        )
    else:
        x, y, z = arm.T
        o = np.zeros(count)
        cross = np.stack([np.stack([o, z, -y], 1), np.stack([-z, o, x], 1), np.stack([y, -x, o], 1)], 1)
        jacobian = np.concatenate([np.broadcast_to(np.eye(3), (count, 3, 3)), cross], axis=2)
    jacobian = jacobian.reshape(count * dimension, -1)
    freedom = max(jacobian.shape[0] - jacobian.shape[1], 1)
    # Two matches leave one degree of freedom and may agree by chance, so the standard deviation is at least 2 cm.
    variance = max(float((residual**2).sum()) / freedom, 0.02**2)
    return variance * np.linalg.pinv(jacobian.T @ jacobian)


class LeastSquaresPositioner(Positioner):
    """The positioner of the paper: the position by least squares over all pairs of nodes, the yaw by a mean of angles.

    A pair consists of an object (node) of the query and the matched object of the map. The position is the solution of
    Theorem 1 of the paper. It needs three objects that are not on a line.
    """

    name = "least-squares"
    version = "1"

    class Config(ComponentConfig):
        norms: Literal["squared", "literal"] = Field(
            "squared",
            description="norms in the linear equations of Theorem 1. squared: squared norms, as in the proof in the "
            "paper; literal: norms, as in the text of the theorem",
        )
        angle: Literal["atan2", "arccos"] = Field(
            "atan2",
            description="formula of the angle between two directions, from which the yaw is computed: the direction "
            "from the query to an object, and that from the estimated position to the matched object. atan2: with "
            "sign; arccos: without sign, as in the paper",
        )
        mean: Literal["circular", "arithmetic"] = Field(
            "circular",
            description="mean of the angles of all pairs. circular: mean of directions; arithmetic: mean of numbers, "
            "as in the paper, which is wrong near 180 deg",
        )
        max_condition: float = Field(
            1e3,
            gt=1,
            description="maximum condition number of the linear equations. Above this number, the objects are "
            "considered to lie on a line, and there is no pose",
        )

    @property
    def is_equivariant(self) -> bool:
        # Unsigned turns and their arithmetic mean depend on the x axis of the query.
        return (self.config.angle, self.config.mean) == ("atan2", "circular")

    def solve(self, query_m: np.ndarray, reference_m: np.ndarray, weights: np.ndarray | None = None) -> PoseEstimate:
        v, u = np.asarray(query_m, float)[:, :2], np.asarray(reference_m, float)[:, :2]
        count = len(u)
        if count < 3:
            return _failure(PoseStatus.TOO_FEW, count)
        i, j = np.triu_indices(count, 1)
        rows = u[i] - u[j]
        singular = np.linalg.svd(rows, compute_uv=False)
        if singular[1] * self.config.max_condition < singular[0] or singular[0] == 0:
            return _failure(PoseStatus.DEGENERATE, count)
        power = 2 if self.config.norms == "squared" else 1
        norm_u, norm_v = np.linalg.norm(u, axis=1) ** power, np.linalg.norm(v, axis=1) ** power
        shift = 0.5 * np.linalg.pinv(rows) @ (norm_u[i] - norm_u[j] - norm_v[i] + norm_v[j])
        shifted = u - shift
        turns_rad = self._turns(v, shifted)
        share = weights if weights is not None and weights.sum() > 0 else np.ones(count)
        if self.config.mean == "arithmetic":
            yaw = float(np.average(turns_rad, weights=share))
        else:
            yaw = float(np.arctan2((share * np.sin(turns_rad)).sum(), (share * np.cos(turns_rad)).sum()))
        return PoseEstimate(pose_2d(shift[0], shift[1], yaw), PoseStatus.OK, None, np.ones(count, bool))

    def _turns(self, v: np.ndarray, shifted: np.ndarray) -> np.ndarray:
        """Return the angle (M,) from each query node to its map node, relative to the query's position."""
        if self.config.angle == "arccos":
            return np.arccos(_cosine(shifted)) - np.arccos(_cosine(v))
        turns_rad = np.arctan2(shifted[:, 1], shifted[:, 0]) - np.arctan2(v[:, 1], v[:, 0])
        return wrap_angle(turns_rad)


def _cosine(vectors: np.ndarray) -> np.ndarray:
    """Return the cosine (M,) of the angle between vectors (M, 2) and the x axis; 1 for a vector of length 0."""
    norm = np.linalg.norm(vectors, axis=1)
    return np.divide(vectors[:, 0], norm, out=np.ones(len(vectors)), where=norm > 0)
