"""Stations: a station is a group of images with known poses that are stitched to one panorama."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import Field, PositiveFloat

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError
from salframe.panoramas import images as image_files
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.importer import PanoramaRecord, PlaceSource
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.pose_conventions import NAMES
from salframe.panoramas.range_encoding import RangeEncoding, RangeKind
from salframe.panoramas.stitching import PosedCamera, reading_agreement, stitch_color, stitch_range

MAX_ASPECT_ERROR = 0.02
"""Maximum relative difference between the aspect ratios of an image and of its calibration."""
MIN_OVERLAP, MIN_AGREEMENT = 0.02, 0.6
"""Share of the sphere that two depth images must both show to be compared, and minimum share of this overlap in which
they must agree."""
MAX_IMAGE_TILT_DEG, LEVEL_TILT_DEG = 60.0, 35.0
"""Maximum median tilt of the images; a larger tilt is an error. The error suggests another convention if the median
tilt under that convention is at most LEVEL_TILT_DEG."""
DISAGREES = (
    "the depth images of one place contradict each other: check the pose convention, the extrinsics, the times, the "
    "unit of the depth, and whether depth is measured along the ray or along the optical axis"
)
LEFT_OUT = "an image is left out: "
"""Start of the note on an image that cannot be read."""
_FULL_TURN_DEG = 360


class StationSettings(ComponentConfig):
    """Settings of importers that stitch several images to one panorama."""

    height: int = Field(
        512, ge=64, le=4096, description="height of a panorama in pixels; its width is twice the height"
    )
    max_move_m: PositiveFloat = Field(
        0.3,
        description="grouping by motion: maximum distance (m) between the camera position of an image and that of the "
        "first image of its panorama. A larger distance starts a new panorama",
    )
    min_view_deg: float = Field(
        180.0,
        ge=0,
        le=_FULL_TURN_DEG,
        description="grouping by motion: minimum horizontal field of view (degrees) that the images of a panorama "
        "cover together. Panoramas that cover less are left out",
    )
    min_step_deg: float = Field(
        10.0,
        ge=0,
        le=90,
        description="grouping by motion: minimum angle (degrees) between the optical axes of two images of a panorama. "
        "Images at smaller angles are left out; 0: all images are used",
    )


@dataclass(frozen=True, eq=False)
class PosedImage:
    """An image with a known pose. Its pixels are read when they are needed.

    Attributes:
        name: Name for error messages.
        camera: Intrinsics and pose.
        read_color: Returns (h, w, 3) uint8 RGB. Raises DataError.
        read_depth: Returns (h', w') float32 depth along the optical axis in metres, NaN where unknown. Raises
            DataError. None for an image without depth.
        t_s: Time in seconds; None if it is unknown.
        station: Name of its station; None if it is unknown.
        places: Name of the place, by the source of the name.
        sources: Files that the image is read from.
        depth_camera: Intrinsics and pose of the depth image; None: equal to `camera`.
    """

    name: str
    camera: PosedCamera
    read_color: Callable[[], np.ndarray]
    read_depth: Callable[[], np.ndarray] | None = None
    t_s: float | None = None
    station: str | None = None
    places: Mapping[PlaceSource, str] = field(default_factory=dict)
    sources: tuple[Path, ...] = ()
    depth_camera: PosedCamera | None = None

    @property
    def forward(self) -> np.ndarray:
        """Direction of the optical axis in the world, (3,)."""
        return self.camera.T_world_camera[:3, 2]

    @property
    def azimuth_deg(self) -> float:
        """Azimuth of the optical axis in the world."""
        return float(np.degrees(np.arctan2(self.forward[1], self.forward[0])))


def z_depth(range_m: np.ndarray, lens: Camera) -> np.ndarray:
    """Convert ranges (h, w) along the rays of a camera to depth (h, w) float32 along its optical axis."""
    height, width = range_m.shape
    return (range_m * (lens.scaled(width, height).rays() @ lens.rotation[:, 2])).astype(np.float32)


def station_record(
    id: str,
    images: Sequence[PosedImage],
    height: int,
    sources: Iterable[Path] = (),
    T_world_pano: np.ndarray | None = None,
    check: Callable[[Panorama], str | None] | None = None,
    *,
    is_posed: bool = True,
) -> PanoramaRecord:
    """Return the record of a panorama. The images are stitched when the panorama is loaded.

    Args:
        id: Id of the record.
        images: The images. The panorama has range if all of them have depth.
        height: Height of the panorama in pixels.
        sources: Further files that the panorama depends on, such as the list of poses.
        T_world_pano: Pose of the panorama; None: upright, at the mean position of the cameras, with the heading of the
            most level image.
        check: Function that returns a warning about the panorama, or None. By default, the agreement of overlapping
            depth images is checked.
        is_posed: Whether the poses of the cameras are poses in the world. If not, the record has no pose.
    """
    pose = _upright_pose(images) if T_world_pano is None else T_world_pano
    has_depth = all(image.read_depth is not None for image in images)
    places: dict[PlaceSource, str] = {}
    for source in PlaceSource:
        if names := [image.places[source] for image in images if source in image.places]:
            places[source] = Counter(names).most_common(1)[0][0]
    return PanoramaRecord(
        id,
        partial(_stitch, id, tuple(images), pose, height, has_depth, check),
        parts=frozenset({"rgb", "valid", *(("range",) if has_depth else ())}),
        T_world_pano=pose if is_posed else None,
        places=places,
        t_s=images[0].t_s,
        sources=(*sources, *(path for image in images for path in image.sources)),
    )


def read_depth(path: Path, encoding: RangeEncoding, lens: Camera) -> np.ndarray:
    """Read a depth image, (h, w) float32 depth along the optical axis in metres, NaN where unknown.

    Args:
        path: A 16-bit grey image.
        encoding: Encoding of the values, of the kind Z or RAY.
        lens: The camera of the image. Its resolution may differ from the resolution of the image.

    Raises:
        DataError: The file is not a 16-bit grey image.
    """
    depth_m = encoding.photograph_depth(image_files.read_ids(path))
    return z_depth(depth_m, lens) if encoding.kind == RangeKind.RAY else depth_m


def group_by_station(images: Sequence[PosedImage]) -> dict[str, list[PosedImage]]:
    """Return the images of each station, by the name of the station. Raises DataError if an image has no station."""
    groups: dict[str, list[PosedImage]] = {}
    for image in images:
        if image.station is None:
            raise DataError(
                f"the entry of the image {image.name} has no key `station`, expected the key for every image: add it, "
                "or set group_by=motion"
            )
        groups.setdefault(image.station, []).append(image)
    return groups


def group_by_time(images: Sequence[PosedImage], max_gap_s: float) -> dict[str, list[PosedImage]]:
    """Split images into groups at gaps of more than `max_gap_s` seconds. Raises DataError if an image has no time."""
    if without := [image.name for image in images if image.t_s is None]:
        raise DataError(
            f"the image {without[0]} has no key `time`, expected the key for every image: add it, or set "
            "group_by=motion"
        )
    groups: list[list[PosedImage]] = []
    for image in sorted(images, key=lambda image: image.t_s or 0.0):
        if not groups or (image.t_s or 0.0) - (groups[-1][-1].t_s or 0.0) > max_gap_s:
            groups.append([])
        groups[-1].append(image)
    return _numbered(groups)


def group_by_motion(
    images: Sequence[PosedImage], config: StationSettings
) -> tuple[dict[str, list[PosedImage]], str | None]:
    """Split a recording into stations: consecutive images in which the camera turned enough and moved little.

    A station ends when the camera is more than `max_move_m` from the first image of the station.

    Args:
        images: The images in the order of the recording.
        config: The settings.

    Returns:
        The images of each station, and a note about the images that are in no station; None if each image is
        in a station.

    Raises:
        DataError: No station shows at least `min_view_deg`.
    """
    runs: list[list[PosedImage]] = []
    views: list[np.ndarray] = []
    for image in images:
        position_m = image.camera.T_world_camera[:3, 3]
        start_m = runs[-1][0].camera.T_world_camera[:3, 3] if runs else np.full(3, np.inf)
        if not np.linalg.norm(position_m - start_m) <= config.max_move_m:
            runs.append([])
            views.append(np.zeros(_FULL_TURN_DEG, bool))
        runs[-1].append(image)
        views[-1] |= _view(image)
    groups = [run for run, view in zip(runs, views, strict=True) if view.sum() >= config.min_view_deg]
    if not groups:
        raise DataError(
            f"the images taken within {config.max_move_m:g} m of one point cover at most "
            f"{max(int(view.sum()) for view in views)} deg of azimuth, expected at least {config.min_view_deg:g} deg: "
            "turn the camera at each place, decrease min_view_deg, or increase max_move_m"
        )
    num_unused = len(images) - sum(map(len, groups))
    if not num_unused:
        return _numbered(groups), None
    return _numbered(groups), (
        f"{num_unused} of {len(images)} images are left out: within {config.max_move_m:g} m (max_move_m), the camera "
        f"turned less than {config.min_view_deg:g} deg (min_view_deg)"
    )


def thinned(images: Sequence[PosedImage], min_step_deg: float) -> list[PosedImage]:
    """Select images whose optical axes are at least `min_step_deg` apart. Of similar directions, the first is used."""
    taken: list[PosedImage] = []
    limit = np.cos(np.radians(min_step_deg))
    for image in images:
        if min_step_deg == 0 or all(image.forward @ other.forward <= limit for other in taken):
            taken.append(image)
    return taken


def check_upright(poses: Sequence[np.ndarray], others: Mapping[str, Sequence[np.ndarray]]) -> None:
    """Check that most images are upright by their poses.

    Args:
        poses: (4, 4) poses of cameras; x right, y down, z forward.
        others: The poses under other settings. The keys are the settings, written as "key=value".

    Raises:
        DataError: The images are not upright. The message names the settings under which they would be upright.
    """
    tilt_deg = _median_tilt_deg(poses)
    if tilt_deg <= MAX_IMAGE_TILT_DEG:
        return
    level = [setting for setting, changed in others.items() if _median_tilt_deg(changed) <= LEVEL_TILT_DEG]
    cause = (
        f"try --set {' or --set '.join(level)}"
        if level
        else "check the axes of the cameras and of the world, and whether the poses map the camera to the world"
    )
    raise DataError(
        f"the images are tilted by {tilt_deg:.0f} deg according to their poses (median of {len(poses)} images), "
        f"expected at most {MAX_IMAGE_TILT_DEG:g} deg: {cause}"
    )


def other_conventions(convention: str) -> list[str]:
    """Return the pose conventions that a user may have meant instead of `convention`."""
    return [name for name in NAMES if name not in (convention, "compass", "image-plan")]


def _median_tilt_deg(poses: Sequence[np.ndarray]) -> float:
    cosines = [-pose[2, 1] for pose in poses]
    return float(np.degrees(np.median(np.arccos(np.clip(cosines, -1, 1)))))


def _numbered(groups: Sequence[list[PosedImage]]) -> dict[str, list[PosedImage]]:
    return {f"station-{number:03d}": group for number, group in enumerate(groups, 1)}


def _view(image: PosedImage) -> np.ndarray:
    """Return the azimuths that an image shows, (360,) bool. A camera that looks up or down shows none."""
    degrees = np.arange(_FULL_TURN_DEG)
    if abs(image.forward[2]) > np.sin(np.radians(60)):
        return np.zeros(_FULL_TURN_DEG, bool)
    lens = image.camera.camera
    half_deg = np.degrees(np.arctan(lens.width / 2 / lens.fx))
    return np.abs((degrees - image.azimuth_deg + 180) % 360 - 180) <= half_deg  # type: ignore[no-any-return]


def _upright_pose(images: Sequence[PosedImage]) -> np.ndarray:
    """Return T_world_pano (4, 4): upright, at the mean position of the cameras, with the heading of the most level
    image."""
    level = min(images, key=lambda image: round(abs(float(image.forward[2])), 1))
    x_m, y_m, z_m = np.mean([image.camera.T_world_camera[:3, 3] for image in images], axis=0)
    return pose_2d(x_m, y_m, np.radians(level.azimuth_deg), z_m)


def _stitch(
    id: str,
    images: Sequence[PosedImage],
    T_world_pano: np.ndarray,
    height: int,
    has_depth: bool,
    check: Callable[[Panorama], str | None] | None,
) -> Panorama:
    """Stitch images to a panorama, without images that cannot be read. Raises DataError if no image can be read."""
    pictures, depths_m, cameras, depth_cameras, notes = [], [], [], [], []
    for image in images:
        try:
            rgb = image.read_color()
            depth_m = image.read_depth() if has_depth and image.read_depth is not None else None
            camera = _fitted(image.name, image.camera, rgb)
            depth_camera = None if depth_m is None else _fitted(image.name, image.depth_camera or image.camera, depth_m)
        except DataError as error:
            notes.append(f"{LEFT_OUT}{error}")
            continue
        pictures.append(rgb)
        cameras.append(camera)
        if depth_m is not None and depth_camera is not None:
            depths_m.append(depth_m)
            depth_cameras.append(depth_camera)
    if not pictures:
        first = notes[0].removeprefix(LEFT_OUT)
        raise DataError(f"none of the {len(images)} images of the panorama {id} can be read; the first error: {first}")
    range_m = np.full((height, 2 * height), np.nan, np.float32)
    if has_depth:
        range_m = stitch_range(depths_m, depth_cameras, T_world_pano, height)
    rgb, valid = stitch_color(pictures, cameras, T_world_pano, range_m)
    range_m[~valid] = np.nan
    panorama = Panorama(id, rgb, range_m if has_depth else None, valid)
    if check is not None:
        note = check(panorama)
    else:
        overlap, agreement = reading_agreement(depths_m, depth_cameras, T_world_pano)
        note = DISAGREES if overlap >= MIN_OVERLAP and agreement < MIN_AGREEMENT else None
    notes += [note] if note else []
    return Panorama(id, panorama.rgb, panorama.range_m, panorama.valid, notes=tuple(notes))


def _fitted(name: str, camera: PosedCamera, pixels: np.ndarray) -> PosedCamera:
    """Return the camera, scaled to the size of the image. Raises DataError if the aspect ratios differ."""
    lens = camera.camera
    height, width = pixels.shape[:2]
    if (width, height) == (lens.width, lens.height):
        return camera
    if abs(width * lens.height / (height * lens.width) - 1) > MAX_ASPECT_ERROR:
        raise DataError(
            f"{name} is {width} x {height}, expected {lens.width} x {lens.height}, the size of its calibration, or "
            "the same aspect ratio"
        )
    return camera.scaled(width, height)
