"""Answers of localizers as JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from salframe.localization.answers import Localization
from salframe.localization.next_view import NextView
from salframe.panoramas.geometry import pose_yaw

COVARIANCE_AXES = ("x", "y", "z", "rotation_x", "rotation_y", "rotation_z")
"""Rows and columns of a covariance in JSON: metres, and radians about the axes of the world."""
_PLANAR = [0, 1, 5]


def answer_json(answer: Localization) -> dict[str, Any]:
    """Return the answer of a localizer as JSON.

    It holds the status, whether the answer is accepted, the places, the out-of-map probability, the pose in metres and
    degrees, the rows of T_world_query, its covariance, the heading in degrees, and notes. A heading may be known
    without a pose.
    """
    places = [
        {"place": place.place, "frame": place.frame, "score": place.score, "probability": place.probability}
        for place in answer.places
    ]
    matrix = None if answer.T_world_query is None else answer.T_world_query.tolist()
    return {
        "status": answer.status,
        "accepted": answer.accepted,
        "places": places,
        "out_of_map_probability": answer.out_of_map_probability,
        "pose": None if answer.T_world_query is None else pose_json(answer.T_world_query),
        "T_world_query": matrix,
        "covariance": covariance_json(answer.covariance),
        "heading_deg": None if answer.heading_rad is None else math.degrees(answer.heading_rad),
        "notes": list(answer.notes),
    }


def next_view_json(view: NextView | None) -> dict[str, Any] | None:
    """Return a suggested turn as JSON: its angle, and the angles of the views during the turn, in degrees."""
    return None if view is None else {"turn_deg": view.turn_deg, "views_deg": list(view.views_deg)}


def pose_json(T_world_query: np.ndarray) -> dict[str, float]:
    """Return x, y and z in metres and yaw in degrees of a pose (4, 4)."""
    x_m, y_m, z_m = T_world_query[:3, 3].tolist()
    return {"x_m": x_m, "y_m": y_m, "z_m": z_m, "yaw_deg": float(np.degrees(pose_yaw(T_world_query)))}


def covariance_json(covariance: np.ndarray | None) -> dict[str, Any] | None:
    """Return a covariance (3, 3) or (6, 6) of `Localization` as JSON with a 6 x 6 matrix.

    `estimated` lists the axes that the localizer estimates. The rows and columns of the other axes are 0: the pose is
    upright, at the height of the map's cameras. Return None if the covariance is unknown or not finite.
    """
    if covariance is None or not np.isfinite(covariance).all():
        return None
    axes = _PLANAR if len(covariance) == 3 else list(range(6))
    matrix = np.zeros((6, 6))
    matrix[np.ix_(axes, axes)] = covariance
    return {
        "frame": "world",
        "axes": list(COVARIANCE_AXES),
        "estimated": [COVARIANCE_AXES[axis] for axis in axes],
        "matrix": matrix.tolist(),
    }
