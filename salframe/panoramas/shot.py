"""Image files as a panorama: equirectangular, with what a manifest says of it, or a plain photograph."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_json
from salframe.panoramas import images
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.folder_format import IMAGE_KEYS, Folder
from salframe.panoramas.geometry import range_of_cube_depth
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.photograph import Pinhole

_DIGITS = 5
"""Of an instance id in an image of 16 bits."""
LOWEST, HIGHEST = 256, 1024
"""A photograph is laid on a panorama as fine as its middle, of no fewer and no more rows than these."""


@dataclass(frozen=True, eq=False)
class Shot:
    """An image as it was taken, rgb (H, W, 3) uint8, as the panorama that components look at, and the camera of a
    photograph; None of a panorama."""

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
    """A panorama of loose image files, each twice as wide as high, all of one size; at least one.

    rgb: JPEG or PNG; range_image: 16 bits, one step of which is `range_unit_m` metres along the ray, 0 where unknown,
    or with z_depth along the axis of the cube's face that the ray goes through, as in panoramas stitched from cube
    maps; instances: 16 bits, an object's id at each pixel, 0 where there is none, with labels, JSON such as
    {"1": "bed"}. It is called as its first file. Raises DataError.
    """
    given = [Path(path) for path in (rgb, range_image, instances) if path is not None]
    if not given:
        raise DataError("received no image, expected an rgb, range or instance image")
    if (instances is None) != (labels is None):
        raise DataError("received one of an instance image and its labels, expected both or neither")
    range_m = None if range_image is None else images.read_range(Path(range_image), range_unit_m)
    panorama = Panorama(
        given[0].name,
        None if rgb is None else images.read_color(Path(rgb)),
        range_m,
        annotations=None
        if instances is None or labels is None
        else Annotations(images.read_ids(Path(instances)), _read_labels(Path(labels))),
    )
    if panorama.range_m is None or not z_depth:
        return panorama
    return replace(panorama, range_m=range_of_cube_depth(panorama.range_m))


def _read_labels(path: Path) -> dict[int, str]:
    content = read_json(path)
    if not isinstance(content, dict) or not all(
        id.isascii() and id.isdecimal() and len(id) <= _DIGITS and isinstance(label, str)
        for id, label in content.items()
    ):
        raise DataError(f'{path} holds something else than labels, expected JSON such as {{"1": "bed", "2": "lamp"}}')
    return {int(id): label for id, label in content.items()}


def open_panorama(image: Path, range_image: Path | None = None) -> Shot:
    """A panorama with the range in a file of 16-bit millimetres; without that, with all that the frame has whose rgb a
    manifest.json above it says the image is. Raises DataError."""
    panorama = None if range_image is not None else _in_manifest(image.resolve())
    if panorama is None:
        rgb = images.read_color(image)
        height, width = rgb.shape[:2]
        if width != 2 * height:
            raise DataError(
                f"{image} is {width} x {height}, expected a panorama, twice as wide as high: of a photograph, "
                "say the horizontal field of view (--fov DEG)"
            )
        range_m = None if range_image is None else images.read_range(range_image)
        panorama = Panorama(image.name, rgb, range_m)
    if panorama.rgb is None:
        raise DataError(f"{image} has no colour")
    return Shot(panorama.rgb, panorama)


def open_photograph(image: Path, hfov_rad: float, pitch_rad: float = 0.0, depth_image: Path | None = None) -> Shot:
    """A photograph of this horizontal field of view, taken looking up by pitch_rad, with the z-depth in a file of
    16-bit millimetres. Raises DataError."""
    import cv2

    rgb = images.read_color(image)
    depth_m = None if depth_image is None else images.read_range(depth_image)
    height, width = rgb.shape[:2]
    if depth_m is not None and depth_m.shape != (height, width):
        raise DataError(f"{depth_image} is {depth_m.shape[1]} x {depth_m.shape[0]}, expected {width} x {height}")
    camera = Pinhole.of_field_of_view(width, height, hfov_rad, pitch_rad)
    rows = int(np.clip(round(np.pi * camera.focal_px), LOWEST, HIGHEST))
    laid = camera
    if (factor := int(np.pi * camera.focal_px / rows)) > 1:  # far finer than the panorama: average first, or it aliases
        size = width // factor, height // factor
        rgb_laid = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        depth_m = None if depth_m is None else cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST)
        laid = Pinhole.of_field_of_view(*size, hfov_rad, pitch_rad)
    else:
        rgb_laid = rgb
    return Shot(rgb, laid.panorama(image.name, rgb_laid, depth_m, rows), camera)


def _in_manifest(image: Path) -> Panorama | None:
    """The panorama of the frame whose rgb an image is; None where no manifest.json above it names it."""
    root = next((parent for parent in image.parents if (parent / MANIFEST).exists()), None)
    if root is None:
        return None
    folder, name = Folder(root), image.relative_to(root).as_posix()
    for frame in folder.manifest.frames:
        if name == frame.rgb:
            return folder.load(frame)
        if other := next((key for key in IMAGE_KEYS if name == getattr(frame, key)), None):
            raise DataError(f"{image} is no picture but the {other} image of {frame.id}, expected its rgb: {frame.rgb}")
    return None
