"""Geometric verification of many candidate graphs at once from directions alone: what `verify` is to a query without
range."""

from __future__ import annotations

import numpy as np

from salframe_graphs.node_pairs import NodePairs
from salframe_graphs.verification import VerifiedPoses

GRID_M, HALVINGS = 0.5, 3
"""Distance between the positions tried first, and how often it is halved around the best."""
BIN_RAD = np.radians(5)
"""Headings vote in bins this wide."""
_BLOCK = 16  # candidates at a time: more take memory and save no time


def verify_bearings(
    bearing: np.ndarray,
    map_m: np.ndarray,
    pairs: NodePairs,
    similarity: np.ndarray,
    weights: np.ndarray,
    tolerance: tuple[float, float],
    max_shift_m: float,
) -> VerifiedPoses:
    """Find the pose of each candidate that explains most directions, on a grid of positions around each reference frame.

    Each position has the heading that most similar nodes vote for, and is scored by how near the map nodes lie to the
    rays of the query's nodes. Both cameras are taken to be upright and equally high, so that elevations tell distance.
    A candidate of which fewer than two query nodes are explained has no pose.

    Args:
        bearing: (n, 3) unit vectors in the query frame.
        map_m: (N, 3) metres, each in its reference frame.
        pairs: the node pairs that may be the same.
        similarity: (P,) of each pair, over 0.
        weights: (n,) of the query's nodes.
        tolerance: metres, and a share of the map node's distance, at which two nodes cannot be the same.
        max_shift_m: radius of the grid.
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
        some, position = pairs.take(block)
        rays = _Rays(bearing, map_m, some, similarity[position], weights, tolerance)
        yaw_rad, position_m, kernel = rays.best(grid_m)
        explained, graphs_of = some.best_per_query(kernel)
        posed = graphs_of.sum((explained > 0).astype(np.int64)) >= 2
        result.yaw_rad[block[posed]], result.shift_m[block[posed]] = yaw_rad[posed], position_m[posed]
        result.kernel[position] = np.where(posed[some.graph], kernel, 0)
    return result


class _Rays:
    """The similar node pairs of K candidates, each with at least one, P together.

    Single precision, and positions of all candidates at once: most of a query's time is spent in arrays (positions, P).
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
        """Heading (K,) and position (K, 2) of the best pose of each candidate, and kernel (P,); grid_m (G, 1, 2)."""
        every = np.arange(self._num_graphs)
        position_m = np.repeat(grid_m, len(every), 1)
        support, yaw_rad, kernel = self._look(position_m)
        step_m = GRID_M
        for _ in range(HALVINGS):
            best = support.argmax(0)
            step_m /= 2
            around = step_m * np.stack(np.meshgrid([0, -1, 1], [0, -1, 1]), -1).reshape(-1, 1, 2)
            position_m = position_m[best, every] + around
            support, yaw_rad, kernel = self._look(position_m, yaw_rad[best, every])
        best = support.argmax(0)
        return yaw_rad[best, every], position_m[best, every], kernel[best[self._candidate], np.arange(len(self._value))]

    def _look(self, position_m: np.ndarray, yaw_rad: np.ndarray | None = None):
        """Support (G, K), heading (G, K) and kernel (G, P) of positions (G, K, 2), from headings near yaw_rad (K,), or
        near those that most pairs vote for."""
        k = self._candidate
        away = self._node_m[:, :2] - position_m.astype(np.float32)[:, k]
        flat, z = np.hypot(away[..., 0], away[..., 1]), self._node_m[:, 2]
        squared = flat * flat + z * z
        sharpness = 1 / (self._tolerance[0] + self._tolerance[1] * np.sqrt(squared)) ** 2
        turn = np.arctan2(away[..., 1], away[..., 0]) - self._azimuth_rad
        # What a pair can support at most, its azimuth aside: a node at the wrong elevation does not vote.
        share = np.maximum(1 - (z * self._out - flat * self._up) ** 2 * sharpness, 0) * self._value * self._weight
        yaw_rad = self._vote(turn, share) if yaw_rad is None else np.broadcast_to(yaw_rad, position_m.shape[:2])
        share = np.where(np.abs(_wrapped(turn - yaw_rad[:, k])) < 1.5 * BIN_RAD, share, 0)
        for _ in range(2):
            off = _wrapped(turn - yaw_rad[:, k])
            whole = np.maximum(np.add.reduceat(share, self._starts, 1), 1e-9)
            yaw_rad = yaw_rad + np.add.reduceat(share * off, self._starts, 1) / whole
            along = flat * self._out * np.cos(turn - yaw_rad[:, k]) + z * self._up
            distance = np.where(along > 0, squared - along * along, np.inf)
            kernel = np.maximum(1 - distance * sharpness, 0) * self._value
            share = kernel * self._weight
        explained = np.maximum.reduceat(kernel, self._node_starts, 1) * self._node_weight
        return np.add.reduceat(explained, self._first_node, 1), yaw_rad, kernel

    def _vote(self, turn: np.ndarray, share: np.ndarray) -> np.ndarray:
        """(G, K) float32: the middle of the three bins of headings that most shares (G, P) fall into."""
        bins, candidates = round(2 * np.pi / BIN_RAD), self._num_graphs
        cell = (np.arange(len(turn))[:, None] * candidates + self._candidate) * bins
        cell = cell + np.floor(turn / BIN_RAD).astype(np.int64) % bins
        votes = np.bincount(cell.ravel(), share.ravel(), len(turn) * candidates * bins).reshape(-1, candidates, bins)
        votes += np.roll(votes, 1, 2) + np.roll(votes, -1, 2)
        return ((votes.argmax(2) + 0.5) * BIN_RAD).astype(np.float32)


def _wrapped(angle_rad: np.ndarray) -> np.ndarray:
    """Angles brought into [-pi, pi], their precision kept."""
    return angle_rad - 2 * np.pi * np.rint(angle_rad / (2 * np.pi))
