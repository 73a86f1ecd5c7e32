"""localize --fov and --camera: photographs as queries, alone and as views."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run
from tiny_folder import write_tiny_folder

from salframe.panoramas.geometry import rays_to_pixels
from salframe.panoramas.images import write_color, write_ids
from salframe.testing.rooms import query_frames, query_truths

SIZE, FOV_DEG = 400, 120
FOCAL_PX = SIZE / 2 / np.tan(np.radians(FOV_DEG / 2))
CAMERA = {"width": SIZE, "height": SIZE, "fx": FOCAL_PX, "fy": FOCAL_PX, "cx": SIZE / 2 - 0.5, "cy": SIZE / 2 - 0.5}
MOTION = "t_s,x_m,y_m,z_m,yaw_deg\n0,0,0,0,0\n1,0,0,0,120\n2,0,0,0,240\n"


@pytest.fixture
def photographs(tmp_path, monkeypatch):
    """A map of the suite's rooms, and three level photographs, turned to the left, of the query in the bedroom.

    They have z-depth in millimetres, ids and labels, and the panorama looks along the last of them.
    """
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    assert run("build", write_tiny_folder(tmp_path / "data"), "-o", "map").code == 0
    panorama = query_frames()[0].load()
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2) / FOCAL_PX
    for number, yaw_rad in enumerate(np.radians([-240, -120, 0])):
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        rays = np.stack([c + s * x, s - c * x, -y], -1)  # forward + x * right - y * up
        columns, rows = (pixels.astype(int) for pixels in rays_to_pixels(rays, len(panorama.range_m)))
        z_m = panorama.range_m[rows, columns] / np.linalg.norm(rays, axis=-1)
        write_ids(tmp_path / f"{number}.depth.png", np.round(np.nan_to_num(z_m) * 1000).astype(np.int32))
        write_ids(tmp_path / f"{number}.ids.png", panorama.annotations.instance_id[rows, columns])
        write_color(tmp_path / f"{number}.jpg", panorama.rgb[rows, columns])
    (tmp_path / "labels.json").write_text(json.dumps(panorama.annotations.labels))
    (tmp_path / "motion.csv").write_text(MOTION)
    (tmp_path / "camera.json").write_text(json.dumps({**CAMERA, "distortion_model": "none", "distortion": []}))
    return tmp_path


def parts(*numbers):
    files = [("--range", f"{number}.depth.png", "--instances", f"{number}.ids.png") for number in numbers]
    return *(word for names in files for word in names), "--labels", "labels.json"


VIEWS = ("--views", "0.jpg", "1.jpg", "2.jpg", *parts(0, 1, 2), "--motion", "motion.csv")


@pytest.mark.parametrize("camera", [("--fov", FOV_DEG), ("--camera", "camera.json")])
def test_views_of_a_camera_are_joined(photographs, camera):
    answer = run("localize", "map", *VIEWS, *camera, "--json")
    assert answer.err == "detector of the map: annotations\n"
    assert answer.json["places"][0]["place"] == "bedroom"
    np.testing.assert_allclose(answer.json["T_world_query"], query_truths()["bedroom-query"].T_world_pano, atol=0.1)


def test_the_pose_of_the_base_is_answered(photographs):
    """A camera 0.4 m ahead of its base and 0.9 m above it. The base drives around the camera."""
    T_base_camera = [[0, 0, 1, 0.4], [-1, 0, 0, 0], [0, -1, 0, 0.9], [0, 0, 0, 1]]
    content = json.loads((photographs / "camera.json").read_text())
    (photographs / "camera.json").write_text(json.dumps({**content, "T_base_camera": T_base_camera}))
    poses = [(-0.4 * np.cos(np.radians(yaw)), -0.4 * np.sin(np.radians(yaw)), 0, yaw) for yaw in (0, 120, 240)]
    rows = [",".join(map(str, (number, *pose))) for number, pose in enumerate(poses)]
    (photographs / "motion.csv").write_text("\n".join([MOTION.splitlines()[0], *rows]))
    answer = run("localize", "map", *VIEWS, "--camera", "camera.json", "--json").json
    expected = query_truths()["bedroom-query"].T_world_pano.copy()
    expected[:3, 3] -= expected[:3, :3] @ [0.4, 0, 0.9]
    np.testing.assert_allclose(answer["T_world_query"], expected, atol=0.1)


def test_a_single_photograph_is_localized(photographs):
    named = run("localize", "map", "2.jpg", *parts(2), "--fov", FOV_DEG, "--json")
    assert named.err == "detector of the map: annotations\n"
    loose = run("localize", "map", "--rgb", "2.jpg", *parts(2), "--camera", "camera.json", "--json")
    assert named.json["places"][0]["place"] == "bedroom"
    np.testing.assert_allclose(named.json["T_world_query"], loose.json["T_world_query"], atol=1e-6)


def test_the_kind_of_the_depth_is_declared(photographs):
    """Depth along the ray, in half millimetres."""
    import cv2

    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2) / FOCAL_PX
    for number in range(3):
        z_mm = cv2.imread(f"{number}.depth.png", cv2.IMREAD_UNCHANGED)
        write_ids(photographs / f"{number}.depth.png", np.round(2 * z_mm * np.sqrt(1 + x**2 + y**2)).astype(np.int32))
    declared = "--range-unit", "0.0005", "--range-kind", "ray"
    answer = run("localize", "map", *VIEWS, "--fov", FOV_DEG, *declared, "--json").json
    np.testing.assert_allclose(answer["T_world_query"], query_truths()["bedroom-query"].T_world_pano, atol=0.1)


def test_a_value_without_reading_is_reported(photographs):
    import cv2

    steps = cv2.imread("2.depth.png", cv2.IMREAD_UNCHANGED).astype(np.int32)
    steps[100:180, 50:350] = 65535
    write_ids(photographs / "2.depth.png", steps)
    words = "localize", "map", "2.jpg", *parts(2), "--fov", FOV_DEG
    assert "65535 fills" in run(*words).err
    assert "fills" not in run(*words, "--range-missing", "65535").err


def test_an_unusual_camera_is_reported_once(photographs):
    content = json.loads((photographs / "camera.json").read_text())
    (photographs / "camera.json").write_text(json.dumps({**content, "T_base_camera": np.eye(4).tolist()}))
    done = run("localize", "map", *VIEWS, "--camera", "camera.json")
    warned = [line for line in done.err.splitlines() if "camera.json" in line]
    assert len(warned) == 1
    assert warned[0].startswith(
        "warning: camera.json: the optical axis of the camera points up by 90 deg; expected T_base_camera"
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("0.jpg", "--fov", "90", "--camera", "camera.json"), "received both --camera and --fov"),
        (("0.jpg", "--fov", "175"), "received --fov '175', expected a number from 5.0 to 170.0"),
        (("a", "--fov", "90", "--data", "data"), "received --data with --fov or --camera, which"),
        (("--range", "0.depth.png", "--fov", "90"), "received --fov or --camera without a photograph"),
        (("0.jpg", "1.jpg", "--fov", "90"), "received 2 values for FRAME without --views"),
        (("0.jpg", "--range", "0.depth.png"), "received both FRAME and image files"),
        (
            ("--views", "0.jpg", "1.jpg", "--fov", "90", *parts(0)),
            "the option --range was given 1 time, expected 2: once for each view",
        ),
        (
            ("small.jpg", "--camera", "camera.json"),
            "small.jpg is 200 x 200, expected 400 x 400, the image size of the camera: use",
        ),
        (("0.jpg", "--camera", "labels.json"), "labels.json: the required key width is missing"),
        (
            ("0.jpg", "--range", "0.depth.png", "--range-kind", "cube", "--fov", "90"),
            "range_kind is 'cube' for a photo",
        ),
        (("0.jpg", "--range", "small.png", "--fov", "90"), "small.png is 200 x 200, expected 400 x 400"),
        (("0.jpg", "--instances", "0.ids.png", "--fov", "90"), "an instance image without labels"),
        (("data/frames/bedroom-query.rgb.png", "--fov", "90"), "is the panorama of the frame bedroom-query of "),
        (
            ("--views", "data/frames/bedroom-query.rgb.png", "--range", "0.depth.png"),
            "received image files for the frame data/frames/bedroom-query.rgb.png, whose images are in its dataset",
        ),
        (("--rgb", "0.jpg", "--views"), "received --views with --rgb"),
        (("0.jpg", "--fov", "90", "--range-missing", "7"), "received --range-missing without --range"),
    ],
)
def test_contradicting_options_and_files_are_one_line(photographs, words, message):
    write_color(photographs / "small.jpg", np.zeros((200, 200, 3), np.uint8))
    write_ids(photographs / "small.png", np.zeros((200, 200), np.int32))
    done = run("localize", "map", *words)
    assert done.code != 0
    assert message in done.err
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
