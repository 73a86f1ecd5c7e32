"""Reader of the Matterport3D release: cameras, pictures and depth of each viewpoint, stitched to a panorama.

The format is described in data_organization.md of the release. A viewpoint has 18 pictures, taken by three cameras (up,
level, down) at six orientations of the tripod.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_text
from salframe.panoramas import images
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import is_rigid, pose_2d
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.stitching import PosedCamera, stitch_color, stitch_range

WIDTH_PX, HEIGHT_PX = 1280, 1024
_DEPTH_PER_METRE = 4000
"""Units of a depth image per metre."""
_NO_SHEAR = np.array([[0, 1, 0], [1, 0, 0], [1, 1, 0]], bool)
"""Elements of the intrinsics matrix that must be 0."""
_RIGID_TOLERANCE = 1e-3
"""Maximum deviation of a camera pose from a rigid motion."""
_SKYBOX_STOP = "i1_5"
"""Part of the name of the level picture that looks in the direction of skybox face 1. Faces 2, 3 and 4 follow
clockwise. Face 0 looks up, and face 5 looks down."""

Color = Literal["skybox", "pictures"]


@dataclass(frozen=True)
class DepthShot:
    """File names of a depth image and of the colour picture with the same camera, and this camera."""

    depth: str
    picture: str
    camera: PosedCamera


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A position of the tripod.

    Attributes:
        name: Name of the viewpoint.
        folder: Folder of the building.
        shots: Images of the viewpoint and their cameras.
        T_world_pano: Pose (4, 4) of the panorama: upright, at the mean position of the cameras, with the
            heading of the first image of the level camera.
    """

    name: str
    folder: Path
    shots: tuple[DepthShot, ...]
    T_world_pano: np.ndarray

    def files(self, color: Color) -> list[Path]:
        """Return the paths of all files that the panorama is stitched from."""
        depth = [self.folder / "undistorted_depth_images" / shot.depth for shot in self.shots]
        return depth + (self._faces if color == "skybox" else self._pictures)

    @property
    def _pictures(self) -> list[Path]:
        return [self.folder / "undistorted_color_images" / shot.picture for shot in self.shots]

    @property
    def _faces(self) -> list[Path]:
        return [self.folder / "matterport_skybox_images" / f"{self.name}_skybox{face}_sami.jpg" for face in range(6)]

    def stitch(self, height: int, color: Color) -> Panorama:
        """Stitch the panorama at `T_world_pano`.

        Args:
            height: Height of the panorama in pixels.
            color: Images that give the colour: "skybox" (six cube faces) or "pictures" (the colour picture of each
                depth image).

        Raises:
            DataError: An image is missing, damaged or of the wrong size.
        """
        for path in self.files(color):
            if not path.exists():
                raise DataError(
                    f"{path} is missing: unpack {path.parent.name}.zip of the building from the Matterport3D release"
                )
        cameras = [shot.camera for shot in self.shots]
        depth_m = [_read_depth(self.folder / "undistorted_depth_images" / shot.depth) for shot in self.shots]
        range_m = stitch_range(depth_m, cameras, self.T_world_pano, height)
        if color == "skybox":
            pictures = [images.read_color(path) for path in self._faces]
            cameras = self._skybox([picture.shape[1] for picture in pictures])
        else:
            pictures = [_check_size(path, images.read_color(path)) for path in self._pictures]
        rgb, valid = stitch_color(pictures, cameras, self.T_world_pano, range_m)
        return Panorama(self.name, rgb, range_m, valid)

    def _skybox(self, widths_px: Sequence[int]) -> list[PosedCamera]:
        """Return the cameras of the six skybox faces, at the mean position of the viewpoint's cameras.

        Args:
            widths_px: Width of each face in pixels.
        """
        first = next((shot.camera for shot in self.shots if _SKYBOX_STOP in shot.picture), None)
        if first is None:
            raise DataError(
                f"the camera file of building {self.folder.name} has no entry for the picture {_SKYBOX_STOP} of "
                f"viewpoint {self.name}. The entry defines the direction of the skybox: add it, or set "
                "data.color=pictures"
            )
        right, down, ahead = first.T_world_camera[:3, :3].T
        around = [(right, down, ahead), (-ahead, down, right), (-right, down, -ahead), (ahead, down, -right)]
        faces = [(right, ahead, -down), *around, (right, -ahead, down)]
        cameras = []
        for axes, width in zip(faces, widths_px, strict=True):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = np.stack(axes, 1), self.T_world_pano[:3, 3]
            cameras.append(PosedCamera(Camera.of_field_of_view(width, width, 90.0), pose))
        return cameras


def find_buildings(root: Path) -> dict[str, Path]:
    """Return the folder of each building with a camera file, by the id of the building.

    Raises:
        DataError: No building has a camera file.
    """
    for scans in (root / "v1" / "scans", root / "scans", root):
        buildings = {
            path.parent.parent.name: path.parent.parent
            for path in sorted(scans.glob("*/undistorted_camera_parameters/*.conf"))
        }
        if buildings:
            return buildings
    received = "a folder without camera files" if root.is_dir() else "not a folder"
    raise DataError(
        f"{root} is {received}, expected a folder with v1/scans/<scan>/undistorted_camera_parameters/<scan>.conf "
        "of the Matterport3D release"
    )


def cameras_path(folder: Path) -> Path:
    return folder / "undistorted_camera_parameters" / f"{folder.name}.conf"


def house_path(folder: Path) -> Path:
    return folder / "house_segmentations" / f"{folder.name}.house"


def read_viewpoints(folder: Path) -> dict[str, Viewpoint]:
    """Read the viewpoints of a building by name, in the order of its camera file.

    In the file, camera axes are y up and -z forward, and principal points are measured from the lower left pixel.

    Raises:
        DataError: The camera file is missing or malformed.
    """
    path = cameras_path(folder)
    expected = "a camera file of the Matterport3D release (undistorted_camera_parameters)"
    lines = [line.split() for line in read_text(path, expected).splitlines()]
    shots: dict[str, list[DepthShot]] = {}
    try:
        for words in lines:
            if words[:1] == ["intrinsics_matrix"]:
                (fx, _, cx), (_, fy, cy), _ = intrinsics = np.array(words[1:], float).reshape(3, 3)
                if not np.array_equal(intrinsics == 0, _NO_SHEAR) or min(fx, fy, intrinsics[2, 2]) <= 0:
                    raise ValueError(
                        f"the line intrinsics_matrix has {' '.join(words[1:])}, expected fx 0 cx 0 fy cy 0 0 1 with "
                        "fx, fy > 0"
                    )
            elif words[:1] == ["scan"]:
                pose = np.array(words[3:], float).reshape(4, 4) @ np.diag([1.0, -1.0, -1.0, 1.0])
                if not (np.isfinite([fx, fy, cx, cy]).all() and is_rigid(pose, _RIGID_TOLERANCE)):
                    raise ValueError(
                        f"the camera of the picture {words[1]} has a pose that is not a rigid motion, or a number that "
                        "is not finite, expected a rotation and a translation of finite numbers"
                    )
                lens = Camera(WIDTH_PX, HEIGHT_PX, float(fx), float(fy), float(cx), float(HEIGHT_PX - 1 - cy))
                camera = PosedCamera(lens, pose)
                shots.setdefault(words[2].split("_")[0], []).append(DepthShot(words[1], words[2], camera))
    except (IndexError, UnboundLocalError, ValueError) as error:
        raise DataError(f"{path} is not a valid camera file of the Matterport3D release: {error}") from None
    if not shots:
        raise DataError(f"{path} lists no images, expected lines that begin with 'scan'")
    return {name: Viewpoint(name, folder, tuple(taken), _panorama_pose(taken)) for name, taken in shots.items()}


def _panorama_pose(shots: Sequence[DepthShot]) -> np.ndarray:
    """Return T_world_pano (4, 4), upright, at the mean position of the cameras."""
    level = next((shot for shot in shots if "_i1_" in shot.picture), shots[0]).camera.T_world_camera
    x_m, y_m, z_m = np.mean([shot.camera.T_world_camera[:3, 3] for shot in shots], axis=0)
    return pose_2d(x_m, y_m, float(np.arctan2(level[1, 2], level[0, 2])), z_m)


def _read_depth(path: Path) -> np.ndarray:
    """Read a depth image: depth (h, w) float32 along the camera axis in metres, NaN where the depth is unknown."""
    units = _check_size(path, images.read_ids(path))
    return np.where(units > 0, units / np.float32(_DEPTH_PER_METRE), np.float32(np.nan)).astype(np.float32)


def _check_size(path: Path, image: np.ndarray) -> np.ndarray:
    if image.shape[:2] != (HEIGHT_PX, WIDTH_PX):
        raise DataError(
            f"{path} is {image.shape[1]} x {image.shape[0]}, expected {WIDTH_PX} x {HEIGHT_PX}, "
            "the size that its camera was calibrated for"
        )
    return image
