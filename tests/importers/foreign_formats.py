"""Writers of foreign formats by OpenCV, py360convert and plain text. Nothing here uses salframe."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

CALIBRATION = {"w": 200, "h": 150, "fl_x": 105.0, "fl_y": 106.0, "cx": 98.2, "cy": 77.2}
"""A camera of 87 x 70 degrees, with the keys of transforms.json: the centre of the first pixel is at 0.5."""
PLUMB_BOB = {"camera_model": "OPENCV", "k1": -0.2, "k2": 0.04, "p1": 0.001, "p2": -0.0005}
FISHEYE = {"camera_model": "OPENCV_FISHEYE", "k1": 0.05, "k2": -0.01, "k3": 0.0, "k4": 0.0}
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""From the axes of OpenGL (x right, y up, z backward) to those of OpenCV, and back."""
SPIN_DEG_S, WALK_S, RATE_HZ, POSES_HZ = 60.0, 2.0, 5, 100
START_S = 1305031102.0

Look = Callable[[np.ndarray, dict], tuple[np.ndarray, np.ndarray]]
"""Returns colour (h, w, 3) and z-depth (h, w) of a camera at T_world_camera (4, 4)."""


@dataclass(frozen=True, eq=False)
class Stand:
    """A position from which the home is seen: `look` by cameras, `panorama` all around at a height in pixels."""

    name: str
    place: str
    T_world_pano: np.ndarray
    look: Look
    panorama: Callable[[np.ndarray, int], tuple[np.ndarray, np.ndarray]]

    @property
    def position(self) -> list[float]:
        return self.T_world_pano[:3, 3].tolist()

    @property
    def heading_deg(self) -> float:
        return float(np.degrees(np.arctan2(self.T_world_pano[1, 0], self.T_world_pano[0, 0])))


def upright_pose(position, heading_deg) -> np.ndarray:
    """T_world_pano (4, 4), upright."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("z", heading_deg, degrees=True).as_matrix(), position
    return pose


def optical_pose(position, heading_deg: float, pitch_deg: float = 0.0) -> np.ndarray:
    """T_world_camera (4, 4); x right, y down, z forward, of a camera that looks along a heading and up by a pitch."""
    pose = upright_pose(position, heading_deg)
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose[:3, :3] = pose[:3, :3] @ level @ Rotation.from_euler("x", pitch_deg, degrees=True).as_matrix()
    return pose


def panorama_rays(height: int) -> np.ndarray:
    """Unit rays (H, 2H, 3) of an equirectangular image, by the formulas of docs/reference/folder-format.md."""
    azimuth = np.pi - 2 * np.pi * (np.arange(2 * height) + 0.5) / (2 * height)
    elevation = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    azimuth, elevation = np.meshgrid(azimuth, elevation)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], -1)


def image_rays(calibration: dict) -> np.ndarray:
    """Rays (h, w, 3) of length 1 along the optical axis, from which OpenCV has removed the distortion."""
    x, y = np.meshgrid(np.arange(calibration["w"]) + 0.5, np.arange(calibration["h"]) + 0.5)
    pixels = np.stack([x, y], -1).reshape(-1, 1, 2)
    K = np.array([[calibration["fl_x"], 0, calibration["cx"]], [0, calibration["fl_y"], calibration["cy"]], [0, 0, 1]])
    k1, k2, k3, k4, p1, p2 = (calibration.get(name, 0.0) for name in ("k1", "k2", "k3", "k4", "p1", "p2"))
    if calibration.get("camera_model") == "OPENCV_FISHEYE":
        plane = cv2.fisheye.undistortPoints(pixels, K, np.array([k1, k2, k3, k4]))
    else:
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-12)
        plane = cv2.undistortPoints(pixels, K, np.array([k1, k2, p1, p2, k3]), criteria=stop)
    return np.concatenate([plane.reshape(*x.shape, 2), np.ones((*x.shape, 1))], -1)


def write_rgb(path: Path, rgb: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 97] if path.suffix == ".jpg" else []
    assert cv2.imwrite(str(path), rgb[..., ::-1], quality)


def write_steps(path: Path, metres: np.ndarray, unit_m: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.round(metres / unit_m).astype(np.uint16))


def write_poses(
    root: Path, rows: Sequence[Sequence], header=("picture", "place", "x_m", "y_m", "z_m", "yaw_deg")
) -> None:
    with (root / "poses.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])


def write_pictures(root: Path, stands: Sequence[Stand], queries: Sequence[Stand] = (), height: int = 128) -> Path:
    """Pictures with range and poses.csv. Queries have no row."""
    for stand in (*stands, *queries):
        rgb, range_m = stand.panorama(stand.T_world_pano, height)
        write_rgb(root / f"{stand.name}.jpg", rgb)
        write_steps(root / f"{stand.name}.range.png", range_m, 0.001)
    write_poses(root, [[f"{stand.name}.jpg", stand.place, *stand.position, stand.heading_deg] for stand in stands])
    return root


def write_transforms(
    root: Path,
    stands: Sequence[Stand],
    calibration: dict | None = None,
    pitches_deg: Sequence[float] = (-35.0, 25.0),
    apart_m: float = 0.06,
) -> Path:
    """The transforms.json of nerfstudio (nerfstudio-project/nerfstudio, docs/quickstart/data_conventions.md, commit
    266fab96c0c4e4b6c667690d6ce38024b0a2987c): at each stand rings of six images, from cameras above one another."""
    calibration, frames = calibration or CALIBRATION, []
    for stand in stands:
        for ring, pitch in enumerate(pitches_deg):
            rise_m = apart_m * (ring - (len(pitches_deg) - 1) / 2)
            for turn in range(6):
                pose = optical_pose(np.add(stand.position, (0, 0, rise_m)), stand.heading_deg - 60 * turn, pitch)
                rgb, depth_m = stand.look(pose, calibration)
                name = f"{stand.name}_{ring}_{turn}"
                write_rgb(root / f"images/{name}.jpg", rgb)
                write_steps(root / f"depth/{name}.png", depth_m, 0.001)
                frames.append(
                    {
                        "file_path": f"images/{name}.jpg",
                        "depth_file_path": f"depth/{name}.png",
                        "transform_matrix": (pose @ OPENGL).tolist(),
                        "station": stand.name,
                        "place": stand.place,
                    }
                )
    (root / "transforms.json").write_text(json.dumps({**calibration, "frames": frames}))
    return root


def write_cubemaps(root: Path, stands: Sequence[Stand], faces="FRBLUD", size: int = 128) -> Path:
    """Cubemaps, cut from panoramas by py360convert. `faces` are those written as front, right, back, left, up, down."""
    import py360convert

    offset = (np.arange(size) + 0.5) / size * 2 - 1
    lengthening = np.sqrt(1 + offset[None] ** 2 + offset[:, None] ** 2)
    for stand in stands:
        rgb, range_m = stand.panorama(stand.T_world_pano, 4 * size)
        colors = py360convert.e2c(rgb, size, "bilinear", "dict")
        ranges = py360convert.e2c(range_m[..., None], size, "nearest", "dict")
        for face, name in zip(faces, ("front", "right", "back", "left", "up", "down"), strict=True):
            write_rgb(root / f"{stand.name}_{name}.jpg", colors[face])
            write_steps(root / f"{stand.name}_{name}.depth.png", ranges[face][..., 0] / lengthening, 0.001)
    write_poses(root, [[stand.name, stand.place, *stand.position, stand.heading_deg] for stand in stands])
    return root


def write_tum(root: Path, stands: Sequence[Stand], offset_s: float = 0.0, order: str = "xyzw", both_ways=True) -> Path:
    """rgb.txt, depth.txt and groundtruth.txt with the layout of the TUM RGB-D benchmark, as in raulmur/ORB_SLAM2,
    Examples/RGB-D/TestSet/rgbd_dataset_freiburg1_xyz (rgb.txt and depth.txt of commit
    b269178685d0d78ed2096cddabf27e60a2134e63, groundtruth.txt of c91a463cdf0aea42b3898530cbbbff62ffc493f0).

    The camera turns once to the left at one stand, to the right at the next (`both_ways`), and so on, and walks in
    between. Poses come `offset_s` later than they should, depth 4 ms before and colour 3 ms after a pose.
    """
    calibration = {"w": 160, "h": 120, "fl_x": 131.25, "fl_y": 131.25, "cx": 80.0, "cy": 60.0}
    track: list[tuple[Stand, np.ndarray, float]] = []
    for number, stand in enumerate(stands):
        way = -1 if both_ways and number % 2 else 1
        turns = np.arange(round(360 / SPIN_DEG_S * POSES_HZ)) * SPIN_DEG_S / POSES_HZ
        track += [(stand, np.array(stand.position), stand.heading_deg + way * turn) for turn in turns]
        for share in np.linspace(0, 1, round(WALK_S * POSES_HZ) + 1)[1:-1] if number + 1 < len(stands) else ():
            position = (1 - share) * np.array(stand.position) + share * np.array(stands[number + 1].position)
            track.append((stand, position, stand.heading_deg))
    poses = ["# ground truth trajectory", "# file: 'drawn.bag'", "# timestamp tx ty tz qx qy qz qw"]
    colors, depths = (["# images", "# file: 'drawn.bag'", "# timestamp filename"] for _ in range(2))
    for number, (stand, position, heading) in enumerate(track):
        t_s, pose = START_S + number / POSES_HZ, optical_pose(position, heading, -10)
        qx, qy, qz, qw = Rotation.from_matrix(pose[:3, :3]).as_quat()
        quaternion = (qx, qy, qz, qw) if order == "xyzw" else (qw, qx, qy, qz)
        numbers = " ".join(f"{value:.4f}" for value in (*position, *quaternion))
        poses.append(f"{t_s + offset_s:.4f} {numbers}")
        if number % (POSES_HZ // RATE_HZ) == 0:
            rgb, depth_m = stand.look(pose, calibration)
            color, depth = (f"{t_s + shift:.6f}" for shift in (0.003, -0.004))
            write_rgb(root / f"rgb/{color}.png", rgb)
            write_steps(root / f"depth/{depth}.png", depth_m, 1 / 5000)
            colors.append(f"{color} rgb/{color}.png")
            depths.append(f"{depth} depth/{depth}.png")
    for name, lines in (("groundtruth.txt", poses), ("rgb.txt", colors), ("depth.txt", depths)):
        (root / name).write_text("\n".join(lines) + "\n")
    return root
