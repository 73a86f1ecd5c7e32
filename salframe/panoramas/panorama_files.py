"""Read the image files of a panorama, and place a picture on the sphere by its metadata."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas import images
from salframe.panoramas.blank_rows import blank_rows
from salframe.panoramas.fisheye import is_dual_fisheye
from salframe.panoramas.logo import num_logo_rows
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.photo_sphere import PhotoSphere, read_photo_sphere
from salframe.panoramas.range_encoding import RangeEncoding


def load_panorama(
    id: str,
    *,
    rgb: Path | None = None,
    range_image: Path | None = None,
    instances: Path | None = None,
    valid: Path | None = None,
    labels: Mapping[int, str] | None = None,
    rendered: bool = False,
    encoding: RangeEncoding | None = None,
    level: bool = True,
    logo: np.ndarray | None = None,
) -> Panorama:
    """Read the image files of a panorama.

    If the Photo Sphere XMP of the picture declares a crop, the picture is placed on the full sphere, and `valid` is
    false elsewhere. If the XMP declares a tilt and `level` is true, the picture is turned upright. The other images are
    changed in the same way.

    `valid` is also false in two kinds of rows without range: in black bands at the top and bottom of the picture
    (`blank_rows`), such as the patch that hides a tripod, and in the rows of the logo.

    Args:
        id: Id of the panorama.
        rgb: JPEG or PNG file.
        range_image: 16-bit file, 0 where the range is unknown.
        instances: 16-bit file with the id of the object at each pixel, 0 where there is none.
        valid: File that is black where the panorama has no image.
        labels: Label of each instance id.
        rendered: Whether labels and ranges come from a renderer, as in `Annotations`.
        encoding: Encoding of the values of the range image; None: millimetres along the ray.
        level: Whether to turn a tilted picture upright.
        logo: (R, 2H, 3) uint8, lowest rows of all pictures of the camera (`find_logo`); None: no logo.

    Raises:
        DataError: A file is missing or malformed, the images differ in size, the XMP contradicts them, or the picture
            shows two fisheye circles.
    """
    color = None if rgb is None else images.read_color_file(rgb)
    notes: list[str] = []
    sphere = None
    if rgb is not None and color is not None:
        sphere = read_photo_sphere(color, rgb)
        _check_panorama(rgb, color.pixels, is_crop=sphere is not None and sphere.is_crop)
        notes += [color.note] if color.note else []
    parts = {
        "rgb": None if color is None else color.pixels,
        "range": None if range_image is None else images.read_ids(range_image),
        "instances": None if instances is None else images.read_ids(instances),
        "valid": None if valid is None else images.read_mask(valid),
    }
    if sphere is not None and rgb is not None:
        paths = {"range": range_image, "instances": instances, "valid": valid}
        _check_sizes(rgb, parts, paths)
        parts = _place(parts, sphere)
    encoding = encoding or RangeEncoding()
    if (steps := parts["range"]) is not None:
        parts["range"] = encoding.panorama_range(steps)
    notes += _mask_rows(parts, logo)
    if sphere is not None and level:
        parts = {name: None if image is None else sphere.level(image) for name, image in parts.items()}
    if sphere is not None and (note := sphere.note(levelled=level)):
        notes.append(note)
    instance_id = parts["instances"]
    annotations = None if instance_id is None else Annotations(instance_id, labels or {}, rendered=rendered)
    return Panorama(
        id,
        parts["rgb"],
        parts["range"],
        parts["valid"],
        annotations,
        range_encoding=None if steps is None else encoding,
        notes=tuple(notes),
    )


def _check_panorama(path: Path, rgb: np.ndarray, *, is_crop: bool) -> None:
    """Check that a picture is a stitched panorama or a crop of one. Raises DataError."""
    height, width = rgb.shape[:2]
    if width != 2 * height and not is_crop:
        raise DataError(
            f"{path} is {width} x {height}, expected width = 2 x height (a panorama): for a "
            "photograph, pass its field of view or camera (--fov DEG or --camera FILE, in "
            "Python salframe.read_photograph)"
        )
    if width == 2 * height and is_dual_fisheye(rgb):
        raise DataError(
            f"{path} shows two fisheye circles side by side, expected an equirectangular panorama: "
            "stitch it first, with the program of the camera's maker"
        )


def _check_sizes(rgb: Path, parts: Mapping[str, np.ndarray | None], paths: Mapping[str, Path | None]) -> None:
    """Check that the images have the size of the picture. Raises DataError."""
    picture = parts["rgb"]
    for name, path in paths.items():
        image = parts[name]
        if image is not None and picture is not None and image.shape[:2] != picture.shape[:2]:
            size, expected = (" x ".join(map(str, part.shape[1::-1])) for part in (image, picture))
            raise DataError(
                f"{path} is {size}, expected {expected}, the size of {rgb}: the XMP metadata of {rgb} applies to both "
                "files"
            )


def _place(parts: Mapping[str, np.ndarray | None], sphere: PhotoSphere) -> dict[str, np.ndarray | None]:
    """Place the images of a crop on the full sphere, and mark the crop in `valid`."""
    placed = dict(parts)
    if sphere.is_crop:
        picture = parts["rgb"]
        if placed["valid"] is None and picture is not None:
            placed["valid"] = np.ones(picture.shape[:2], bool)
        placed = {name: None if image is None else sphere.place(image, 0) for name, image in placed.items()}
    return placed


def _mask_rows(parts: dict[str, np.ndarray | None], logo: np.ndarray | None) -> list[str]:
    """Set the mask `valid` to false in black bands and in the logo of the camera, and return a note for each.

    If there are no such rows, the mask stays unchanged, even if it is None. Images of different sizes, which `Panorama`
    refuses, change nothing.
    """
    rgb, range_m, valid = parts["rgb"], parts["range"], parts["valid"]
    if rgb is None or any(image is not None and image.shape[:2] != rgb.shape[:2] for image in parts.values()):
        return []
    visible = np.ones(rgb.shape[:2], bool) if valid is None else valid.copy()
    rows = np.flatnonzero(visible.any(axis=1))
    black = rows[blank_rows(rgb[rows], None if range_m is None else range_m[rows])]
    visible[black] = False
    hidden = len(rgb) - (0 if logo is None else num_logo_rows(rgb, logo))
    in_logo = visible[hidden:] if range_m is None else visible[hidden:] & np.isnan(range_m[hidden:])
    num_logo = int(in_logo.any(axis=1).sum())
    visible[hidden:] &= ~in_logo
    notes = []
    if len(black):
        notes.append(f"{len(black)} black rows at the top or bottom are masked")
    if num_logo:
        notes.append(f"{num_logo} rows at the bottom are masked: they show the same logo in all panoramas")
    if notes:
        parts["valid"] = visible
    return notes
