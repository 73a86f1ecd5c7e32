"""Cameras in rendered rooms: photographs with distortion give back the panorama, and are localized as it is."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run
from distorted_camera import CALIBRATION, image_rays, mounted, photograph
from room import furnished_room
from salframe_house.render import HouseRenderer

from salframe.panoramas import images
from salframe.panoramas.camera_file import read_camera
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, pose_yaw, translation
from salframe.panoramas.opening import find_dataset
from salframe.panoramas.photograph import photograph_panorama
from salframe.panoramas.shot import read_photograph
from salframe.testing.rooms import turned

FISHEYE = {**CALIBRATION, "fx": 220.0, "fy": 220.0, "distortion_model": "fisheye", "distortion": [0.05, -0.01, 0, 0]}


def write_camera(path, calibration, T_base_camera):
    path.write_text(json.dumps({**calibration, "T_base_camera": T_base_camera.tolist()}))
    return read_camera(path)


@pytest.fixture(scope="module")
def rendered():
    """A furnished room at 512 rows: colour, range and instances."""
    renderer = HouseRenderer(furnished_room(), "day", 512)
    pose = pose_2d(2.8, 4.0, -1.7, 1.4)
    range_m, instance_id = renderer.geometry(pose)
    rgb = np.round(120 + 100 * np.sin(range_m[..., None] * [1.0, 1.7, 2.3])).astype(np.uint8)
    return rgb, range_m, instance_id


@pytest.mark.parametrize("calibration", [CALIBRATION, FISHEYE], ids=["plumb_bob", "fisheye"])
def test_a_distorted_photograph_gives_back_the_panorama(tmp_path, rendered, calibration):
    rgb, range_m, instance_id = rendered
    T_base_camera = mounted(-20, 0.2, 0.1, 0.9)
    camera = write_camera(tmp_path / "camera.json", calibration, T_base_camera)
    assert camera.notes == ()
    seen = photograph(rgb, calibration, T_base_camera, smooth=True)
    z_m = photograph(range_m, calibration, T_base_camera, smooth=False) * image_rays(calibration)[..., 2]
    ids = photograph(instance_id, calibration, T_base_camera, smooth=False)
    labels = {number: "thing" for number in np.unique(ids) if number}
    panorama = photograph_panorama(
        camera, "photo", seen, z_m.astype(np.float32), instance_id=ids, labels=labels, height=512
    )
    valid = panorama.valid
    assert valid.mean() > 0.1
    off = np.abs(panorama.rgb[valid].astype(int) - rgb[valid]).max(1)
    assert np.median(off) <= 3
    assert np.mean(off > 20) < 0.05  # edges of objects
    ratio = panorama.range_m[valid] / range_m[valid]
    assert np.isfinite(ratio).all()
    assert np.quantile(np.abs(ratio - 1), 0.9) < 0.02
    assert np.median(np.abs(ratio - 1)) < 0.005
    assert np.mean(panorama.annotations.instance_id[valid] == instance_id[valid]) > 0.97


def test_a_point_lies_at_its_pixel_and_range(tmp_path):
    """A point of the world at 4 m: the pixel is that of OpenCV, and the range does not depend on the kind of depth."""
    import cv2

    T_world_base, T_base_camera = pose_2d(1.0, 2.0, 0.4), mounted(-15, 0.25, -0.05, 1.1)
    camera = write_camera(tmp_path / "camera.json", CALIBRATION, T_base_camera)
    T_world_camera = T_world_base @ T_base_camera
    point_m = np.array([3.6, 4.5, 0.3])
    in_camera = T_world_camera[:3, :3].T @ (point_m - T_world_camera[:3, 3])
    K = np.array([[250.0, 0, 236], [0, 252, 185], [0, 0, 1]])
    pixel = cv2.projectPoints(in_camera[None], np.zeros(3), np.zeros(3), K, np.array(CALIBRATION["distortion"]))[0]
    column, row = np.rint(pixel.ravel()).astype(int)
    range_m = np.linalg.norm(in_camera)
    for kind, depth_m in (("z", in_camera[2]), ("ray", range_m)):
        steps = np.zeros((360, 480), np.int32)
        steps[row - 2 : row + 3, column - 2 : column + 3] = round(depth_m * 1000)
        images.write_ids(tmp_path / "depth.png", steps)
        images.write_color(tmp_path / "a.png", np.zeros((360, 480, 3), np.uint8))
        panorama = read_photograph(tmp_path / "a.png", tmp_path / "depth.png", camera=camera, range_kind=kind)
        height = len(panorama.range_m)
        x, y, z = T_world_base[:3, :3].T @ (point_m - T_world_camera[:3, 3])
        at = int((0.5 - np.arcsin(z / range_m) / np.pi) * height), int((1 - np.arctan2(y, x) / np.pi) * height)
        assert panorama.range_m[at] == pytest.approx(range_m, rel=2e-3)
        assert np.isfinite(panorama.range_m).sum() < 200


@pytest.mark.slow
def test_views_of_a_camera_are_localized_as_panoramas(tmp_path, monkeypatch):
    """Three views, turned on the spot, of a camera that is 0.3 m ahead of its base: the answered pose is the base's."""
    monkeypatch.chdir(tmp_path)
    settings = "rgb=false", "queries_per_room=1", "height=256"
    house = find_dataset("house-12", overrides=[f"data.{setting}" for setting in settings])
    built = run("build", "house-12", "-o", "map", *(f"--set=data.{setting}" for setting in settings))
    assert built.code == 0, built.err
    (fold,) = house.folds()
    query = fold.queries[0]
    panorama, truth = query.load(), house.truth(query.id)
    T_base_camera = mounted(10, 0.3, 0.1, -0.2)
    write_camera(tmp_path / "camera.json", CALIBRATION, T_base_camera)
    (tmp_path / "labels.json").write_text(json.dumps(panorama.annotations.labels))
    width = panorama.range_m.shape[1]
    photographs, whole = [], []
    rows, whole_rows = ["t_s,x_m,y_m,z_m,yaw_deg"], ["t_s,x_m,y_m,z_m,yaw_deg"]
    for number in range(3):
        shift = -round((2 - number) * 54 / 360 * width)  # each view is turned to the left from the one before
        yaw_rad = -2 * np.pi * -shift / width
        T_start_camera = pose_2d(0, 0, yaw_rad)  # around the camera
        T_start_base = T_start_camera @ translation(-T_base_camera[:3, 3])
        for lines, pose in ((rows, T_start_base), (whole_rows, T_start_camera)):
            lines.append(",".join(map(str, (number, *pose[:3, 3], np.degrees(pose_yaw(pose))))))
        view = turned(panorama, shift)
        z_m = photograph(view.range_m, CALIBRATION, T_base_camera, smooth=False) * image_rays(CALIBRATION)[..., 2]
        ids = photograph(view.annotations.instance_id, CALIBRATION, T_base_camera, smooth=False)
        images.write_color(tmp_path / f"{number}.png", np.zeros((*ids.shape, 3), np.uint8))
        images.write_ids(tmp_path / f"{number}.depth.png", np.round(np.nan_to_num(z_m) * 1000).astype(np.int32))
        images.write_ids(tmp_path / f"{number}.ids.png", ids)
        images.write_color(tmp_path / f"{number}.whole.png", np.zeros((*view.range_m.shape, 3), np.uint8))
        images.write_range(tmp_path / f"{number}.whole.depth.png", view.range_m)
        images.write_ids(tmp_path / f"{number}.whole.ids.png", view.annotations.instance_id)
        for files, stem in ((photographs, f"{number}"), (whole, f"{number}.whole")):
            files.append((f"{stem}.png", "--range", f"{stem}.depth.png", "--instances", f"{stem}.ids.png"))
    (tmp_path / "motion.csv").write_text("\n".join(rows))
    (tmp_path / "whole.csv").write_text("\n".join(whole_rows))

    def answer(views, motion, *options):
        words = [word for view in views for word in view]
        found = run(
            "localize", "map", "--views", *words, "--labels", "labels.json", "--motion", motion, *options, "--json"
        )
        assert found.code == 0, found.err
        assert not [note for note in found.json["notes"] if "one by one" in note]
        return found.json

    expected, narrow = answer(whole, "whole.csv"), answer(photographs, "motion.csv", "--camera", "camera.json")
    assert expected["places"][0]["place"] == narrow["places"][0]["place"] == truth.place
    T_world_base = np.array(narrow["T_world_query"])
    for T_world_camera in (np.array(expected["T_world_query"]), truth.T_world_pano):
        distance_m, angle_rad = pose_errors(
            T_world_base, T_world_camera @ invert_pose(translation(T_base_camera[:3, 3]))
        )
        assert distance_m < 0.15
        assert angle_rad < np.radians(3)
