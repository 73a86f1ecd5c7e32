"""Fit poses to pairs of a query and a map object, weighted by the probability that both are the same object."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from salframe.graphs.segments import run_starts
from salframe_graphs.places.observations import ObservedObjects
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.poses import PoseColumns, Poses, RelativeObjects
from salframe_graphs.places.ranged_objects import RangedObjects
from salframe_graphs.places.rates import Likelihood

MAX_STEP_M = 1.5
"""Maximum distance in metres that one step moves a pose."""
_RIDGE = 1e-6 * np.eye(5)
"""Regularisation that keeps the information matrix invertible."""


class FittedObjects(Protocol):
    """Interface of a likelihood that `fit_step` can use: constants, and the query objects with and without range."""

    likelihood: Likelihood

    def rows_of(self, i: np.ndarray) -> list[tuple[ObservedObjects, np.ndarray | slice, np.ndarray]]:
        """See PlaceLikelihood.rows_of."""
        ...


def fit_positions(
    ranged: RangedObjects, index: PlaceIndex, poses: Poses, columns: PoseColumns, share: np.ndarray, scale_error: float
) -> Poses:
    """Return poses and scales fitted in closed form to objects with range.

    Each pair is weighted by its `share`, divided by the variance of the query object's position along its ray.

    Args:
        ranged: The n objects of the query.
        index: The places.
        poses: C poses. Position, heading and scale are replaced by fitted values; the place and the height remain.
        columns: The map objects of the place of each pose, T in total.
        share: (n, T) probability that each query object is each map object.
        scale_error: Standard deviation of the scale of the query's ranges.
    """
    objects = columns.objects
    weight = share / ranged.along_m2[:, objects]
    by_query, by_object = columns.segments.sum(weight), weight.sum(0)
    total = np.maximum(by_query.sum(0), 1e-12)
    map_position = index.position[objects]
    query_mean = (ranged.position @ by_query) / total
    map_mean = columns.segments.sum(by_object * map_position) / total
    x, y = np.array([ranged.position.real, ranged.position.imag]) @ weight  # a complex factor would copy the weights
    products = columns.segments.sum((x - 1j * y) * map_position) - total * query_mean.conj() * map_mean
    squares = (ranged.range_m * ranged.range_m) @ by_query - total * np.abs(query_mean) ** 2
    scale = (np.abs(products) + scale_error**-2) / (squares + scale_error**-2)
    yaw = np.angle(products)
    shift = map_mean - scale * np.exp(1j * yaw) * query_mean
    return Poses(poses.place, np.array([shift.real, shift.imag]).T, yaw, poses.camera_height_offset_m, scale)


def fit_step(
    scorer: FittedObjects, poses: Poses, pose: np.ndarray, i: np.ndarray, relative: RelativeObjects, share: np.ndarray
) -> tuple[Poses, np.ndarray]:
    """Move poses by one step of iteratively reweighted least squares (Gauss-Newton).

    Args:
        scorer: The likelihood of the query.
        poses: C poses.
        pose: (P,) index of the pose of each pair of objects, ascending.
        i: (P,) query object of each pair.
        relative: The P map objects of the pairs, relative to the query under their poses.
        share: (P,) probability that the two objects of each pair are the same object.

    Returns:
        The moved poses, and their information matrices (C, 5, 5) over x, y, yaw, height of the camera and scale.
    """
    slope, weighted, deviation = np.zeros((5, 2, len(i))), np.zeros((5, 2, len(i))), np.zeros((2, len(i)))
    for part, position, row in scorer.rows_of(i):
        residuals = part.residuals(row, relative.take(position))
        slope[..., position], deviation[:, position] = residuals.slope, residuals.deviation
        weighted[..., position] = residuals.slope * (residuals.weight * share[position])
    likelihood = scorer.likelihood
    prior = np.array([0, 0, 0, likelihood.camera_height_error_m**-2, likelihood.scale_error**-2])
    offset = np.zeros((len(poses), 5))
    offset[:, 3], offset[:, 4] = poses.camera_height_offset_m, poses.scale - 1
    information = np.tile(np.diag(prior) + _RIDGE, (len(poses), 1, 1))
    gradient = prior * offset
    if len(poses) == 1:  # one matrix product, which takes a third of the time
        flat = weighted.reshape(5, -1)
        information[0] += flat @ slope.reshape(5, -1).T
        gradient[0] += flat @ deviation.ravel()
    elif len(i):
        first = run_starts(pose)
        products = np.einsum("pat,qat->pqt", weighted, slope)
        information[pose[first]] += np.add.reduceat(products, first, 2).transpose(2, 0, 1)
        gradient[pose[first]] += np.add.reduceat(np.einsum("pat,at->pt", weighted, deviation), first, 1).T
    step = -np.linalg.solve(information, gradient[..., None])[..., 0]
    length_m = np.hypot(step[:, 0], step[:, 1])
    step *= np.minimum(1, MAX_STEP_M / np.maximum(length_m, 1e-9))[:, None]
    moved = Poses(
        poses.place,
        poses.shift_m + step[:, :2],
        poses.yaw_rad + step[:, 2],
        poses.camera_height_offset_m + step[:, 3],
        poses.scale + step[:, 4],
    )
    return moved, information
