"""Geometric verification of many candidate graphs at once, from directions only (queries without range)."""

from __future__ import annotations

import numpy as np

from salframe_graphs.node_pairs import NodePairs
from salframe_graphs.verification import VerifiedPoses

GRID_M, HALVINGS = 0.5, 3
"""Spacing of the grid of positions in metres, and number of times that the spacing is halved around the best
position."""
BIN_RAD = np.radians(5)
"""Width of the bins in which headings collect votes."""
_BLOCK = 16
"""Number of candidates to verify at once. Larger blocks need more memory and are not faster."""


def verify_bearings(
    bearing: np.ndarray,
    map_m: np.ndarray,
    pairs: NodePairs,
    similarity: np.ndarray,
    weights: np.ndarray,
    tolerance: tuple[float, float],
    max_shift_m: float,
) -> VerifiedPoses:
    """Find for each candidate the pose that explains the directions best.

    Positions are searched on a grid around each reference frame. At each position, the pairs of similar nodes vote for
    a heading, and the heading with the most votes is used. The score of a position depends on the distances between
    the map nodes and the rays to the query's nodes. The query camera and the map camera are assumed to be upright and
    at the same height, so that elevations determine distances. A candidate has no pose if its best pose explains fewer
    than two query nodes.

    Args:
        bearing: (n, 3) unit vectors to the query's nodes in the query frame.
        map_m: (N, 3) positions of the map's nodes in metres, each in its reference frame.
        pairs: The P node pairs that may be the same object.
        similarity: (P,) similarity of each pair, above 0.
        weights: (n,) weights of the query's nodes.
        tolerance: (a, b). A map node can be the same object as a query node only if its distance from the ray to the
            query node is less than a + b * d metres, where d is the distance of the map node from the query camera.
        max_shift_m: Radius of the grid in metres.
    """
    num_steps = int(max_shift_m / GRID_M + 1e-9)
    steps = GRID_M * np.arange(-num_steps, num_steps + 1)
    grid_m = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 1, 2)
    grid_m = grid_m[np.hypot(*grid_m[:, 0].T) <= max_shift_m]
    result = VerifiedPoses.none(pairs)
    graphs = np.flatnonzero(pairs.segments.count)
    for block in np.split(graphs, range(_BLOCK, len(graphs), _BLOCK)):
        if not len(block):
            continue
        subset, position = pairs.take(block)
        rays = _PairScorer(bearing, map_m, subset, similarity[position], weights, tolerance)
        yaw_rad, position_m, kernel = rays.best(grid_m)
        explained, graphs_of = subset.best_per_query(kernel)
        has_pose = graphs_of.sum((explained > 0).astype(np.int64)) >= 2
        result.yaw_rad[block[has_pose]], result.shift_m[block[has_pose]] = yaw_rad[has_pose], position_m[has_pose]
        result.kernel[position] = np.where(has_pose[subset.graph], kernel, 0)
    return result


class _PairScorer:
    """The P similar node pairs of K candidates, at least one pair per candidate.

    The class uses single precision and evaluates the positions of all candidates at once, because arrays of the shape
    (positions, P) take most of a query's time.
    """

    def __init__(
        self,
        bearing: np.ndarray,
        map_m: np.ndarray,
        pairs: NodePairs,
        similarity: np.ndarray,
        weights: np.ndarray,
        tolerance: tuple[float, float],
    ) -> None:
        i = pairs.query
        value, weight, self._node_m = (
            array.astype(np.float32) for array in (similarity, weights[i], map_m[pairs.node])
        )
        self._num_graphs, self._candidate = pairs.num_graphs, pairs.graph
        self._value, self._weight, self._tolerance = value, weight, tolerance
        self._azimuth_rad = np.arctan2(bearing[i, 1], bearing[i, 0]).astype(np.float32)
        self._up, self._out = bearing[i, 2].astype(np.float32), np.hypot(*bearing[i, :2].T).astype(np.float32)
        self._starts = pairs.segments.start[:-1]
        self._node_starts = pairs.first_of_query
        self._node_weight = weight[self._node_starts]
        self._first_node = np.searchsorted(self._node_starts, self._starts)

    def best(self, grid_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return heading (K,) and position (K, 2) of the best pose of each candidate, and the kernel (P,) of each pair.

        Args:
            grid_m: (G, 1, 2) positions of the grid in metres, relative to the reference frame.
        """
        candidates = np.arange(self._num_graphs)
        position_m = np.repeat(grid_m, len(candidates), 1)
        support, yaw_rad, kernel = self._evaluate(position_m)
        step_m = GRID_M
        for _ in range(HALVINGS):
            best = support.argmax(0)
            step_m /= 2
            offsets_m = step_m * np.stack(np.meshgrid([0, -1, 1], [0, -1, 1]), -1).reshape(-1, 1, 2)
            position_m = position_m[best, candidates] + offsets_m
            support, yaw_rad, kernel = self._evaluate(position_m, yaw_rad[best, candidates])
        best = support.argmax(0)
        return (
            yaw_rad[best, candidates],
            position_m[best, candidates],
            kernel[best[self._candidate], np.arange(len(self._value))],
        )

    def _evaluate(self, position_m: np.ndarray, yaw_rad: np.ndarray | None = None):
        """Return support (G, K), heading (G, K) and kernel (G, P) at positions (G, K, 2). Support is the score.

        Headings are refined from yaw_rad (K,), or, if yaw_rad is None, from the headings with the most votes.
        """
        k = self._candidate
        offset_m = self._node_m[:, :2] - position_m.astype(np.float32)[:, k]
        horizontal_m, z = np.hypot(offset_m[..., 0], offset_m[..., 1]), self._node_m[:, 2]
        squared = horizontal_m * horizontal_m + z * z
        sharpness = 1 / (self._tolerance[0] + self._tolerance[1] * np.sqrt(squared)) ** 2
        turn = np.arctan2(offset_m[..., 1], offset_m[..., 0]) - self._azimuth_rad
        # Upper bound of the support of a pair, whatever its azimuth: a node at the wrong elevation does not vote.
        share = (
            np.maximum(1 - (z * self._out - horizontal_m * self._up) ** 2 * sharpness, 0) * self._value * self._weight
        )
        yaw_rad = (
            self._commonest_heading(turn, share) if yaw_rad is None else np.broadcast_to(yaw_rad, position_m.shape[:2])
        )
        share = np.where(np.abs(_wrapped(turn - yaw_rad[:, k])) < 1.5 * BIN_RAD, share, 0)
        for _ in range(2):
            error_rad = _wrapped(turn - yaw_rad[:, k])
            total = np.maximum(np.add.reduceat(share, self._starts, 1), 1e-9)
            yaw_rad = yaw_rad + np.add.reduceat(share * error_rad, self._starts, 1) / total
            along = horizontal_m * self._out * np.cos(turn - yaw_rad[:, k]) + z * self._up
            distance = np.where(along > 0, squared - along * along, np.inf)
            kernel = np.maximum(1 - distance * sharpness, 0) * self._value
            share = kernel * self._weight
        explained = np.maximum.reduceat(kernel, self._node_starts, 1) * self._node_weight
        return np.add.reduceat(explained, self._first_node, 1), yaw_rad, kernel

    def _commonest_heading(self, turn: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Return the centres (G, K) float32 of the three adjacent heading bins with the largest sum of `share`, which
        is (G, P)."""
        bins, candidates = round(2 * np.pi / BIN_RAD), self._num_graphs
        cell = (np.arange(len(turn))[:, None] * candidates + self._candidate) * bins
        cell = cell + np.floor(turn / BIN_RAD).astype(np.int64) % bins
        votes = np.bincount(cell.ravel(), share.ravel(), len(turn) * candidates * bins).reshape(-1, candidates, bins)
        votes += np.roll(votes, 1, 2) + np.roll(votes, -1, 2)
        return ((votes.argmax(2) + 0.5) * BIN_RAD).astype(np.float32)


def _wrapped(angle_rad: np.ndarray) -> np.ndarray:
    """Return angles wrapped to [-pi, pi], with their dtype unchanged."""
    return angle_rad - 2 * np.pi * np.rint(angle_rad / (2 * np.pi))
