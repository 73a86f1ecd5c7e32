"""Cameras that show a part of the sphere: projection, distortion, and their position on a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from numbers import Real

import numpy as np
from numpy.polynomial import Polynomial

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.panoramas.geometry import equirectangular_rays, is_rigid

LEVEL = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""T_base_camera (4, 4) of a level camera that is at the origin of the base frame and looks along +x of this frame."""
MIN_FOV_DEG, MAX_FOV_DEG, MAX_FISHEYE_FOV_DEG = 5.0, 170.0, 360.0
"""Minimum field of view of a camera, and maximum without and with fisheye distortion. They apply to the side of the
image that spans the wider angle, before distortion."""
MAX_PIXEL_RATIO = 2.0
"""Maximum ratio of fx to fy, and of fy to fx."""
MAX_TANGENTIAL = 0.1
"""Maximum magnitude of p1 and p2. Lenses have less than 0.02. Larger values suggest coefficients in a wrong order."""
MAX_POSITION_M = 10.0
"""Maximum distance of a camera from the origin of its base along each axis. Larger values are probably millimetres."""
MAX_LOST_SHARE = 0.2
"""Maximum share of the image where the distortion is not invertible, as in corners where its polynomial decreases."""
MAX_ELEVATION_DEG, MAX_ROLL_DEG = 60.0, 45.0
"""Maximum elevation of the optical axis, and of the x axis of the image, that causes no warning."""
MAX_PINHOLE_ANGLE_RAD = float(np.radians(87))
"""Maximum angle from the optical axis that a camera without fisheye distortion can show."""
RIGID_TOLERANCE = 1e-3
"""Tolerance of the check that T_base_camera is rigid."""


class DistortionModel(StrEnum):
    """Names of distortion models, as in the ROS message sensor_msgs/CameraInfo.

    FISHEYE is the model of cv2.fisheye, which ROS calls "equidistant"; both names are accepted.
    """

    NONE = "none"
    PLUMB_BOB = "plumb_bob"
    RATIONAL_POLYNOMIAL = "rational_polynomial"
    FISHEYE = "fisheye"

    @classmethod
    def _missing_(cls, value: object) -> DistortionModel | None:
        return cls.FISHEYE if value == "equidistant" else None


COEFFICIENTS = {
    DistortionModel.NONE: (),
    DistortionModel.PLUMB_BOB: ("k1", "k2", "p1", "p2", "k3"),
    DistortionModel.RATIONAL_POLYNOMIAL: ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    DistortionModel.FISHEYE: ("k1", "k2", "k3", "k4"),
}
"""Coefficients of each distortion model, in the order of OpenCV and ROS."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera with the conventions of OpenCV and of the ROS message sensor_msgs/CameraInfo.

    The camera frame is the optical frame of ROS REP-103: x right, y down, z forward. The base frame has x forward, y
    left and z up. A panorama made from an image is centred at the camera, and its axes are parallel to the base frame.

    Attributes:
        width: Width of the image in pixels.
        height: Height of the image in pixels.
        fx: Focal length along x in pixels.
        fy: Focal length along y in pixels.
        cx: Column of the principal point. The centre of the first pixel is at 0.
        cy: Row of the principal point.
        distortion_model: Name of the distortion model.
        distortion: Coefficients of the model, as COEFFICIENTS lists them.
        T_base_camera: (4, 4) float64 pose of the camera frame in the base frame of the robot, in metres.

    Raises:
        DataError: A value is invalid or implausible: the field of view, the principal point, the number of
            coefficients, a distortion that is not invertible, or a T_base_camera that is not a rigid motion.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: DistortionModel | str = DistortionModel.NONE
    distortion: Sequence[float] = ()
    T_base_camera: np.ndarray = field(default_factory=LEVEL.copy)

    def __post_init__(self) -> None:
        self._check_distortion()
        self._check_pinhole()
        self._check_extrinsics()
        if self.lost_share > MAX_LOST_SHARE:
            raise DataError(
                f"the {self.distortion_model} distortion {list(self.distortion)} is not invertible in "
                f"{self.lost_share:.0%} of the image, expected at most {MAX_LOST_SHARE:.0%}: check that the "
                f"coefficients are {', '.join(COEFFICIENTS[self._model])}, and that fx, fy, cx and cy are in pixels "
                "of this image"
            )

    @classmethod
    def of_field_of_view(cls, width: int, height: int, fov_deg: float, elevation_deg: float = 0.0) -> Camera:
        """Return a camera without distortion, with the principal point at the centre of the image.

        Args:
            width: Width of the image in pixels.
            height: Height of the image in pixels.
            fov_deg: Horizontal field of view in degrees.
            elevation_deg: Elevation of the optical axis in degrees, positive upwards.

        Raises:
            DataError: The field of view is not from MIN_FOV_DEG to MAX_FOV_DEG, or the elevation not from -90 to 90.
        """
        if not MIN_FOV_DEG <= fov_deg <= MAX_FOV_DEG:
            raise DataError(
                f"the camera has a horizontal field of view of {fov_deg:g} deg, expected {MIN_FOV_DEG:g} to "
                f"{MAX_FOV_DEG:g} deg: correct fov_deg"
            )
        if not abs(elevation_deg) <= 90:
            raise DataError(
                f"the camera looks up by {elevation_deg:g} deg, expected -90 to 90 deg: correct elevation_deg"
            )
        c, s = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))
        look_up = np.array([[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 0], [0, 0, 0, 1]])
        focal = float(width / 2 / np.tan(np.radians(fov_deg) / 2))
        centre = (width - 1) / 2, (height - 1) / 2
        return cls(width, height, focal, focal, *centre, T_base_camera=look_up @ LEVEL)

    def scaled(self, width: int, height: int) -> Camera:
        """Return the camera for images of this camera that were resized to a new width and height in pixels."""
        x, y = width / self.width, height / self.height
        centre = (self.cx + 0.5) * x - 0.5, (self.cy + 0.5) * y - 0.5
        focal = self.fx * x, self.fy * y
        return Camera(width, height, *focal, *centre, self._model, self.distortion, self.T_base_camera)

    @property
    def rotation(self) -> np.ndarray:
        """Rotation from the camera frame to the base frame and to the panorama, (3, 3) float64."""
        return self.T_base_camera[:3, :3]

    @property
    def position_m(self) -> np.ndarray:
        """Position of the camera in the base frame in metres, (3,) float64."""
        return self.T_base_camera[:3, 3]

    @property
    def matrix(self) -> np.ndarray:
        """Intrinsic matrix K, (3, 3) float64."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    @property
    def notes(self) -> tuple[str, ...]:
        """One-line warnings about an unusual calibration: the direction of the optical axis, a rolled image, and pixels
        where the distortion is not invertible."""
        notes = []
        elevation_deg, roll_deg = np.degrees(np.arcsin(np.clip(self.rotation[2, [2, 0]], -1, 1)))
        frames = (
            "expected T_base_camera to map the optical frame (x right, y down, z forward) to the base frame (x "
            "forward, y left, z up)"
        )
        if abs(elevation_deg) > MAX_ELEVATION_DEG:
            way = "up" if elevation_deg > 0 else "down"
            notes.append(f"the optical axis of the camera points {way} by {abs(elevation_deg):.0f} deg; {frames}")
        elif abs(roll_deg) > MAX_ROLL_DEG:
            notes.append(f"the image is rolled: its x axis has an elevation of {roll_deg:.0f} deg; {frames}")
        if self.lost_share > 0:
            notes.append(
                f"{self.lost_share:.1%} of the pixels are ignored, because the lens distortion is not invertible there"
            )
        return tuple(notes)

    @cached_property
    def max_angle_rad(self) -> float:
        """Maximum angle from the optical axis at which the distortion is invertible. Its tangential part is ignored."""
        numerator, denominator = self._radial
        folds = numerator.deriv() * denominator - numerator * denominator.deriv()
        if self._model is DistortionModel.FISHEYE:
            return _first_root([folds], np.pi)
        radius = _first_root([folds, denominator], np.tan(MAX_PINHOLE_ANGLE_RAD))
        return float(np.arctan(radius * (1 - 1e-9)))  # just below a pole

    @cached_property
    def lost_share(self) -> float:
        """Share of the image where the distortion is not invertible. Its pixels have no known direction."""
        y, x = np.ogrid[0 : self.height - 1 : 101j, 0 : self.width - 1 : 101j]
        radius = np.hypot((x - self.cx) / self.fx, (y - self.cy) / self.fy)
        return float((radius > self._distorted(self.max_angle_rad)).mean())

    def project(self, directions: np.ndarray) -> np.ndarray:
        """Project directions to the image.

        Args:
            directions: (..., 3) directions of any length in the panorama frame.

        Returns:
            (..., 2) float64 columns and rows. The centre of the first pixel is at 0. The positions may be outside the
            image, see `contains`. NaN for directions behind the camera, and where the distortion is not invertible.
        """
        import cv2

        local = np.asarray(directions, np.float64) @ self.rotation
        aside = np.hypot(local[..., 0], local[..., 1])
        angle = np.arctan2(aside, local[..., 2])
        is_ahead = angle < self.max_angle_rad
        pixels = np.full((*local.shape[:-1], 2), np.nan)
        if not is_ahead.any():
            return pixels
        local, aside, angle = local[is_ahead], aside[is_ahead], angle[is_ahead]
        if self._model is DistortionModel.FISHEYE:  # cv2.fisheye mirrors directions behind the image plane
            scale = self._distorted(angle) / np.maximum(aside, 1e-12)
            pixels[is_ahead] = local[:, :2] * scale[:, None] * (self.fx, self.fy) + (self.cx, self.cy)
        else:
            unmoved, coefficients = np.zeros(3), np.array(self.distortion or [0.0] * 5)
            pixels[is_ahead] = cv2.projectPoints(local, unmoved, unmoved, self.matrix, coefficients)[0][:, 0]
        return pixels

    def contains(self, pixels: np.ndarray) -> np.ndarray:
        """Return whether pixels (..., 2) of `project` are in the image, (...) bool."""
        return np.all((pixels >= -0.5) & (pixels < (self.width - 0.5, self.height - 0.5)), axis=-1)

    def rays(self) -> np.ndarray:
        """Return unit vectors through the pixel centres in the panorama frame, (height, width, 3) float64.

        They are NaN where the distortion is not invertible.
        """
        import cv2

        y, x = np.mgrid[: self.height, : self.width].astype(np.float64)
        plane = np.stack([(x - self.cx) / self.fx, (y - self.cy) / self.fy], -1)
        radius = np.linalg.norm(plane, axis=-1)
        if self._model is DistortionModel.FISHEYE:
            angles = np.linspace(0, self.max_angle_rad, 8192)
            angle = np.interp(radius, self._distorted(angles), angles)
            plane *= (np.sin(angle) / np.maximum(radius, 1e-12))[..., None]
            local = np.concatenate([plane, np.cos(angle)[..., None]], -1)
        else:
            if any(self.distortion):
                stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-10)
                coefficients = np.array(self.distortion)
                points = cv2.undistortPoints(plane.reshape(-1, 1, 2), np.eye(3), coefficients, criteria=stop)
                plane = points.reshape(plane.shape)
            local = np.concatenate([plane, np.ones_like(x)[..., None]], -1)
            local /= np.linalg.norm(local, axis=-1, keepdims=True)
        local[radius > self._distorted(self.max_angle_rad)] = np.nan
        return local @ self.rotation.T  # type: ignore[no-any-return]

    def sampling(self, height: int) -> tuple[np.ndarray, np.ndarray]:
        """Project the pixels of a panorama to the image.

        Args:
            height: Height H of the panorama.

        Returns:
            (H, 2H) bool, whether the image shows each pixel of the panorama, and (H, 2H, 2) float32 columns and rows
            in the image, as from `project`.
        """
        rays = equirectangular_rays(height)
        near = rays @ self.rotation[:, 2].astype(np.float32) > np.cos(self._reach_rad)
        shown, pixels = self.project(rays[near]), np.full((*near.shape, 2), np.nan, np.float32)
        is_shown = np.zeros(near.shape, bool)
        pixels[near], is_shown[near] = shown, self.contains(shown)
        return is_shown, pixels

    @cached_property
    def _reach_rad(self) -> float:
        """Angle from the optical axis that contains the whole image, with a margin for tangential distortion."""
        x, y = max(self.cx, self.width - self.cx) / self.fx, max(self.cy, self.height - self.cy) / self.fy
        angles = np.linspace(0, self.max_angle_rad, 8192)
        corner = np.interp(1.5 * np.hypot(x, y), self._distorted(angles), angles)
        return min(float(corner), np.pi)

    @property
    def _model(self) -> DistortionModel:
        return DistortionModel(self.distortion_model)

    @cached_property
    def _radial(self) -> tuple[Polynomial, Polynomial]:
        """The distorted radius as a ratio of two polynomials in the radius without distortion (fisheye: in the
        angle)."""
        k = dict(zip(COEFFICIENTS[self._model], self.distortion, strict=True))
        num_powers = 4 if self._model is DistortionModel.FISHEYE else 3
        numerator = [1.0, *(k.get(f"k{power}", 0.0) for power in range(1, num_powers + 1))]
        denominator = [1.0, *(k.get(f"k{power}", 0.0) for power in range(num_powers + 1, 7))]
        square = Polynomial([0, 0, 1])
        return Polynomial(numerator)(square) * Polynomial([0, 1]), Polynomial(denominator)(square)

    def _distorted(self, angle_rad: np.ndarray | float) -> np.ndarray:
        """Return the distorted radius on the image plane at focal length 1, by the angle from the optical axis."""
        numerator, denominator = self._radial
        radius = angle_rad if self._model is DistortionModel.FISHEYE else np.tan(angle_rad)
        return np.asarray(numerator(radius) / denominator(radius))

    def _check_pinhole(self) -> None:
        """Check the size of the image, the focal lengths and the principal point. Raises DataError."""
        values = {name: getattr(self, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
        is_finite = all(isinstance(value, Real) and np.isfinite(float(value)) for value in values.values())
        if not is_finite or min(self.width, self.height, self.fx, self.fy) <= 0:
            received = ", ".join(f"{name} {value!r}" for name, value in values.items())
            raise DataError(
                f"the camera has {received}, expected finite numbers, with width, height, fx and fy above 0"
            )
        size = f"{self.width} x {self.height}"
        if not 1 / MAX_PIXEL_RATIO <= self.fx / self.fy <= MAX_PIXEL_RATIO:
            raise DataError(
                f"the camera has fx {self.fx:g} and fy {self.fy:g}, expected a ratio fx / fy from "
                f"{1 / MAX_PIXEL_RATIO:g} to {MAX_PIXEL_RATIO:g}: set both in pixels"
            )
        across = max(self.width / self.fx, self.height / self.fy)
        is_fisheye = self._model is DistortionModel.FISHEYE
        fov_deg = float(np.degrees(across if is_fisheye else 2 * np.arctan(across / 2)))
        max_deg = MAX_FISHEYE_FOV_DEG if is_fisheye else MAX_FOV_DEG
        if not MIN_FOV_DEG <= fov_deg <= max_deg:
            raise DataError(
                f"the camera has a field of view of {fov_deg:.4g} deg (fx {self.fx:g} and fy {self.fy:g} for {size} "
                f"pixels), expected {MIN_FOV_DEG:g} to {max_deg:g} deg: set fx and fy in pixels of this image"
            )
        if not (-0.5 <= self.cx <= self.width - 0.5 and -0.5 <= self.cy <= self.height - 0.5):
            raise DataError(
                f"the camera has the principal point cx {self.cx:g}, cy {self.cy:g}, expected a point in its image of "
                f"{size} pixels: set cx and cy in pixels of this image"
            )

    def _check_distortion(self) -> None:
        """Check the name and the coefficients of the distortion model. Raises DataError."""
        try:
            object.__setattr__(self, "distortion_model", DistortionModel(self.distortion_model))
        except ValueError:
            raise DataError(
                f"the distortion_model of the camera is {self.distortion_model!r}, expected one of "
                f"{', '.join(DistortionModel)}: for another model, undistort the images and set distortion_model to "
                "none"
            ) from None
        names = COEFFICIENTS[self._model]
        values = check_array(self, "distortion", np.float64, None)
        if len(values) != len(names):
            expected = f"{len(names)} ({', '.join(names)})" if names else "none"
            raise DataError(
                f"the key distortion of the camera has {len(values)} coefficients, expected {expected} for the "
                f"distortion_model {self.distortion_model}"
            )
        if not np.isfinite(values).all():
            raise DataError(f"the distortion coefficients of the camera are {values.tolist()}, expected finite numbers")
        object.__setattr__(self, "distortion", tuple(values.tolist()))
        tangential = {name: self.distortion[names.index(name)] for name in ("p1", "p2") if name in names}
        if any(abs(value) > MAX_TANGENTIAL for value in tangential.values()):
            received = " and ".join(f"{name} {value:g}" for name, value in tangential.items())
            raise DataError(
                f"the distortion coefficients of the camera have {received}, expected magnitudes of at most "
                f"{MAX_TANGENTIAL:g}: list the coefficients in the order {', '.join(names)}"
            )

    def _check_extrinsics(self) -> None:
        """Check the pose of the camera on its base. Raises DataError."""
        T = check_array(self, "T_base_camera", np.float64, 4, 4)
        if not is_rigid(T, RIGID_TOLERANCE):
            is_mirrored = np.isfinite(T).all() and np.linalg.det(T[:3, :3]) < 0
            reason = "is left-handed (a mirror)" if is_mirrored else "is not a rigid motion"
            raise DataError(
                f"the camera pose T_base_camera {T.tolist()} {reason}, expected the pose of the camera on the robot's "
                "base: a rotation, a translation in metres, and the last row 0 0 0 1"
            )
        if np.abs(T[:3, 3]).max() > MAX_POSITION_M:
            raise DataError(
                f"the camera pose T_base_camera has the translation {T[:3, 3].tolist()} m, expected at most "
                f"{MAX_POSITION_M:g} m along each axis: use metres"
            )


def _first_root(polynomials: Sequence[Polynomial], limit: float) -> float:
    """Return the smallest positive real root of polynomials; the limit if no root is below it."""
    roots = np.concatenate([polynomial.roots() for polynomial in polynomials])
    real = roots.real[np.abs(roots.imag) < 1e-9]
    return float(real[(real > 0) & (real < limit)].min(initial=limit))
