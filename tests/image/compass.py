"""Panoramas whose colour is a function of the azimuth."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.geometry import column_azimuth, pose_yaw
from salframe.panoramas.panorama import Panorama

HEIGHT = 128


def compass(colours: np.ndarray, T_world_pano: np.ndarray | None = None, valid: np.ndarray | None = None) -> Panorama:
    """Return a panorama of an infinite cylinder, with the colour 127 + 100 `colours` (3, 2) @ (cos, sin) of the world
    azimuth."""
    azimuth = column_azimuth(2 * HEIGHT) + (0.0 if T_world_pano is None else pose_yaw(T_world_pano))
    row = 127 + 100 * np.stack([np.cos(azimuth), np.sin(azimuth)], 1) @ colours.T
    return Panorama("compass", np.broadcast_to(np.rint(row), (HEIGHT, 2 * HEIGHT, 3)).astype(np.uint8), valid=valid)
