"""Photographs as partial panoramas: the part of the sphere that a camera shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import equirectangular_rays, sample_nearest
from salframe.panoramas.panorama import Annotations, Panorama, clean_range
from salframe.panoramas.range_encoding import RangeKind

MIN_ROWS, MAX_ROWS = 256, 1024
"""Limits of the height of a photograph's panorama. Between them, it has the resolution of the photograph's centre."""


def lay_on_sphere(camera: Camera, image: np.ndarray, height: int, *, smooth: bool = True) -> np.ndarray:
    """Project an image of a camera to a panorama.

    Args:
        camera: The camera.
        image: (camera.height, camera.width, ...) image.
        height: Height H of the panorama.
        smooth: Whether to interpolate bilinearly. Otherwise the nearest pixel is used, for values that must not be
            mixed (labels, ranges with holes).

    Returns:
        (H, 2H, ...) image, 0 outside the view of the camera.
    """
    return _lay(image, *camera.sampling(height), smooth=smooth)


def see_panorama(camera: Camera, panorama_image: np.ndarray) -> np.ndarray:
    """Return the image (camera.height, camera.width, ...) that a camera shows of a panorama image (H, 2H, ...).

    The nearest pixel is used.

    Raises:
        DataError: The distortion of the camera is not invertible in a part of its image.
    """
    if camera.lost_share > 0:
        raise DataError(
            f"the lens distortion of the camera is not invertible in {camera.lost_share:.1%} of the pixels, expected "
            f"an invertible distortion in the whole image: check the coefficients {list(camera.distortion)}"
        )
    return sample_nearest(panorama_image, camera.rays())


def photograph_panorama(
    camera: Camera,
    name: str,
    rgb: np.ndarray,
    depth_m: np.ndarray | None = None,
    *,
    kind: RangeKind | str = RangeKind.Z,
    instance_id: np.ndarray | None = None,
    labels: Mapping[int, str] | None = None,
    height: int | None = None,
) -> Panorama:
    """Return a photograph as a partial panorama, without distortion and with the axes of the camera's base.

    Args:
        camera: The camera.
        name: Id of the panorama.
        rgb: (h, w, 3) uint8 photograph, of the size of the camera.
        depth_m: (h, w) float depth image in metres, NaN where unknown, as `range_m` of Panorama.
        kind: Z: depth along the optical axis; RAY: range along the ray.
        instance_id: (h, w) integer image of the objects, 0 where there is none.
        labels: Label of each instance id.
        height: Height of the panorama. None: the height, from MIN_ROWS to MAX_ROWS, that is closest to the resolution
            at the centre of the photograph.

    Raises:
        DataError: An image has another size.
    """
    import cv2

    for what, image in (("photograph", rgb), ("depth image", depth_m), ("instance image", instance_id)):
        if image is not None and np.shape(image)[:2] != (camera.height, camera.width):
            received = " x ".join(map(str, np.shape(image)[1::-1]))
            raise DataError(
                f"{name}: the {what} is {received}, expected {camera.width} x {camera.height}, the image size of the "
                "camera"
            )
    height = height or int(np.clip(round(np.pi * camera.fx), MIN_ROWS, MAX_ROWS))
    is_shown, pixels = camera.sampling(height)
    range_m = annotations = None
    if depth_m is not None:
        depth_m = clean_range(depth_m, f"{name}: depth_m")
        range_m = _lay(depth_m, is_shown, pixels, smooth=False)
        if kind == RangeKind.Z:
            cosine = equirectangular_rays(height) @ camera.rotation[:, 2].astype(np.float32)
            range_m = range_m / np.where(cosine > 0, cosine, np.nan)
        range_m[~is_shown] = np.nan
    if instance_id is not None:
        annotations = Annotations(_lay(instance_id, is_shown, pixels, smooth=False), labels or {})
    if (factor := int(np.pi * camera.fx / height)) > 1:  # average an image of higher resolution to avoid aliasing
        size = max(1, camera.width // factor), max(1, camera.height // factor)
        scale = np.array(size, np.float32) / (camera.width, camera.height)
        rgb, pixels = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), (pixels + 0.5) * scale - 0.5
    return Panorama(name, _lay(rgb, is_shown, pixels.astype(np.float32)), range_m, is_shown, annotations)


def _lay(image: np.ndarray, is_shown: np.ndarray, pixels: np.ndarray, *, smooth: bool = True) -> np.ndarray:
    """Sample an image at `pixels` (H, 2H, 2) where `is_shown` (H, 2H) is true. The result is 0 elsewhere."""
    import cv2

    laid: np.ndarray
    if smooth:
        columns, rows = np.moveaxis(np.where(is_shown[..., None], pixels, np.float32(0)), -1, 0)
        laid = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        laid[~is_shown] = 0
        return laid
    height, width = image.shape[:2]
    columns, rows = np.floor(pixels[is_shown] + 0.5).astype(int).T
    laid = np.zeros((*is_shown.shape, *image.shape[2:]), image.dtype)
    laid[is_shown] = image[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    return laid
