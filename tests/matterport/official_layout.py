"""Writes the official layout: a camera file of a rig at given viewpoints, and images drawn of a box-shaped room."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

SIZE = 1280, 1024
FX, FY, CX, CY = 1072.27, 1073.08, 626.95, 506.27
PITCH_DEG = (41.5, 0.0, -42.0)
RISE_M = (-0.0335, 0.0, 0.0335)
"""The rig's cameras lie above one another: the one that looks down is the highest. From the image poses of another
building's .house file."""


def rig(position_m, heading_deg, rise_m=RISE_M):
    """{(camera, stop): T_world_camera (4, 4)}, x right, y down, z forward; the stops follow clockwise from a heading
    (clockwise from +y)."""
    poses = {}
    for camera, (pitch, rise) in enumerate(zip(PITCH_DEG, rise_m, strict=True)):
        for stop in range(6):
            turn = Rotation.from_euler("z", -(heading_deg + 60 * stop), degrees=True) * Rotation.from_euler(
                "x", pitch, degrees=True
            )
            pose = np.eye(4)
            # Columns: right, down, forward of a camera that looks along +y, turned.
            pose[:3, :3] = turn.as_matrix() @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
            pose[:3, 3] = np.add(position_m, (0, 0, rise))
            poses[camera, stop] = pose
    return poses


def camera_lines(name, poses):
    """The lines of a viewpoint in the .conf file, whose cameras have y up and look along -z, with principal points from
    below."""
    lines = []
    for camera in range(3):
        lines.append(f"intrinsics_matrix {FX} 0 {CX}  0 {FY} {SIZE[1] - 1 - CY}  0 0 1")
        for stop in range(6):
            numbers = " ".join(f"{x:.9f}" for x in (poses[camera, stop] @ np.diag([1, -1, -1, 1])).ravel())
            lines.append(f"scan {name}_d{camera}_{stop}.png {name}_i{camera}_{stop}.jpg {numbers}")
    return lines


@dataclass
class Room:
    """A room from `low` to `high` whose walls are coloured by where one looks at them."""

    low: tuple = (-2.0, -1.5, 0.0)
    high: tuple = (2.5, 3.0, 2.6)

    def range_m(self, origin, direction):
        """Distance to the wall from inside, in lengths of the directions (..., 3)."""
        way = np.full(direction.shape[:-1], np.inf, direction.dtype)
        for axis in range(3):
            along = direction[..., axis]
            with np.errstate(divide="ignore"):
                np.minimum(
                    way,
                    (np.where(along > 0, self.high[axis], self.low[axis]) - origin[axis]) / along,
                    out=way,
                    where=along != 0,
                )
        return way

    def color(self, point):
        """(..., 3) uint8, changing slowly along every wall."""
        x, y, z = np.moveaxis(point, -1, 0)
        return np.stack(
            [127 + 100 * np.sin(2 * x + y), 127 + 100 * np.sin(2 * y - z), 127 + 100 * np.cos(2 * z + x)], -1
        ).astype(np.uint8)

    def depth(self, pose, fx=FX, fy=FY, cx=CX, cy=CY, size=SIZE):
        """World directions (h, w, 3) of a pinhole camera's pixels, of length 1 along its axis, and the z-depth (h, w)
        along them."""
        column, row = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        local = np.stack([(column - cx) / fx, (row - cy) / fy, np.ones(column.shape)], -1).astype(np.float32)
        direction = local @ pose[:3, :3].T.astype(np.float32)
        return direction, self.range_m(pose[:3, 3], direction)

    def picture(self, pose, *camera):
        """Colour (h, w, 3) of a pinhole camera."""
        direction, depth = self.depth(pose, *camera)
        return self.color(pose[:3, 3] + direction * depth[..., None])


QUARTER = FX / 4, FY / 4, (CX + 0.5) / 4 - 0.5, (CY + 0.5) / 4 - 0.5, (SIZE[0] // 4, SIZE[1] // 4)


def write_viewpoint(folder: Path, name, room, poses, centre):
    """All images of a viewpoint: 18 pictures, 18 depth images, 6 faces of the skybox that begins at stop 5."""
    for part in ("undistorted_color_images", "undistorted_depth_images", "matterport_skybox_images"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for (camera, stop), pose in poses.items():
        rgb, depth = cv2.resize(room.picture(pose, *QUARTER), SIZE), room.depth(pose)[1]
        cv2.imwrite(str(folder / "undistorted_color_images" / f"{name}_i{camera}_{stop}.jpg"), rgb[..., ::-1])
        units = np.round(depth * 4000).astype(np.uint16)
        cv2.imwrite(
            str(folder / "undistorted_depth_images" / f"{name}_d{camera}_{stop}.png"),
            units,
            [cv2.IMWRITE_PNG_COMPRESSION, 1],
        )
    ahead = Rotation.from_matrix(poses[1, 5][:3, :3])
    looks = [
        ("x", 90),
        ("y", 0),
        ("y", 90),
        ("y", 180),
        ("y", 270),
        ("x", -90),
    ]  # about the camera's x (right) and y (down)
    for face, (axis, degrees) in enumerate(looks):
        pose = np.eye(4)
        pose[:3, :3] = (ahead * Rotation.from_euler(axis, degrees, degrees=True)).as_matrix()
        pose[:3, 3] = centre
        rgb = room.picture(pose, 128, 128, 127.5, 127.5, (256, 256))
        cv2.imwrite(str(folder / "matterport_skybox_images" / f"{name}_skybox{face}_sami.jpg"), rgb[..., ::-1])


def write_building(folder: Path, conf_lines, regions, panoramas, objects=()):
    """Camera file and .house file: regions (low, high) by index, panoramas name -> (region, position), objects (label,
    category, centre, two axes, half extents)."""
    (folder / "undistorted_camera_parameters").mkdir(parents=True)
    (folder / "undistorted_camera_parameters" / f"{folder.name}.conf").write_text(
        "\n".join(["dataset matterport", *conf_lines]) + "\n"
    )
    (folder / "house_segmentations").mkdir()
    lines = ["ASCII 1.1"]
    for index, (low, high) in regions.items():
        lines.append(f"R  {index} 0  0 0  b  0 0 0  {' '.join(map(str, (*low, *high)))}  2.6  0 0 0 0")
    for number, (name, (region, position)) in enumerate(panoramas.items()):
        lines.append(f"P  {name}  {number} {region}  0  {' '.join(map(str, position))}  0 0 0 0 0")
    for number, (label, category, *box) in enumerate(objects):
        lines.append(f"C  {number}  7 {label}  3 {category}  0 0 0 0 0")
        lines.append(f"O  {number} 0 {number}  {'  '.join(' '.join(map(str, part)) for part in box)}  0 0 0 0 0 0 0 0")
    (folder / "house_segmentations" / f"{folder.name}.house").write_text("\n".join(lines))
