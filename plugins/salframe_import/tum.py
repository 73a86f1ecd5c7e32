"""`tum`: recordings in the layout of the TUM RGB-D benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, cast

import numpy as np
from pydantic import Field, PositiveFloat

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_text
from salframe.panoramas import images
from salframe.panoramas.camera import LEVEL, Camera
from salframe.panoramas.camera_file import read_camera
from salframe.panoramas.importer import Importer, Recording
from salframe.panoramas.pose_conventions import PoseConvention, convert_pose
from salframe.panoramas.range_encoding import RangeEncoding, RangeKind
from salframe.panoramas.stitching import PosedCamera
from salframe_import.pose_table import quaternion_matrix
from salframe_import.stations import (
    PosedImage,
    StationSettings,
    check_upright,
    group_by_motion,
    other_conventions,
    read_depth,
    station_record,
    thinned,
)

COLOR, DEPTH, POSES = "rgb.txt", "depth.txt", "groundtruth.txt"
CAMERAS = {
    "freiburg1": (517.306408, 516.469215, 318.64304, 255.313989, 0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
    "freiburg2": (520.90862, 521.007327, 325.141442, 249.701764, 0.231222, -0.784899, -0.003257, -0.000105, 0.917205),
    "freiburg3": (535.4, 539.2, 320.1, 247.6, 0.0, 0.0, 0.0, 0.0, 0.0),
    "default": (525.0, 525.0, 319.5, 239.5, 0.0, 0.0, 0.0, 0.0, 0.0),
}
"""fx, fy, cx, cy, k1, k2, p1, p2 and k3 of the cameras of the benchmark at 640 x 480 pixels, as published by the
benchmark. "default" is the factory calibration of the sensor."""


@dataclass(frozen=True, eq=False)
class _Stamped:
    """Rows of a list with time stamps.

    Attributes:
        t_s: (N,) float64 times in seconds, ascending.
        words: The words of each row after the time.
    """

    t_s: np.ndarray
    words: tuple[tuple[str, ...], ...]


class TumImporter(Importer):
    """Folders in the format of the TUM RGB-D benchmark: rgb.txt, groundtruth.txt, and optionally depth.txt.

    The images that the camera took while it turned at one place are stitched to one panorama. Each colour image is
    combined with the depth image and the pose of the nearest time. Without depth.txt, panoramas have no range.
    """

    name = "tum"
    version = "1"

    class Config(StationSettings):
        camera: str = Field(
            "auto",
            min_length=1,
            description="intrinsics of the camera: freiburg1, freiburg2 or freiburg3 (cameras of the benchmark), "
            "default (focal length 525 pixels at 640 x 480), or the path of a camera file (see `salframe docs views`); "
            "auto: the camera in "
            "the name of the folder, otherwise default",
        )
        max_time_s: PositiveFloat = Field(
            0.02,
            description="maximum time (s) between a colour image and its depth image, and between a colour image and "
            "its pose",
        )
        pose_offset_s: float = Field(
            0.0,
            description="time (s) that is added to the timestamps of the poses. If the timestamps of the images are "
            "late by a known delay, set this delay",
        )
        quaternion: Literal["xyzw", "wxyz"] = Field(
            "xyzw",
            description="order of the quaternion components in groundtruth.txt. xyzw: the scalar part is last; wxyz: "
            "the scalar part is first",
        )
        pose_convention: PoseConvention = Field(
            "opencv",
            description="convention of the poses in groundtruth.txt: the axes of world and camera, and the direction "
            "of the transformation; `salframe docs folder-format` explains each value. The benchmark uses "
            "opencv",
        )
        depth_unit_m: PositiveFloat = Field(
            1 / 5000, description="length (m) of one unit of a depth image (0.0002: the value 5000 means 1 m)"
        )

    def read(self, source: Path) -> Recording:
        colors, poses = _read_list(source / COLOR, 1), _read_list(source / POSES, 7)
        depths = _read_list(source / DEPTH, 1) if (source / DEPTH).exists() else None
        raw = self._raw_poses(source / POSES, poses)
        nearest_pose = _nearest(poses.t_s + self.config.pose_offset_s, colors.t_s)
        nearest_depth = None if depths is None else _nearest(depths.t_s, colors.t_s)
        gap_s = nearest_pose[1] if nearest_depth is None else np.maximum(nearest_pose[1], nearest_depth[1])
        is_matched = gap_s <= self.config.max_time_s
        if not is_matched.any():
            raise DataError(
                f"no image of {source / COLOR} has a pose{'' if depths is None else ' and a depth image'} within "
                f"{self.config.max_time_s:g} s of its time (the nearest is {gap_s.min():.3g} s away): correct "
                "pose_offset_s, or increase max_time_s"
            )
        lens, note = self._camera(source)
        encoding = RangeEncoding(self.config.depth_unit_m, kind=RangeKind.Z)
        T_world_camera = self._camera_poses(raw, self.config.pose_convention, self.config.quaternion)
        posed = []
        for index in np.flatnonzero(is_matched).tolist():
            picture = source / colors.words[index][0]
            depth = None
            if depths is not None and nearest_depth is not None:
                depth = source / depths.words[nearest_depth[0][index]][0]
            posed.append(
                PosedImage(
                    str(picture),
                    PosedCamera(lens, T_world_camera[nearest_pose[0][index]]),
                    partial(images.read_color, picture),
                    None if depth is None else partial(read_depth, depth, encoding, lens),
                    float(colors.t_s[index]),
                    sources=(picture,) if depth is None else (picture, depth),
                )
            )
        self._check_axes(raw, nearest_pose[0][is_matched])
        groups, unused = group_by_motion(posed, self.config)
        records = (
            station_record(id, thinned(group, self.config.min_step_deg), self.config.height, (source / POSES,))
            for id, group in groups.items()
        )
        num_unmatched = len(is_matched) - int(is_matched.sum())
        unmatched = (
            f"{num_unmatched} of {len(is_matched)} colour images are left out, because they have no pose or depth "
            f"within {self.config.max_time_s:g} s"
        )
        notes = (unmatched if num_unmatched else None, unused, note)
        return Recording(tuple(records), notes=tuple(text for text in notes if text))

    def _raw_poses(self, path: Path, poses: _Stamped) -> np.ndarray:
        """Return position and quaternion of each pose, (N, 7) float64. Raises DataError if a row is invalid."""
        try:
            numbers = np.array([row[:7] for row in poses.words], np.float64)
        except ValueError as error:
            raise DataError(
                f"{path} has a row without the numbers tx ty tz qx qy qz qw after the time: {error}"
            ) from None
        for row in numbers:
            quaternion_matrix(row[3:], f"{path}: the quaternion {row[3:].tolist()}")
        return numbers

    def _camera_poses(self, raw: np.ndarray, convention: PoseConvention, order: str) -> list[np.ndarray]:
        """Return T_world_camera (4, 4) of rows tx ty tz and a quaternion."""
        from scipy.spatial.transform import Rotation

        xyzw = raw[:, 3:] if order == "xyzw" else raw[:, [4, 5, 6, 3]]
        poses = np.tile(np.eye(4), (len(raw), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = Rotation.from_quat(xyzw).as_matrix(), raw[:, :3]
        return [convert_pose(pose, convention) @ LEVEL for pose in poses]

    def _check_axes(self, raw: np.ndarray, indices: np.ndarray) -> None:
        sample = raw[indices[:: 1 + len(indices) // 200]]
        convention, order = self.config.pose_convention, self.config.quaternion
        other = "wxyz" if order == "xyzw" else "xyzw"
        others = {f"quaternion={other}": self._camera_poses(sample, convention, other)}
        for name in other_conventions(convention):
            others[f"pose_convention={name}"] = self._camera_poses(sample, cast(PoseConvention, name), order)
        check_upright(self._camera_poses(sample, convention, order), others)

    def _camera(self, source: Path) -> tuple[Camera, str | None]:
        """Return the camera, and a note if its calibration is assumed."""
        name, note = self.config.camera, None
        if name == "auto":
            name = next((camera for camera in CAMERAS if camera in source.resolve().name), "default")
            if name == "default":
                note = (
                    "the camera is assumed to have a focal length of 525 pixels at 640 x 480: set camera to freiburg1, "
                    "freiburg2, freiburg3 or a file CAMERA.json"
                )
        if name not in CAMERAS:
            return read_camera(name), note
        fx, fy, cx, cy, *distortion = CAMERAS[name]
        model = "plumb_bob" if any(distortion) else "none"
        return Camera(640, 480, fx, fy, cx, cy, model, tuple(distortion) if any(distortion) else ()), note


def _read_list(path: Path, num_words: int) -> _Stamped:
    """Read a list with a time stamp and `num_words` words in each row; lines that begin with # are comments.

    Raises:
        DataError: The file cannot be read, has no row, or a row is malformed.
    """
    rows = []
    for number, line in enumerate(read_text(path, "a list of the TUM RGB-D benchmark").splitlines(), 1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            rows.append((float(words[0]), tuple(words[1:])))
        except ValueError:
            rows.append((np.nan, ()))
        if not np.isfinite(rows[-1][0]) or len(words) < 1 + num_words:
            expected = "a file name" if num_words == 1 else "tx ty tz qx qy qz qw"
            raise DataError(
                f"{path}, line {number} is {line.strip()[:60]!r}, expected a time in seconds and {expected}"
            )
    if not rows:
        raise DataError(f"{path} has no row, expected one for each image or pose")
    rows.sort(key=lambda row: row[0])
    return _Stamped(np.array([row[0] for row in rows]), tuple(row[1] for row in rows))


def _nearest(times_s: np.ndarray, target_times_s: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each target time the index of the nearest of the ascending times, and their difference in seconds."""
    targets_s = np.asarray(target_times_s)
    after = np.clip(np.searchsorted(times_s, targets_s), 1, max(len(times_s) - 1, 1))
    after = np.minimum(after, len(times_s) - 1)
    before = np.maximum(after - 1, 0)
    index = np.where(np.abs(times_s[before] - targets_s) <= np.abs(times_s[after] - targets_s), before, after)
    return index, np.abs(times_s[index] - targets_s)
