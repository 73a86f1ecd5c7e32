"""A furnished room whose range and colour are known in closed form, written in foreign formats by OpenCV, py360convert
and plain text. Nothing here uses salframe."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([3.5, 3.0, 2.6])
FURNITURE = (
    ((-2.0, 1.8, 0.0), (-0.8, 3.0, 0.8)),
    ((2.6, -1.5, 0.0), (3.5, 0.2, 1.9)),
    ((1.2, 2.5, 0.0), (2.8, 3.0, 1.1)),
)
"""Low and high corners of boxes in the room."""
MARKER, MARKER_M = np.array([3.5, 1.4, 1.2]), 0.25
"""Centre and radius of a red disk on the wall at x = 3.5."""
CALIBRATION = {"w": 400, "h": 300, "fl_x": 210.0, "fl_y": 212.0, "cx": 196.5, "cy": 154.5}
"""A camera of 87 x 70 degrees, with the keys of transforms.json: the centre of the first pixel is at 0.5."""
PLUMB_BOB = {"camera_model": "OPENCV", "k1": -0.2, "k2": 0.04, "p1": 0.001, "p2": -0.0005}
FISHEYE = {"camera_model": "OPENCV_FISHEYE", "k1": 0.05, "k2": -0.01, "k3": 0.0, "k4": 0.0}
STANDS = ((0.4, 0.3, 1.5), (1.3, 1.1, 1.5), (-0.9, -0.3, 1.5), (1.9, -0.4, 1.5))
HEADINGS_DEG = (20.0, 130.0, -75.0, 250.0)


def cast(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distance to the nearest surface along directions (..., 3), in lengths of the directions."""
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.where(direction > 0, HIGH - origin, LOW - origin) / direction
        nearest = np.nanmin(np.where(direction == 0, np.inf, walls), -1)
        for low, high in FURNITURE:
            one, two = (low - origin) / direction, (high - origin) / direction
            enter, leave = np.minimum(one, two).max(-1), np.maximum(one, two).min(-1)
            nearest = np.where((enter < leave) & (enter > 0), np.minimum(nearest, enter), nearest)
    return nearest


def paint(point: np.ndarray) -> np.ndarray:
    """Colour (..., 3) uint8 RGB of points, green and blue, and red on the disk."""
    x, y, z = np.moveaxis(point, -1, 0)
    shade = np.stack([np.zeros_like(x), 120 + 60 * np.sin(2 * x + y), 120 + 60 * np.cos(2 * z + x - y)], -1)
    on_disk = np.linalg.norm(point - MARKER, axis=-1) < MARKER_M
    return np.where(on_disk[..., None], [255.0, 0.0, 0.0], shade).astype(np.uint8)


def draw(origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colour and distance along rays in the world."""
    distance = cast(np.asarray(origin, float), rays)
    return paint(origin + rays * distance[..., None]), distance


def pano_pose(stand, heading_deg) -> np.ndarray:
    """T_world_pano (4, 4), upright."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("z", heading_deg, degrees=True).as_matrix(), stand
    return pose


def equirectangular(T_world_pano: np.ndarray, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour and range along the ray of a panorama, by the formulas of docs/reference/folder-format.md."""
    azimuth = np.pi - 2 * np.pi * (np.arange(2 * height) + 0.5) / (2 * height)
    elevation = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    azimuth, elevation = np.meshgrid(azimuth, elevation)
    level = np.cos(elevation)
    rays = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], -1)
    return draw(T_world_pano[:3, 3], rays @ T_world_pano[:3, :3].T)


def optical_pose(stand, heading_deg: float, pitch_deg: float = 0.0) -> np.ndarray:
    """T_world_camera (4, 4); x right, y down, z forward, of a camera that looks along a heading and up by a pitch."""
    pose = pano_pose(stand, heading_deg)
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose[:3, :3] = pose[:3, :3] @ level @ Rotation.from_euler("x", pitch_deg, degrees=True).as_matrix()
    return pose


def image(T_world_camera: np.ndarray, calibration: dict) -> tuple[np.ndarray, np.ndarray]:
    """Colour and z-depth of a camera, whose distortion OpenCV undoes for each pixel."""
    x, y = np.meshgrid(np.arange(calibration["w"]) + 0.5, np.arange(calibration["h"]) + 0.5)
    pixels = np.stack([x, y], -1).reshape(-1, 1, 2)
    K = np.array([[calibration["fl_x"], 0, calibration["cx"]], [0, calibration["fl_y"], calibration["cy"]], [0, 0, 1]])
    k = [calibration.get(name, 0.0) for name in ("k1", "k2", "k3", "k4", "p1", "p2")]
    if calibration.get("camera_model") == "OPENCV_FISHEYE":
        plane = cv2.fisheye.undistortPoints(pixels, K, np.array(k[:4]))
    else:
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-12)
        plane = cv2.undistortPoints(pixels, K, np.array([k[0], k[1], k[4], k[5], k[2]]), criteria=stop)
    local = np.concatenate([plane.reshape(*x.shape, 2), np.ones((*x.shape, 1))], -1)
    return draw(T_world_camera[:3, 3], local @ T_world_camera[:3, :3].T)


def write_rgb(path: Path, rgb: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 97] if path.suffix == ".jpg" else []
    assert cv2.imwrite(str(path), rgb[..., ::-1], quality)


def write_steps(path: Path, metres: np.ndarray, unit_m: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.round(metres / unit_m).astype(np.uint16))


def write_table(path: Path, header: list[str], rows: list[list]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])


def write_pictures(root: Path, height: int = 128, unit_m: float = 0.001) -> Path:
    """Four pictures with range and poses, and one without a row."""
    rows = []
    for number, (stand, heading) in enumerate(zip(STANDS, HEADINGS_DEG, strict=True)):
        rgb, range_m = equirectangular(pano_pose(stand, heading), height)
        write_rgb(root / f"p{number}.jpg", rgb)
        write_steps(root / f"p{number}.range.png", range_m, unit_m)
        rows.append([f"p{number}.jpg", "west" if stand[0] < 1 else "east", *stand, heading])
    rgb, range_m = equirectangular(pano_pose((0.8, 0.2, 1.5), 33), height)
    write_rgb(root / "q.jpg", rgb)
    write_steps(root / "q.range.png", range_m, unit_m)
    write_table(root / "poses.csv", ["picture", "place", "x_m", "y_m", "z_m", "yaw_deg"], rows)
    return root


OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""From the axes of OpenGL (x right, y up, z backward) to those of OpenCV, and back."""


def write_transforms(
    root: Path, distortion: dict | None = None, pitches_deg=(-35.0, 25.0), unit_m: float = 0.001, **keys
) -> Path:
    """The transforms.json of nerfstudio (nerfstudio-project/nerfstudio, docs/quickstart/data_conventions.md, commit
    266fab96c0c4e4b6c667690d6ce38024b0a2987c): at each stand two rings of six images, from cameras 6 cm apart."""
    calibration, frames = {**CALIBRATION, **(distortion or {})}, []
    for number, (stand, heading) in enumerate(zip(STANDS, HEADINGS_DEG, strict=True)):
        for ring, pitch in enumerate(pitches_deg):
            for turn in range(6):
                position = np.add(stand, (0, 0, 0.06 * (ring - 0.5)))
                pose = optical_pose(position, heading - 60 * turn, pitch)
                rgb, depth_m = image(pose, calibration)
                name = f"{number}_{ring}_{turn}"
                write_rgb(root / f"images/{name}.jpg", rgb)
                write_steps(root / f"depth/{name}.png", depth_m, unit_m)
                matrix = (pose @ OPENGL).tolist()
                frame = {"file_path": f"images/{name}.jpg", "transform_matrix": matrix, "station": f"s{number}"}
                frames.append({**frame, "depth_file_path": f"depth/{name}.png", **keys})
    (root / "transforms.json").write_text(json.dumps({**calibration, "frames": frames}))
    return root


def write_cubemaps(root: Path, faces="FRBLUD", unit_m: float = 0.001, size: int = 128) -> Path:
    """Four cubemaps, cut from panoramas by py360convert."""
    import py360convert

    spelling = dict(zip("FRBLUD", ("front", "right", "back", "left", "up", "down"), strict=True))
    rows = []
    offset = (np.arange(size) + 0.5) / size * 2 - 1
    lengthening = np.sqrt(1 + offset[None] ** 2 + offset[:, None] ** 2)
    for number, (stand, heading) in enumerate(zip(STANDS, HEADINGS_DEG, strict=True)):
        rgb, range_m = equirectangular(pano_pose(stand, heading), 512)
        colors = py360convert.e2c(rgb, size, "bilinear", "dict")
        ranges = py360convert.e2c(range_m[..., None], size, "nearest", "dict")
        for face, name in zip(faces, spelling.values(), strict=True):
            write_rgb(root / f"c{number}_{name}.jpg", colors[face])
            write_steps(root / f"c{number}_{name}.depth.png", ranges[face][..., 0] / lengthening, unit_m)
        rows.append([f"c{number}", "home", *stand, heading])
    write_table(root / "poses.csv", ["picture", "place", "x_m", "y_m", "z_m", "yaw_deg"], rows)
    return root


SPIN_DEG_S, RATE_HZ = 60.0, 10.0
START_S = 1305031102.0


def write_tum(root: Path, unit_m: float = 1 / 5000, offset_s: float = 0.0, order: str = "xyzw") -> Path:
    """rgb.txt, depth.txt and groundtruth.txt with the layout of the TUM RGB-D benchmark, as in raulmur/ORB_SLAM2,
    Examples/RGB-D/TestSet/rgbd_dataset_freiburg1_xyz (rgb.txt and depth.txt of commit
    b269178685d0d78ed2096cddabf27e60a2134e63, groundtruth.txt of c91a463cdf0aea42b3898530cbbbff62ffc493f0).

    The camera turns once to the left at one stand, to the right at the next, and so on, and walks in between. Poses
    come at ten times the rate of the images, and `offset_s` later than they should.
    """
    calibration = {"w": 320, "h": 240, "fl_x": 262.5, "fl_y": 262.5, "cx": 160.0, "cy": 120.0}
    spin_s, walk_s = 360 / SPIN_DEG_S, 2.0
    times, stands, headings = [], [], []
    t_s = 0.0
    for number, stand in enumerate(STANDS):
        way = 1 if number % 2 == 0 else -1
        for step in range(round(spin_s * 100)):
            times.append(t_s)
            stands.append(stand)
            headings.append(HEADINGS_DEG[number] + way * SPIN_DEG_S * step / 100)
            t_s += 0.01
        for step in range(round(walk_s * 100) if number < 3 else 0):
            share = (step + 1) / (walk_s * 100)
            times.append(t_s)
            stands.append(np.add(stand, np.multiply(share, np.subtract(STANDS[number + 1], stand))))
            headings.append(HEADINGS_DEG[number] + way * 360)
            t_s += 0.01
    poses = ["# ground truth trajectory", "# file: 'drawn.bag'", "# timestamp tx ty tz qx qy qz qw"]
    colors, depths = (["# images", "# file: 'drawn.bag'", "# timestamp filename"] for _ in range(2))
    for number, (time_s, stand, heading) in enumerate(zip(times, stands, headings, strict=True)):
        pose = optical_pose(stand, heading, -10)
        qx, qy, qz, qw = Rotation.from_matrix(pose[:3, :3]).as_quat()
        quaternion = (qx, qy, qz, qw) if order == "xyzw" else (qw, qx, qy, qz)
        numbers = " ".join(f"{value:.4f}" for value in (*pose[:3, 3], *quaternion))
        poses.append(f"{START_S + time_s + offset_s:.4f} {numbers}")
        if number % round(100 / RATE_HZ) == 0:
            rgb, depth_m = image(pose, calibration)
            stamps = START_S + time_s + 0.003, START_S + time_s - 0.004
            write_rgb(root / f"rgb/{stamps[0]:.6f}.png", rgb)
            write_steps(root / f"depth/{stamps[1]:.6f}.png", depth_m, unit_m)
            colors.append(f"{stamps[0]:.6f} rgb/{stamps[0]:.6f}.png")
            depths.append(f"{stamps[1]:.6f} depth/{stamps[1]:.6f}.png")
    for name, lines in (("groundtruth.txt", poses), ("rgb.txt", colors), ("depth.txt", depths)):
        (root / name).write_text("\n".join(lines) + "\n")
    return root
