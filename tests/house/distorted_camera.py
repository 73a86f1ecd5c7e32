"""Images of a distorted camera, sampled from a panorama by OpenCV and closed forms, without salframe's cameras."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

CALIBRATION: dict[str, Any] = {
    "width": 480,
    "height": 360,
    "fx": 250.0,
    "fy": 252.0,
    "cx": 236.0,
    "cy": 185.0,
    "distortion_model": "plumb_bob",
    "distortion": [-0.2, 0.04, 0.001, -0.0005, 0.0],
}
"""A camera of about 95 x 75 degrees, as in CAMERA.json."""


def mounted(pitch_deg: float, x_m: float, y_m: float, z_m: float) -> np.ndarray:
    """T_base_camera of a camera that looks along +x of its base and down by a pitch."""
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    # Columns: right is -y; down and forward lie in the plane of x and z.
    return np.array([[0, -s, c, x_m], [-1, 0, 0, y_m], [0, -c, -s, z_m], [0, 0, 0, 1.0]])


def image_rays(calibration: dict[str, Any]) -> np.ndarray:
    """Unit vectors through the pixels in the optical frame, (height, width, 3)."""
    y, x = np.mgrid[: calibration["height"], : calibration["width"]].astype(np.float64)
    pixels = np.stack([x, y], -1).reshape(-1, 1, 2)
    K = np.array([[calibration["fx"], 0, calibration["cx"]], [0, calibration["fy"], calibration["cy"]], [0, 0, 1]])
    if calibration["distortion_model"] == "fisheye":
        plane = cv2.fisheye.undistortPoints(pixels, K, np.array(calibration["distortion"]))
    else:
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-12)
        plane = cv2.undistortPoints(pixels, K, np.array(calibration["distortion"] or [0.0] * 4), criteria=stop)
    rays = np.concatenate([plane.reshape(*x.shape, 2), np.ones((*x.shape, 1))], -1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def photograph(
    panorama_image: np.ndarray, calibration: dict[str, Any], T_base_camera: np.ndarray, *, smooth: bool
) -> np.ndarray:
    """What the camera sees of a panorama image around it, whose axes are those of the base."""
    x, y, z = np.moveaxis(image_rays(calibration) @ T_base_camera[:3, :3].T, -1, 0)
    height = len(panorama_image)
    columns = (np.pi - np.arctan2(y, x)) / np.pi * height - 0.5
    rows = (np.pi / 2 - np.arcsin(z)) / np.pi * height - 0.5
    if not smooth:
        return panorama_image[np.rint(rows).astype(int), np.rint(columns).astype(int) % (2 * height)]
    mode = cv2.INTER_CUBIC, cv2.BORDER_WRAP
    return cv2.remap(panorama_image, columns.astype(np.float32), rows.astype(np.float32), mode[0], borderMode=mode[1])
