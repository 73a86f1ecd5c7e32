"""Where the query's frame lies in the reference frame's, from matched nodes
(docs/explanation/method.md#from-matched-nodes-to-a-pose; paper section "Positioning")."""

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
    """Least-squares rotations (..., D, D) and shifts (..., D) that bring query (..., K, D) onto reference (Umeyama
    1991, no scale).

    share (..., K) weighs the points: 1 for inliers and 0 for the others, each set with at least one 1.
    """
    share = (share / share.sum(-1, keepdims=True))[..., None]
    query_mean, reference_mean = (query * share).sum(-2, keepdims=True), (reference * share).sum(-2, keepdims=True)
    covariance = np.swapaxes((reference - reference_mean) * share, -1, -2) @ (query - query_mean)
    left, _, right = np.linalg.svd(covariance)
    # A reflection fits as well as a rotation where points are few or flat: the weakest axis is turned over.
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
    """Exhaustive minimal hypotheses, scored robustly, then Umeyama on the inliers with unit weights; pose, covariance
    and runner-up.

    SE(2) takes hypotheses from every two matches and leaves height alone; SE(3) from every three.
    """

    name = "robust"
    version = "1"

    class Config(ComponentConfig):
        group: Literal["SE(2)", "SE(3)"] = Field("SE(2)", description="motion sought: on the floor, or in space")
        tolerance_m: float = Field(0.8, gt=0, description="largest distance of a match from the pose it supports")
        min_inliers: int = Field(2, ge=2, description="fewer than this many consistent matches: no pose")
        ambiguity: float = Field(
            0.95,
            gt=0,
            le=1,
            description="runner-up's support, a share of the best pose's, from which on the pose is ambiguous",
        )

    _separate_m: ClassVar[float] = 0.5
    _separate_rad: ClassVar[float] = np.radians(30)

    def solve(self, query_m: np.ndarray, reference_m: np.ndarray, weights: np.ndarray | None = None) -> PoseEstimate:
        dimension = 2 if self.config.group == "SE(2)" else 3
        query, reference = np.asarray(query_m, float)[:, :dimension], np.asarray(reference_m, float)[:, :dimension]
        count = len(query)
        if count < dimension:
            return _failure(PoseStatus.TOO_FEW, count)
        minimal = np.array(list(combinations(range(count), dimension)))
        spans = query[minimal] - query[minimal].mean(1, keepdims=True)
        # The second largest spread of the minimal sets tells points on a line from a triangle; for pairs, whether they
        # coincide.
        spread = np.linalg.svd(spans, compute_uv=False)[:, dimension - 2]
        minimal = minimal[spread > 0.05]
        if not len(minimal):
            return _failure(PoseStatus.DEGENERATE, count)
        rotation, shift = fit_rigid(query[minimal], reference[minimal], np.ones(minimal.shape))
        support, inlying = self._support(query, reference, rotation, shift, weights)
        # The best few are fitted again to all they agree with: a minimal set carries the noise of its few points alone.
        least = max(self.config.min_inliers, dimension)
        few = np.argsort(-support, kind="stable")[:20]
        few = few[inlying[few].sum(1) >= least]
        if not len(few):
            return _failure(PoseStatus.INCONSISTENT, count)
        turns, moves = fit_rigid(query, reference, inlying[few])
        best = int(self._support(query, reference, turns, moves, weights)[0].argmax())
        turn, move = turns[best], moves[best]
        inliers = inlying[few[best]]
        for _ in range(5):
            distance = np.linalg.norm(query @ turn.T + move - reference, axis=1)
            # 2.5 standard deviations of the residuals, from their median: tight where matches are good, the tolerance
            # where they are not.
            scale = 1.4826 * np.median(distance[inliers])
            closer = distance < np.clip(2.5 * scale, 0.1, self.config.tolerance_m)
            if closer.sum() < least or (closer == inliers).all():
                break
            inliers = closer
            turn, move = fit_rigid(query, reference, inliers)
        residual = (query @ turn.T + move - reference)[inliers]
        runner_up = self._runner_up(query, reference, weights, (rotation, shift, support), (turn, move), inliers)
        if runner_up >= self.config.ambiguity:
            return PoseEstimate(None, PoseStatus.AMBIGUOUS, None, inliers, runner_up)
        return PoseEstimate(
            _as_pose(turn, move), PoseStatus.OK, _covariance(reference[inliers], move, residual), inliers, runner_up
        )

    def resect(self, bearing: np.ndarray, reference_m: np.ndarray) -> PoseEstimate:
        """On the floor, whatever the group: at the height of the reference frame, looking level."""
        return resect(bearing, reference_m, self.config.tolerance_m, self.config.ambiguity)

    def _support(self, query, reference, rotation, shift, weights):
        """Truncated quadratic support (H,) of each pose, and its inliers (H, M)."""
        moved = query @ np.swapaxes(rotation, -1, -2) + shift[:, None]
        squared = ((moved - reference) ** 2).sum(-1) / self.config.tolerance_m**2
        return (np.maximum(1 - squared, 0) * (1 if weights is None else weights)).sum(1), squared < 1

    def _runner_up(self, query, reference, weights, hypotheses, best, inliers) -> float:
        """Support of the best pose that is another one, the best pose turned by 180 degrees about its inliers included,
        over the best's."""
        rotation, shift, support = hypotheses
        turn, move = best
        own = self._support(query, reference, turn[None], move[None], weights)[0][0]
        centre = reference[inliers].mean(0)
        flip = np.diag([-1.0, -1.0, 1.0][: len(move)])
        opposite = self._support(
            query, reference, (flip @ turn)[None], (flip @ (move - centre) + centre)[None], weights
        )[0][0]
        angle = np.arccos(np.clip((np.einsum("hij,ij->h", rotation, turn) - len(move) + 2) / 2, -1, 1))
        # Distance where the objects are, not at the origin, which the two frames may be far from.
        apart = (
            np.linalg.norm(query[inliers].mean(0) @ np.swapaxes(rotation, -1, -2) + shift - centre, axis=1)
            > self._separate_m
        )
        others = support[apart | (angle > self._separate_rad)]
        return float(min(max(others.max(initial=0.0), opposite) / own, 1.0)) if own > 0 else 1.0


def _covariance(reference: np.ndarray, shift: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Covariance of (x, y, yaw) or (x, y, z, rotation vector), first order, rotations about the reference frame's axes
    at the query's origin."""
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
    # Two matches leave one degree of freedom and may agree by luck: never claim better than 2 cm an axis.
    variance = max(float((residual**2).sum()) / freedom, 0.02**2)
    return variance * np.linalg.pinv(jacobian.T @ jacobian)


class LeastSquaresPositioner(Positioner):
    """The paper's positioner: shift by the pseudo-inverse over all pairs of nodes (Theorem 1), then the mean turn of
    the azimuths.

    Needs three nodes that are not on a line. `norms: literal` is the theorem as printed; `angle: arccos` its
    orientation, which loses the sign.
    """

    name = "least-squares"
    version = "1"

    class Config(ComponentConfig):
        norms: Literal["squared", "literal"] = Field(
            "squared", description="norms in b: squared as in the proof, or as the theorem prints them"
        )
        angle: Literal["atan2", "arccos"] = Field(
            "atan2", description="turn of a node: signed, or the paper's arccos, which drops the sign"
        )
        mean: Literal["circular", "arithmetic"] = Field(
            "circular", description="mean of the turns: wrapping at 180 deg, or the paper's"
        )
        max_condition: float = Field(
            1e3, gt=1, description="condition number of B from which on the nodes count as collinear"
        )

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
        turns = self._turns(v, shifted)
        share = weights if weights is not None and weights.sum() > 0 else np.ones(count)
        if self.config.mean == "arithmetic":
            yaw = float(np.average(turns, weights=share))
        else:
            yaw = float(np.arctan2((share * np.sin(turns)).sum(), (share * np.cos(turns)).sum()))
        return PoseEstimate(pose_2d(shift[0], shift[1], yaw), PoseStatus.OK, None, np.ones(count, bool))

    def _turns(self, v: np.ndarray, shifted: np.ndarray) -> np.ndarray:
        """(M,) angle from each query node to its map node, both seen from the query's position."""
        if self.config.angle == "arccos":
            return np.arccos(_cosine(shifted)) - np.arccos(_cosine(v))
        turns = np.arctan2(shifted[:, 1], shifted[:, 0]) - np.arctan2(v[:, 1], v[:, 0])
        return wrap_angle(turns)


def _cosine(vectors: np.ndarray) -> np.ndarray:
    """(M,) cosine of the angle between vectors (M, 2) and the x axis; 1 for a vector of no length."""
    norm = np.linalg.norm(vectors, axis=1)
    return np.divide(vectors[:, 0], norm, out=np.ones(len(vectors)), where=norm > 0)
