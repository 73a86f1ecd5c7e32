"""Writers of a home as a COLMAP model with a rig, by pycolmap, and as a ROS bag, by rosbags, without salframe."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from bag_writer import BagWriter
from colmap_writer import ColmapWriter
from foreign_formats import Stand, optical_pose, write_rgb, write_steps
from scipy.spatial.transform import Rotation

PINHOLE = {"w": 160, "h": 140, "fl_x": 80.0, "fl_y": 80.0, "cx": 80.0, "cy": 70.0}
"""A camera of 90 x 82 degrees, with the keys of transforms.json."""
PITCHES_DEG = -35.0, 35.0
NUM_TURNS = 6
CAMERA_M = 1.5
"""Height of the camera of the robot above its base."""
STOP_S = 2.0
"""Time from one stand to the next."""


def write_colmap(root: Path, stands: Sequence[Stand], calibration: dict | None = None, swap: bool = False) -> Path:
    """Write a model in metres, with z up, of a rig of two rings of pinhole cameras, with depth images of the pictures.

    swap: the model has the extrinsics of the upper ring for the lower ring, and the reverse.
    """
    calibration = calibration or PINHOLE
    writer = ColmapWriter(level=True)
    params = [calibration[key] for key in ("fl_x", "fl_y", "cx", "cy")]
    mounts = [(ring, turn) for ring in range(len(PITCHES_DEG)) for turn in range(NUM_TURNS)]
    cameras = [writer.camera("PINHOLE", calibration["w"], calibration["h"], params, trivial_rig=False) for _ in mounts]
    T_rig = [optical_pose((0, 0, 0), -60 * turn, PITCHES_DEG[ring]) for ring, turn in mounts]
    T_model = [optical_pose((0, 0, 0), -60 * turn, PITCHES_DEG[ring ^ swap]) for ring, turn in mounts]
    rig = writer.rig(cameras, [np.linalg.inv(T_model[0]) @ T for T in T_model[1:]])
    for stand in stands:
        names = [f"cam{ring}{turn}/{stand.name}.jpg" for ring, turn in mounts]
        for name, T in zip(names, T_rig, strict=True):
            rgb, depth_m = stand.look(stand.T_world_pano @ T, calibration)
            write_rgb(root / "images" / name, rgb)
            write_steps(root / "depth" / Path(name).with_suffix(".png"), depth_m, 0.001)
        writer.rig_pictures(rig, names, cameras, stand.T_world_pano @ T_model[0])
    rng = np.random.default_rng(0)
    around = np.repeat([stand.position for stand in stands], 100, axis=0)
    points = around + rng.uniform(-1.5, 1.5, around.shape)
    points[:, 2] = np.where(rng.random(len(points)) < 0.6, 0.0, points[:, 2])
    writer.points(points)
    writer.write(root / "sparse" / "0")
    return root


def write_bag(
    path: Path,
    stands: Sequence[Stand],
    height: int = 128,
    *,
    depth_unit_m: float = 0.001,
    pose_offset_s: float = 0.0,
    order: str = "xyzw",
    inverted: bool = False,
) -> Path:
    """Write an MCAP file of a robot with an equirectangular camera and range. It drives from stand to stand, with a tf
    message each 0.1 s from the frame map to its base, and stops for 0.4 s at each stand.

    pose_offset_s: the stamps of the transforms are later by this time. order: order of their quaternions.
    inverted: the transform from the base to the camera is that from the camera to the base.
    """
    to_camera = np.eye(4)
    to_camera[:3, :3], to_camera[:3, 3] = optical_pose((0, 0, 0), 0)[:3, :3], (0, 0, CAMERA_M)
    mount = np.linalg.inv(to_camera) if inverted else to_camera
    headings = np.unwrap([stand.heading_deg for stand in stands], period=360)
    positions = np.array([stand.position for stand in stands])
    rests = STOP_S * np.arange(len(stands))
    knots = np.column_stack([rests - 0.2, rests + 0.2]).ravel()
    times = np.arange(-3, round((rests[-1] + 0.3) * 10) + 1) / 10
    with BagWriter(path) as writer:
        xyz = np.column_stack([np.interp(times, knots, np.repeat(column, 2)) for column in positions.T])
        yaw = np.interp(times, knots, np.repeat(headings, 2))
        for t_s, (x, y, z), heading in zip(times.tolist(), xyz.tolist(), yaw.tolist(), strict=True):
            qx, qy, qz, qw = Rotation.from_euler("z", heading, degrees=True).as_quat()
            quaternion = (qx, qy, qz, qw) if order == "xyzw" else (qw, qx, qy, qz)
            writer.transform("/tf", t_s + pose_offset_s, "map", "base_link", (x, y, z - CAMERA_M), quaternion)
        xyzw = Rotation.from_matrix(mount[:3, :3]).as_quat()
        writer.transform("/tf_static", float(times[0]), "base_link", "camera_optical", mount[:3, 3], xyzw)
        for t_s, stand in zip(rests.tolist(), stands, strict=True):
            rgb, range_m = stand.panorama(stand.T_world_pano, height)
            jpeg = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 97])[1].tobytes()
            writer.compressed("/pano/image/compressed", t_s, "camera_optical", jpeg, "jpeg")
            steps = np.round(np.nan_to_num(range_m) / depth_unit_m).astype(np.uint16)
            writer.image("/pano/range", t_s, "camera_optical", steps, "16UC1")
    return path
