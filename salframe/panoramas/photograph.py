"""Photographs as partial panoramas: the part of the sphere that a pinhole camera shows."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.panoramas.geometry import are_rotations, equirectangular_rays, rays_to_pixels
from salframe.panoramas.panorama import Panorama, clean_range

LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from the axes of a level camera that looks along +x (x right, y down, z forward) to the panorama frame."""


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A pinhole camera without distortion.

    Attributes:
        width_px: Width of the image.
        height_px: Height of the image.
        focal_px: Focal length.
        centre_px: Principal point (x, y); pixel centres are at +0.5.
        rotation: (3, 3) float64 from camera axes (x right, y down, z forward) to the panorama frame.
    """

    width_px: int
    height_px: int
    focal_px: float
    centre_px: tuple[float, float]
    rotation: np.ndarray = field(default_factory=LEVEL.copy)

    def __post_init__(self) -> None:
        rotation = check_array(self, "rotation", np.float64, 3, 3)
        if not (np.isfinite(rotation).all() and are_rotations(rotation, 1e-3) and np.isfinite(self.centre_px).all()):
            raise DataError(
                f"a camera has the rotation {rotation.tolist()} and the principal point {self.centre_px}, expected a "
                "rotation without scale or mirror and finite numbers"
            )
        if not (self.width_px > 0 and self.height_px > 0 and 0 < self.focal_px < np.inf):
            raise DataError(
                f"a camera has {self.width_px} x {self.height_px} pixels and a focal length of {self.focal_px}, "
                "expected positive finite numbers"
            )

    @classmethod
    def of_field_of_view(cls, width_px: int, height_px: int, hfov_rad: float, pitch_rad: float = 0.0) -> Pinhole:
        """Return a camera with the principal point at the centre of the image.

        Args:
            width_px: Width of the image.
            height_px: Height of the image.
            hfov_rad: Horizontal field of view.
            pitch_rad: Elevation of the optical axis.

        Raises:
            DataError: The field of view is not between 0 and pi, or the pitch not between -pi / 2 and pi / 2.
        """
        if not 0 < hfov_rad < np.pi:
            raise DataError(f"a photograph has a field of view of {np.degrees(hfov_rad):g} deg, expected 0 to 180")
        if not abs(pitch_rad) <= np.pi / 2:
            raise DataError(f"a photograph has a pitch of {np.degrees(pitch_rad):g} deg, expected -90 to 90")
        c, s = np.cos(pitch_rad), np.sin(pitch_rad)
        up = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        focal_px = width_px / 2 / np.tan(hfov_rad / 2)
        return cls(width_px, height_px, focal_px, (width_px / 2, height_px / 2), up @ LEVEL)

    def rays(self) -> np.ndarray:
        """Return rays through the pixel centres in the panorama frame, (height_px, width_px, 3) float64.

        Their component along the optical axis is 1: a ray times the z-depth is a point, and the length of a ray times
        the z-depth is the range along the ray.
        """
        y, x = np.mgrid[: self.height_px, : self.width_px] + 0.5
        local = np.stack(
            [(x - self.centre_px[0]) / self.focal_px, (y - self.centre_px[1]) / self.focal_px, np.ones_like(x)], -1
        )
        return local @ self.rotation.T

    def sees(self, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Project the pixels of a panorama to the camera.

        Args:
            height: Height H of the panorama.

        Returns:
            (H, 2H) bool, whether the camera shows each pixel of the panorama; and its column and row in the camera,
            (H, 2H) float32 each, with pixel centres at 0 (the convention of OpenCV), undefined where it is not shown.
        """
        right, down, forward = np.moveaxis(equirectangular_rays(height) @ self.rotation, -1, 0)
        ahead = np.maximum(forward, 1e-6)
        x, y = (
            self.focal_px * side / ahead + centre for side, centre in zip((right, down), self.centre_px, strict=True)
        )
        inside = (forward > 0) & (x >= 0) & (x < self.width_px) & (y >= 0) & (y < self.height_px)
        return inside, (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)

    def lay_on_sphere(self, image: np.ndarray, height: int, *, smooth: bool = True) -> np.ndarray:
        """Project an image of the camera to a panorama.

        Args:
            image: (height_px, width_px, ...) image.
            height: Height H of the panorama.
            smooth: Whether to interpolate bilinearly. Otherwise the nearest pixel is used, for values that must not be
                mixed (labels, ranges with holes).

        Returns:
            (H, 2H, ...) image, 0 outside the view of the camera.
        """
        import cv2

        inside, columns, rows = self.sees(height)
        laid = cv2.remap(
            image, columns, rows, cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE
        )
        laid[~inside] = 0
        return laid

    def see(self, panorama_image: np.ndarray) -> np.ndarray:
        """Return the camera's view of a panorama image (H, 2H, ...), (height_px, width_px, ...), nearest pixel."""
        height = panorama_image.shape[0]
        columns, rows = rays_to_pixels(self.rays(), height)
        return panorama_image[np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)]

    def panorama(self, name: str, rgb: np.ndarray, depth_m: np.ndarray | None = None, height: int = 512) -> Panorama:
        """Return a photograph as a partial panorama.

        Args:
            name: Id of the panorama.
            rgb: (height_px, width_px, 3) uint8 photograph.
            depth_m: (height_px, width_px) float z-depth in metres, NaN where unknown, as `range_m` of Panorama.
            height: Height of the panorama.

        Raises:
            DataError: An image has another size.
        """
        for what, image in (("photograph", rgb), ("depth image", depth_m)):
            if image is not None and np.shape(image)[:2] != (self.height_px, self.width_px):
                received = " x ".join(map(str, np.shape(image)[1::-1]))
                raise DataError(f"the {what} is {received}, expected {self.width_px} x {self.height_px}")
        range_m = None
        if depth_m is not None:
            depth_m = clean_range(depth_m, f"{name}: depth_m")
            along_ray = np.asarray(depth_m * np.linalg.norm(self.rays(), axis=-1), np.float32)
            range_m = self.lay_on_sphere(np.nan_to_num(along_ray), height, smooth=False)
            range_m[range_m <= 0] = np.nan
        return Panorama(name, self.lay_on_sphere(rgb, height), range_m, self.sees(height)[0])
