"""Plain photographs as partial panoramas: the part of the sphere that a pinhole camera saw."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels
from salframe.panoramas.panorama import Panorama

LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""From the axes of a camera that looks level along +x (x right, y down, z forward) to the panorama frame."""


@dataclass(frozen=True, eq=False)
class Pinhole:
    """An ideal camera: size and focal length in pixels, the principal point (x, y) with pixel centres at +0.5, and how
    it was held: rotation (3, 3) float64 from camera axes (x right, y down, z forward) to the panorama frame."""

    width_px: int
    height_px: int
    focal_px: float
    centre_px: tuple[float, float]
    rotation: np.ndarray = field(default_factory=LEVEL.copy)

    def __post_init__(self) -> None:
        check_array(self, "rotation", np.float64, 3, 3)
        if not (self.width_px > 0 and self.height_px > 0 and 0 < self.focal_px < np.inf):
            raise DataError(
                f"a camera of {self.width_px} x {self.height_px} pixels has the focal length {self.focal_px}, "
                "expected positive numbers"
            )

    @classmethod
    def of_field_of_view(cls, width_px: int, height_px: int, hfov_rad: float, pitch_rad: float = 0.0) -> Pinhole:
        """A camera whose principal point is the image's centre, looking up by pitch_rad; hfov_rad is its horizontal
        field of view. Raises DataError where that is not between 0 and pi."""
        if not 0 < hfov_rad < np.pi:
            raise DataError(f"a photograph has a field of view of {np.degrees(hfov_rad):g} deg, expected 0 to 180")
        c, s = np.cos(pitch_rad), np.sin(pitch_rad)
        up = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        focal_px = width_px / 2 / np.tan(hfov_rad / 2)
        return cls(width_px, height_px, focal_px, (width_px / 2, height_px / 2), up @ LEVEL)

    def rays(self) -> np.ndarray:
        """(height_px, width_px, 3) float64 through the pixel centres, in the panorama frame, 1 long along the optical
        axis: times z-depth they are points, and their lengths times z-depth the range along the ray."""
        y, x = np.mgrid[: self.height_px, : self.width_px] + 0.5
        local = np.stack(
            [(x - self.centre_px[0]) / self.focal_px, (y - self.centre_px[1]) / self.focal_px, np.ones_like(x)], -1
        )
        return local @ self.rotation.T

    def sees(self, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which pixels of a panorama of this height it sees, (H, 2H) bool, and where: float32 columns and rows (H, 2H)
        in OpenCV's pixels (centres at 0), meaningless elsewhere."""
        right, down, forward = np.moveaxis(equirectangular_rays(height) @ self.rotation, -1, 0)
        ahead = np.maximum(forward, 1e-6)
        x, y = (
            self.focal_px * side / ahead + centre for side, centre in zip((right, down), self.centre_px, strict=True)
        )
        inside = (forward > 0) & (x >= 0) & (x < self.width_px) & (y >= 0) & (y < self.height_px)
        return inside, (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)

    def lay_on_sphere(self, image: np.ndarray, height: int, *, smooth: bool = True) -> np.ndarray:
        """(H, 2H, ...) an image (height_px, width_px, ...) as a panorama of this height shows it, 0 where it does not;
        bilinear, or the nearest pixel where values are not to be mixed (labels, ranges with holes)."""
        import cv2

        inside, columns, rows = self.sees(height)
        laid = cv2.remap(
            image, columns, rows, cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE
        )
        laid[~inside] = 0
        return laid

    def see(self, panorama_image: np.ndarray) -> np.ndarray:
        """(height_px, width_px, ...) what each pixel shows of a panorama's image (H, 2H, ...), the nearest pixel."""
        height = panorama_image.shape[0]
        columns, rows = rays_to_pixels(self.rays(), height)
        return panorama_image[np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)]

    def panorama(self, name: str, rgb: np.ndarray, depth_m: np.ndarray | None = None, height: int = 512) -> Panorama:
        """A photograph (height_px, width_px, 3) uint8 as a partial panorama of this height; depth_m (height_px,
        width_px) float, z-depth in metres, NaN where unknown. Raises DataError on images of another size."""
        for what, image in (("photograph", rgb), ("depth image", depth_m)):
            if image is not None and image.shape[:2] != (self.height_px, self.width_px):
                raise DataError(
                    f"the {what} is {image.shape[1]} x {image.shape[0]}, expected {self.width_px} x {self.height_px}"
                )
        range_m = None
        if depth_m is not None:
            along_ray = np.asarray(depth_m * np.linalg.norm(self.rays(), axis=-1), np.float32)
            range_m = self.lay_on_sphere(np.nan_to_num(along_ray), height, smooth=False)
            range_m[range_m <= 0] = np.nan
        return Panorama(name, self.lay_on_sphere(rgb, height), range_m, self.sees(height)[0])
