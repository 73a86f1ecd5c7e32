"""Read image files as a panorama: equirectangular images, an image of a dataset folder, or a photograph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_json
from salframe.panoramas import images
from salframe.panoramas.camera import Camera
from salframe.panoramas.image_lookup import find_frame_image
from salframe.panoramas.panorama import Panorama, labels_by_id
from salframe.panoramas.panorama_files import load_panorama
from salframe.panoramas.photo_sphere import declares_panorama
from salframe.panoramas.photograph import photograph_panorama
from salframe.panoramas.range_encoding import MILLIMETRE, RangeEncoding, RangeKind
from salframe.panoramas.range_missing import missing_line, missing_values


@dataclass(frozen=True, eq=False)
class Shot:
    """An image and its panorama.

    Attributes:
        rgb: (H, W, 3) uint8, the original image.
        panorama: The image as a panorama, which components use.
        camera: The camera of a photograph; None for a panorama.
        depth_steps: (h, w) int32, values of the depth image of a photograph; None if there is none.
    """

    rgb: np.ndarray
    panorama: Panorama
    camera: Camera | None = None
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
) -> Panorama:
    """Read a panorama from image files of equal size, with width = 2 x height. At least one image is required.

    The id of the panorama is the name of its first file.

    Args:
        rgb: JPEG or PNG file.
        range_image: 16-bit file, 0 where the range is unknown.
        instances: 16-bit file with the id of the object at each pixel, 0 where there is none.
        labels: JSON file with the label of each id, such as {"1": "bed"}.
        range_unit_m: Metres per step of the range image.
        range_missing: Values of the range image that mean an unknown range, besides 0.
        range_kind: "ray": range along the ray; "cube": depth along the axis of the cube face that the ray passes
            through, as in panoramas stitched from cube maps.

    Raises:
        DataError: A file is missing or malformed, an argument is not the path of a file, or the encoding of the range
            is invalid.
    """
    _check_files(rgb=rgb, range_image=range_image, instances=instances, labels=labels)
    files = [Path(path) for path in (rgb, range_image, instances) if path is not None]
    if not files:
        raise DataError("received no image file, expected an rgb, range or instance image")
    return load_panorama(
        files[0].name,
        rgb=None if rgb is None else Path(rgb),
        range_image=None if range_image is None else Path(range_image),
        instances=None if instances is None else Path(instances),
        labels=None if labels is None else labels_by_id(read_json(Path(labels)), str(labels)),
        encoding=RangeEncoding(range_unit_m, tuple(range_missing), range_kind),
    )


def open_panorama(image: Path, range_image: Path | None = None, encoding: RangeEncoding | None = None) -> Shot:
    """Read an equirectangular rgb image as a panorama.

    If there is no `range_image` and the image belongs to a dataset folder, the panorama has all parts of its frame.

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


def read_photograph(
    rgb: str | Path,
    depth_image: str | Path | None = None,
    instances: str | Path | None = None,
    labels: str | Path | None = None,
    *,
    camera: Camera | None = None,
    fov_deg: float | None = None,
    range_unit_m: float = MILLIMETRE,
    range_missing: Sequence[int] = (),
    range_kind: RangeKind | str = RangeKind.Z,
) -> Panorama:
    """Read a photograph as a partial panorama, without distortion and with the axes of the camera's base.

    The id of the panorama is the name of the photograph.

    Args:
        rgb: JPEG or PNG file.
        depth_image: 16-bit file of the same size, 0 where the depth is unknown.
        instances: 16-bit file of the same size with the id of the object at each pixel, 0 where there is none.
        labels: JSON file with the label of each id, such as {"1": "bed"}.
        camera: The camera; `salframe.read_camera` reads it from a file.
        fov_deg: Horizontal field of view of a level camera without distortion, in degrees, instead of `camera`.
        range_unit_m: Metres per step of the depth image.
        range_missing: Values of the depth image that mean an unknown depth, besides 0.
        range_kind: "z": depth along the optical axis; "ray": range along the ray.

    Raises:
        DataError: A file is missing or malformed, the images differ in size from each other or from the camera, or the
            encoding of the depth is invalid.
    """
    encoding = RangeEncoding(range_unit_m, tuple(range_missing), range_kind)
    return open_photograph(
        rgb, depth_image, instances, labels, camera=camera, fov_deg=fov_deg, encoding=encoding
    ).panorama


def open_photograph(
    rgb: str | Path,
    depth_image: str | Path | None = None,
    instances: str | Path | None = None,
    labels: str | Path | None = None,
    *,
    camera: Camera | None = None,
    fov_deg: float | None = None,
    elevation_deg: float = 0.0,
    encoding: RangeEncoding | None = None,
) -> Shot:
    """Read a photograph with its panorama. For the other arguments and the errors, see `read_photograph`.

    Args:
        elevation_deg: Elevation of the optical axis with `fov_deg`, in degrees, positive upwards.
        encoding: Encoding of the depth image; None: z-depth in millimetres.
    """
    if camera is not None and fov_deg is not None:
        raise DataError(
            f"received both camera and fov_deg = {fov_deg:g} for the photograph {rgb}, expected only one of them"
        )
    _check_files(rgb=rgb, depth_image=depth_image, instances=instances, labels=labels)
    image = Path(rgb)
    file = images.read_color_file(image)
    if declares_panorama(file, image):
        raise DataError(
            f"{image} is an equirectangular panorama according to its XMP metadata, expected a photograph: leave out "
            "--fov and --camera"
        )
    if (named := find_frame_image(image)) is not None:
        raise DataError(
            f"{image} is the panorama of the frame {named.frame.id} of {named.folder.root}, expected "
            "a photograph: leave out --fov and --camera"
        )
    height, width = file.pixels.shape[:2]
    if camera is None:
        if fov_deg is None:
            raise DataError(f"received neither camera nor fov_deg for the photograph {image}, expected one of them")
        camera = Camera.of_field_of_view(width, height, fov_deg, elevation_deg)
    else:
        if (file.width_px, file.height_px) != (camera.width, camera.height):
            raise DataError(
                f"{image} is {file.width_px} x {file.height_px}, expected {camera.width} x {camera.height}, the image "
                f"size of the camera: use images of this size, or calibrate the camera for {file.width_px} x "
                f"{file.height_px}"
            )
        camera = camera if width == camera.width else camera.scaled(width, height)  # large images are reduced
    steps, instance_id = (
        None if path is None else _read_ids(Path(path), file.pixels) for path in (depth_image, instances)
    )
    encoding = encoding or RangeEncoding(kind=RangeKind.Z)
    panorama = photograph_panorama(
        camera,
        image.name,
        file.pixels,
        None if steps is None else encoding.photograph_depth(steps),
        kind=encoding.kind,
        instance_id=instance_id,
        labels=None if labels is None else labels_by_id(read_json(Path(labels)), str(labels)),
    )
    return Shot(file.pixels, replace(panorama, notes=(file.note,) if file.note else ()), camera, steps)


def _read_ids(path: Path, rgb: np.ndarray) -> np.ndarray:
    """Read a 16-bit image file with the size of a photograph; return it as (h, w) int32. Raises DataError."""
    ids = images.read_ids(path)
    if ids.shape != rgb.shape[:2]:
        size, expected = (" x ".join(map(str, image.shape[1::-1])) for image in (ids, rgb))
        raise DataError(f"{path} is {size}, expected {expected}, the size of its photograph")
    return ids


def missing_depth_note(shot: Shot, encoding: RangeEncoding) -> str | None:
    """Return a one-line warning if a value of a photograph's depth image seems to mean an unknown depth; else None."""
    if shot.depth_steps is None:
        return None
    shares = missing_values(np.where(np.isin(shot.depth_steps, encoding.missing), 0, shot.depth_steps))
    return missing_line(shares, f"depth image of {shot.panorama.id}", encoding) if shares else None


def _check_files(**files: object) -> None:
    """Check that arguments are paths of files, and that an instance image comes with its labels. Raises DataError."""
    for name, file in files.items():
        if file is not None and not isinstance(file, str | Path):
            raise DataError(
                f"the argument {name} has the type {type(file).__name__}, expected the path of a file: for arrays, use "
                "salframe.Panorama"
            )
    if (files["instances"] is None) != (files["labels"] is None):
        no_image = files["instances"] is None
        received = "labels without an instance image" if no_image else "an instance image without labels"
        raise DataError(f"received {received}, expected both instances and labels, or neither")


def _in_manifest(image: Path) -> Panorama | None:
    """Return the panorama of the frame whose rgb image is at a path; None if no manifest.json names the image."""
    named = find_frame_image(image)
    if named is None:
        return None
    if named.key != "rgb":
        frame = named.frame
        raise DataError(f"{image} is the {named.key} image of {frame.id}, expected its rgb image: {frame.rgb}")
    return named.folder.load(named.frame)
