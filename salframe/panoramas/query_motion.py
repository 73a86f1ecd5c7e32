"""Queries of several views: a camera that turns on the spot, and the errors of the motion that odometry measures."""

from __future__ import annotations

import zlib
from dataclasses import replace
from functools import partial

import numpy as np
from pydantic import Field

from salframe.framework.files.hashes import digest
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import invert_pose, pose_2d
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.turning import panorama_width, turned
from salframe.panoramas.view import OdometryNoise

TURN_SHARE = 0.6
"""Turn to the left from one view to the next, relative to the field of view."""


class OdometryErrors(OdometryNoise):
    """Simulated errors of the motion between the views of a query."""

    scale_share: float = Field(
        0.0,
        ge=0,
        description="standard deviation of the scale error of odometry (0.1: 10 %). A query has one scale error for "
        "all its travelled distances; 0: no error",
    )
    shuffled: bool = Field(
        False,
        description="true: the measured motions are shuffled among the views of a query, as a control experiment. "
        "Queries of one or two views do not change; false: each view has its own measured motion",
    )


def measured_motion(T_last_view: np.ndarray, errors: OdometryErrors, seed: tuple[int, ...]) -> np.ndarray:
    """Return the motions between views as odometry measures them, (V, 4, 4) float64.

    Each step between two views has independent errors of its heading, and of its position along x and y in proportion
    to the length of the step. The errors of all steps from a view to the last view add up.

    Args:
        T_last_view: (V, 4, 4) true motions that map coordinates of views to those of the last view.
        errors: Sizes of the errors.
        seed: Seed of the errors.
    """
    rng = np.random.default_rng(seed)
    scale = 1 + errors.scale_share * rng.standard_normal()
    measured = [np.eye(4)]
    for number in reversed(range(len(T_last_view) - 1)):
        step = invert_pose(T_last_view[number]) @ T_last_view[number + 1]  # the next view in coordinates of this one
        x_error, y_error, yaw_error = rng.standard_normal(3)
        length_m = float(np.linalg.norm(step[:3, 3]))
        shift_m = errors.drift_share * length_m * np.array([x_error, y_error, 0.0])
        turn = pose_2d(0, 0, np.radians(errors.heading_drift_deg) * yaw_error)
        noisy = step @ turn
        noisy[:3, 3] = scale * step[:3, 3] + shift_m
        measured.insert(0, measured[0] @ invert_pose(noisy))
    if errors.shuffled and len(measured) > 2:
        order = rng.permutation(len(measured) - 1)
        shuffled = dict(zip(order.tolist(), np.roll(order, 1).tolist(), strict=True))
        measured[:-1] = [measured[shuffled[number]] for number in range(len(order))]
    return np.stack(measured)


def turned_query(query: QueryFrame, num_views: int, fov_deg: float, content: str) -> QueryFrame:
    """Return a query whose camera turned on the spot, to the left by TURN_SHARE of the field of view from view to view.

    The last view is the query itself. The id of an earlier view contains its number of steps before the last view.
    Images turn by whole columns.

    Args:
        query: The query.
        num_views: Number of views V.
        fov_deg: Field of view in degrees.
        content: The `content` of the query.
    """
    step_rad = np.radians(TURN_SHARE * fov_deg)
    earlier = tuple(
        QueryFrame(
            f"{query.id}/{back}-before", partial(_load_turned, query, back, step_rad), digest([content, back, step_rad])
        )
        for back in range(num_views - 1, 0, -1)
    )
    T_last_view = np.stack([pose_2d(0, 0, -back * step_rad) for back in range(num_views - 1, -1, -1)])
    return replace(query, earlier=earlier, T_last_view=T_last_view)


def odometry_seed(query: QueryFrame, seed: int) -> tuple[int, int]:
    """Return the seed of the odometry errors of a query."""
    return seed, zlib.crc32(query.id.encode())


def _load_turned(query: QueryFrame, back: int, step_rad: float) -> Panorama:
    """Return the view that was taken `back` steps before the panorama of a query."""
    panorama = query.load()
    columns = -round(back * step_rad / (2 * np.pi) * panorama_width(panorama))
    return replace(turned(panorama, columns), id=f"{panorama.id}/{back}-before")
