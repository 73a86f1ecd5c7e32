"""Read image files as a panorama: equirectangular images, an image of a dataset folder, or a photograph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_json
from salframe.panoramas import images
from salframe.panoramas.image_lookup import find_frame_image
from salframe.panoramas.panorama import Panorama, labels_by_id
from salframe.panoramas.panorama_files import load_panorama
from salframe.panoramas.photo_sphere import declares_panorama
from salframe.panoramas.photograph import Pinhole
from salframe.panoramas.range_encoding import MILLIMETRE, RangeEncoding, RangeKind

MIN_ROWS, MAX_ROWS = 256, 1024
"""Limits of the height of the panorama of a photograph, which has the resolution of the centre of the photograph."""


@dataclass(frozen=True, eq=False)
class Shot:
    """An image and its panorama.

    Attributes:
        rgb: (H, W, 3) uint8, the original image.
        panorama: The panorama for components.
        camera: The camera of a photograph; None for a panorama.
        depth_steps: (h, w) int32, values of the depth image of a photograph; None where there is none.
    """

    rgb: np.ndarray
    panorama: Panorama
    camera: Pinhole | None = None
    depth_steps: np.ndarray | None = None


def read_panorama(
    rgb: str | Path | None = None,
    range_image: str | Path | None = None,
    instances: str | Path | None = None,
    labels: str | Path | None = None,
    *,
    range_unit_m: float = MILLIMETRE,
    range_missing: Sequence[int] = (),
    range_kind: RangeKind | str = RangeKind.RAY,
    z_depth: bool = False,
) -> Panorama:
    """Read a panorama from image files of equal size, with width = 2 x height. At least one image is required.

    The id of the panorama is the name of its first file.

    Args:
        rgb: JPEG or PNG file.
        range_image: 16-bit file, 0 where the range is unknown.
        instances: 16-bit file with the id of the object at each pixel, 0 where there is none.
        labels: JSON file with the label of each id, such as {"1": "bed"}.
        range_unit_m: Metres per step of the range image.
        range_missing: Values of the range image that mean no reading, besides 0.
        range_kind: "ray": range along the ray; "cube": depth along the axis of the cube face that the ray passes
            through, as in panoramas stitched from cube maps.
        z_depth: Short for `range_kind="cube"`.

    Raises:
        DataError: A file is missing or malformed, an argument is not the path of a file, or the encoding of the range
            is invalid.
    """
    for name, file in (("rgb", rgb), ("range_image", range_image), ("instances", instances), ("labels", labels)):
        if file is not None and not isinstance(file, str | Path):
            raise DataError(
                f"{name} is {type(file).__name__}, expected the path of a file; for arrays, use salframe.Panorama"
            )
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
        labels=None if labels is None else labels_by_id(read_json(Path(labels)), str(labels)),
        encoding=RangeEncoding(range_unit_m, tuple(range_missing), RangeKind.CUBE if z_depth else range_kind),
    )


def open_panorama(image: Path, range_image: Path | None = None, encoding: RangeEncoding | None = None) -> Shot:
    """Read a panorama.

    Without a range image, an image of a dataset folder gets all parts of its frame.

    Args:
        image: The rgb image.
        range_image: 16-bit range image.
        encoding: Encoding of the range image; None: millimetres along the ray.

    Raises:
        DataError: A file is missing or malformed, the image is not equirectangular, or the encoding does not apply to
            a panorama.
    """
    panorama = None if range_image is not None else _in_manifest(image)
    if panorama is None:
        panorama = load_panorama(image.name, rgb=image, range_image=range_image, encoding=encoding)
    if panorama.rgb is None:
        raise DataError(f"{image} has no colour, expected an rgb image")
    return Shot(panorama.rgb, panorama)


def open_photograph(
    image: Path,
    hfov_rad: float,
    pitch_rad: float = 0.0,
    depth_image: Path | None = None,
    encoding: RangeEncoding | None = None,
) -> Shot:
    """Read a photograph as a partial panorama.

    Args:
        image: The photograph.
        hfov_rad: Horizontal field of view.
        pitch_rad: Elevation of the optical axis.
        depth_image: 16-bit depth image of the same size.
        encoding: Encoding of the depth image; None: z-depth in millimetres.

    Raises:
        DataError: A file is missing or malformed, the images differ in size, or the encoding does not apply to a
            photograph.
    """
    import cv2

    file = images.read_color_file(image)
    if declares_panorama(file, image):
        raise DataError(f"{image} is an equirectangular panorama by its XMP, expected a photograph: leave out --fov")
    rgb = file.pixels
    steps = None if depth_image is None else images.read_ids(depth_image)
    height, width = rgb.shape[:2]
    if steps is not None and steps.shape != (height, width):
        raise DataError(f"{depth_image} is {steps.shape[1]} x {steps.shape[0]}, expected {width} x {height}")
    camera = Pinhole.of_field_of_view(width, height, hfov_rad, pitch_rad)
    encoding = encoding or RangeEncoding(kind=RangeKind.Z)
    depth_m = None if steps is None else encoding.photograph_depth(steps, camera.rays())
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
    return Shot(rgb, replace(panorama, notes=(file.note,) if file.note else ()), camera, steps)


def _in_manifest(image: Path) -> Panorama | None:
    """Return the panorama of the frame whose rgb image this is; None where no manifest.json names it."""
    named = find_frame_image(image)
    if named is None:
        return None
    if named.key != "rgb":
        frame = named.frame
        raise DataError(f"{image} is the {named.key} image of {frame.id}, expected its rgb image: {frame.rgb}")
    return named.folder.load(named.frame)
