"""Geometric verification of many candidate graphs at once from directions alone: what `verify` is to a query without
range."""

from __future__ import annotations

import numpy as np

from salframe_graphs.verification import Verified

GRID_M, HALVINGS = 0.5, 3
"""Distance between the positions tried first, and how often it is halved around the best."""
BIN_RAD = np.radians(5)
"""Headings vote in bins this wide."""
_BLOCK = 16  # candidates at a time: more take memory and save no time


def verify_bearings(
    bearing: np.ndarray,
    map_m: np.ndarray,
    similarity: np.ndarray,
    weights: np.ndarray,
    tolerance: tuple[float, float],
    largest_shift_m: float,
) -> Verified:
    """Positions on a grid around each map frame, each with the heading that most alike nodes vote for, scored by how
    near the map nodes lie to the rays of the query's.

    bearing (n, 3) unit vectors in the query frame; map_m (K, m, 3) metres; similarity (K, n, m), 0 where two nodes
    cannot be the same; weights (n,); tolerance: metres, and a share of the map node's distance. Both cameras are taken
    to be upright and equally high, so that elevations tell distance. Positions within largest_shift_m of the map frame
    are tried; where fewer than two nodes are explained there is no pose.
    """
    most = int(largest_shift_m / GRID_M + 1e-9)
    steps = GRID_M * np.arange(-most, most + 1)
    grid_m = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 1, 2)
    grid_m = grid_m[np.hypot(*grid_m[:, 0].T) <= largest_shift_m]
    candidates = len(similarity)
    result = Verified.none(similarity.shape)
    for start in range(0, candidates, _BLOCK):
        block = np.arange(start, min(start + _BLOCK, candidates))
        block = block[similarity[block].any((1, 2))]
        if len(block):
            rays = _Rays(bearing, map_m[block], similarity[block], weights, tolerance)
            yaw_rad, position_m, kernel = rays.best(grid_m)
            posed = (kernel.max(2) > 0).sum(1) >= 2
            found = block[posed]
            result.yaw_rad[found], result.shift_m[found] = yaw_rad[posed], position_m[posed]
            result.kernel[found] = kernel[posed]
    return result


class _Rays:
    """The alike node pairs of K candidates, each with at least one: P pairs sorted by candidate, then query node.

    Single precision, and positions of all candidates at once: most of a query's time is spent in arrays (positions, P).
    """

    def __init__(self, bearing, map_m, similarity, weights, tolerance) -> None:
        self._shape = similarity.shape
        self._pair = k, i, j = np.nonzero(similarity)
        value, weight, self._node_m = (
            array.astype(np.float32) for array in (similarity[k, i, j], weights[i], map_m[k, j])
        )
        self._candidate, self._value, self._weight, self._tolerance = k, value, weight, tolerance
        self._azimuth_rad = np.arctan2(bearing[i, 1], bearing[i, 0]).astype(np.float32)
        self._up, self._out = bearing[i, 2].astype(np.float32), np.hypot(*bearing[i, :2].T).astype(np.float32)
        self._starts = np.flatnonzero(np.diff(k, prepend=-1))
        self._node_starts = np.flatnonzero(np.diff(k * self._shape[1] + i, prepend=-1))
        self._node_weight = weight[self._node_starts]
        self._first_node = np.searchsorted(self._node_starts, self._starts)

    def best(self, grid_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Heading (K,), position (K, 2) and kernel (K, n, m) of the best pose of each candidate; grid_m (G, 1, 2)."""
        every = np.arange(self._shape[0])
        position_m = np.repeat(grid_m, len(every), 1)
        support, yaw_rad, kernel = self._look(position_m)
        step_m = GRID_M
        for _ in range(HALVINGS):
            best = support.argmax(0)
            step_m /= 2
            around = step_m * np.stack(np.meshgrid([0, -1, 1], [0, -1, 1]), -1).reshape(-1, 1, 2)
            position_m = position_m[best, every] + around
            support, yaw_rad, kernel = self._look(position_m, yaw_rad[best, every])
        best, whole = support.argmax(0), np.zeros(self._shape)
        whole[self._pair] = kernel[best[self._candidate], np.arange(len(self._candidate))]
        return yaw_rad[best, every], position_m[best, every], whole

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
        bins, candidates = round(2 * np.pi / BIN_RAD), self._shape[0]
        cell = (np.arange(len(turn))[:, None] * candidates + self._candidate) * bins
        cell = cell + np.floor(turn / BIN_RAD).astype(np.int64) % bins
        votes = np.bincount(cell.ravel(), share.ravel(), len(turn) * candidates * bins).reshape(-1, candidates, bins)
        votes += np.roll(votes, 1, 2) + np.roll(votes, -1, 2)
        return ((votes.argmax(2) + 0.5) * BIN_RAD).astype(np.float32)


def _wrapped(angle_rad: np.ndarray) -> np.ndarray:
    """Angles brought into [-pi, pi], their precision kept."""
    return angle_rad - 2 * np.pi * np.rint(angle_rad / (2 * np.pi))
