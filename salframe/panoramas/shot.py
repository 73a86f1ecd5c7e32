"""Read image files as a panorama: equirectangular images, an image of a dataset folder, or a photograph."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_json
from salframe.panoramas import images
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.folder_format import IMAGE_KEYS, Folder
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.panorama_files import load_panorama
from salframe.panoramas.photo_sphere import declares_panorama
from salframe.panoramas.photograph import Pinhole

_MAX_DIGITS = 5
"""Maximum number of digits of an instance id in a 16-bit image."""
MIN_ROWS, MAX_ROWS = 256, 1024
"""Limits of the height of the panorama of a photograph, which has the resolution of the centre of the photograph."""


@dataclass(frozen=True, eq=False)
class Shot:
    """An image and its panorama.

    Attributes:
        rgb: (H, W, 3) uint8, the original image.
        panorama: The panorama for components.
        camera: The camera of a photograph; None for a panorama.
    """

    rgb: np.ndarray
    panorama: Panorama
    camera: Pinhole | None = None


def read_panorama(
    rgb: str | Path | None = None,
    range_image: str | Path | None = None,
    instances: str | Path | None = None,
    labels: str | Path | None = None,
    *,
    range_unit_m: float = images.MILLIMETRE,
    z_depth: bool = False,
) -> Panorama:
    """Read a panorama from image files of equal size, with width = 2 x height. At least one image is required.

    The id of the panorama is the name of its first file.

    Args:
        rgb: JPEG or PNG file.
        range_image: 16-bit file, 0 where the range is unknown.
        instances: 16-bit file with the id of the object at each pixel, 0 where there is none.
        labels: JSON file with the label of each id, such as {"1": "bed"}.
        range_unit_m: Unit of the range image in metres.
        z_depth: Whether the range image has z-depth, as in panoramas stitched from cube maps: depth along the axis of
            the cube face that the ray passes through. Otherwise it has the range along the ray.

    Raises:
        DataError: A file is missing or malformed.
    """
    files = [Path(path) for path in (rgb, range_image, instances) if path is not None]
    if not files:
        raise DataError("received no image, expected an rgb, range or instance image")
    if (instances is None) != (labels is None):
        received = "labels without an instance image" if instances is None else "an instance image without labels"
        raise DataError(f"received {received}, expected both or neither")
    return load_panorama(
        files[0].name,
        rgb=None if rgb is None else Path(rgb),
        range_image=None if range_image is None else Path(range_image),
        instances=None if instances is None else Path(instances),
        labels=None if labels is None else _read_labels(Path(labels)),
        range_unit_m=range_unit_m,
        z_depth=z_depth,
    )


def _read_labels(path: Path) -> dict[int, str]:
    content = read_json(path)
    if not isinstance(content, dict) or not all(
        id.isascii() and id.isdecimal() and len(id) <= _MAX_DIGITS and isinstance(label, str)
        for id, label in content.items()
    ):
        raise DataError(f'{path} does not contain labels, expected JSON such as {{"1": "bed", "2": "lamp"}}')
    return {int(id): label for id, label in content.items()}


def open_panorama(image: Path, range_image: Path | None = None) -> Shot:
    """Read a panorama.

    Without a range image, an image of a dataset folder gets all parts of its frame.

    Args:
        image: The rgb image.
        range_image: Range in 16-bit millimetres.

    Raises:
        DataError: A file is missing or malformed, or the image is not equirectangular.
    """
    panorama = None if range_image is not None else _in_manifest(image.resolve())
    if panorama is None:
        panorama = load_panorama(image.name, rgb=image, range_image=range_image)
    if panorama.rgb is None:
        raise DataError(f"{image} has no colour, expected an rgb image")
    return Shot(panorama.rgb, panorama)


def open_photograph(image: Path, hfov_rad: float, pitch_rad: float = 0.0, depth_image: Path | None = None) -> Shot:
    """Read a photograph as a partial panorama.

    Args:
        image: The photograph.
        hfov_rad: Horizontal field of view.
        pitch_rad: Elevation of the optical axis.
        depth_image: Z-depth in 16-bit millimetres, of the same size.

    Raises:
        DataError: A file is missing or malformed, or the images differ in size.
    """
    import cv2

    file = images.read_color_file(image)
    if declares_panorama(file, image):
        raise DataError(f"{image} is an equirectangular panorama by its XMP, expected a photograph: leave out --fov")
    rgb = file.pixels
    depth_m = None if depth_image is None else images.read_range(depth_image)
    height, width = rgb.shape[:2]
    if depth_m is not None and depth_m.shape != (height, width):
        raise DataError(f"{depth_image} is {depth_m.shape[1]} x {depth_m.shape[0]}, expected {width} x {height}")
    camera = Pinhole.of_field_of_view(width, height, hfov_rad, pitch_rad)
    rows = int(np.clip(round(np.pi * camera.focal_px), MIN_ROWS, MAX_ROWS))
    small_camera = camera
    if (factor := int(np.pi * camera.focal_px / rows)) > 1:  # average an image of higher resolution to avoid aliasing
        size = width // factor, height // factor
        small_rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        depth_m = None if depth_m is None else cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST)
        small_camera = Pinhole.of_field_of_view(*size, hfov_rad, pitch_rad)
    else:
        small_rgb = rgb
    panorama = small_camera.panorama(image.name, small_rgb, depth_m, rows)
    return Shot(rgb, replace(panorama, notes=(file.note,) if file.note else ()), camera)


def _in_manifest(image: Path) -> Panorama | None:
    """Return the panorama of the frame whose rgb image this is; None where no manifest.json above it names it."""
    root = next((parent for parent in image.parents if (parent / MANIFEST).exists()), None)
    if root is None:
        return None
    folder, name = Folder(root), image.relative_to(root).as_posix()
    for frame in folder.manifest.frames:
        if name == frame.rgb:
            return folder.load(frame)
        if other := next((key for key in IMAGE_KEYS if name == getattr(frame, key)), None):
            raise DataError(f"{image} is the {other} image of {frame.id}, expected its rgb image: {frame.rgb}")
    return None
