from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from colmap_writer import ColmapWriter, optical_pose
from salframe_import.colmap_model import find_model, read_model

from salframe.framework.errors import DataError

pycolmap = pytest.importorskip("pycolmap")

PARAMS = {
    "SIMPLE_PINHOLE": (250.0, 236.5, 185.0),
    "PINHOLE": (250.0, 252.0, 236.5, 185.0),
    "SIMPLE_RADIAL": (250.0, 236.5, 185.0, -0.05),
    "RADIAL": (250.0, 236.5, 185.0, -0.2, 0.04),
    "OPENCV": (250.0, 252.0, 236.5, 185.0, -0.2, 0.04, 0.001, -0.0005),
    "FULL_OPENCV": (250.0, 252.0, 236.5, 185.0, -0.2, 0.04, 0.001, -0.0005, 0.01, 0.002, 0.001, 0.0003),
    "OPENCV_FISHEYE": (250.0, 252.0, 236.5, 185.0, -0.02, 0.01, 0.002, -0.001),
    "SIMPLE_FISHEYE": (250.0, 236.5, 185.0),
    "FISHEYE": (250.0, 252.0, 236.5, 185.0),
    "SIMPLE_RADIAL_FISHEYE": (250.0, 236.5, 185.0, -0.02),
    "RADIAL_FISHEYE": (250.0, 236.5, 185.0, -0.02, 0.01),
}
DIRECTIONS = np.array([[x, y, 1.0] for x in (-0.7, -0.2, 0.5) for y in (-0.5, 0.1, 0.6)])
"""Directions in the optical frame."""
TO_PANORAMA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def one_picture(folder: Path, model: str, width: int, height: int, params: tuple[float, ...]) -> Path:
    writer = ColmapWriter()
    writer.picture("a.png", writer.camera(model, width, height, params), optical_pose(0, 0, 0, 0))
    return writer.write(folder)


@pytest.mark.parametrize("model", PARAMS)
def test_cameras_project_as_pycolmap(tmp_path, model):
    camera = read_model(one_picture(tmp_path / "m", model, 480, 360, PARAMS[model])).pictures[0].camera
    colmap = pycolmap.Camera.create_from_model_name(1, model, 1.0, 480, 360)
    colmap.params = list(PARAMS[model])
    expected = np.array(colmap.img_from_cam(DIRECTIONS)) - 0.5  # COLMAP: the centre of the first pixel is at 0.5
    assert np.allclose(camera.project(DIRECTIONS @ TO_PANORAMA.T), expected, atol=1e-9)


@pytest.mark.parametrize("text", [True, False])
def test_poses_are_those_of_the_cameras_in_the_model(tmp_path, text):
    """A camera that looks along +y of a level world, written by its quaternion."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(pycolmap.Camera.create_from_model_name(1, "PINHOLE", 300.0, 640, 480))
    half = np.sqrt(0.5)
    # ModelWorld to camera: x right stays, y down is -z, z forward is y: a turn by 90 deg about x.
    turn = pycolmap.Rotation3d(np.array([half, 0, 0, half]))  # x, y, z, w
    image = pycolmap.Image(name="a.png", camera_id=1, image_id=1)
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(turn, -turn.matrix() @ [3.0, 4.0, 1.5]))
    folder = tmp_path / "m"
    folder.mkdir()
    (model.write_text if text else model.write_binary)(str(folder))
    (picture,) = read_model(folder).pictures
    expected = [[1, 0, 0, 3], [0, 0, 1, 4], [0, -1, 0, 1.5], [0, 0, 0, 1]]
    assert np.allclose(picture.T_model_camera, expected, atol=1e-12)


def test_pictures_of_a_rig_share_their_frame(tmp_path):
    writer = ColmapWriter(level=True)
    cameras = [writer.camera("PINHOLE", 64, 64, (32, 32, 32, 32), trivial_rig=False) for _ in range(2)]
    T_rig_left = np.array([[0, 0, -1, 0.0], [0, 1, 0, 0], [1, 0, 0, 0.1], [0, 0, 0, 1]])  # looks to the left
    rig = writer.rig(cameras, [T_rig_left])
    for number in range(2):
        pose = optical_pose(number, 0, 1.5, 90)
        writer.rig_pictures(rig, [f"front/{number}.png", f"left/{number}.png"], cameras, pose)
    model = read_model(writer.write(tmp_path / "m"))
    frames = {picture.name: picture.frame for picture in model.pictures}
    assert frames["front/0.png"] == frames["left/0.png"] != frames["front/1.png"] == frames["left/1.png"]
    left = next(picture for picture in model.pictures if picture.name == "left/1.png")
    # The rig looks along +y: its left is -x, and 0.1 m ahead of (1, 0, 1.5) is (1, 0.1, 1.5).
    assert np.allclose(left.T_model_camera, [[0, 0, -1, 1], [1, 0, 0, 0.1], [0, -1, 0, 1.5], [0, 0, 0, 1]])


def test_an_equirectangular_camera_is_none(tmp_path):
    model = read_model(one_picture(tmp_path / "m", "EQUIRECTANGULAR", 512, 256, (512, 256)))
    assert model.pictures[0].camera is None


def test_a_camera_model_without_counterpart_is_named(tmp_path):
    folder = one_picture(tmp_path / "m", "FOV", 480, 360, (250, 250, 240, 180, 0.9))
    with pytest.raises(DataError, match=r"camera 1 has the model FOV, expected EQUIRECTANGULAR or one of .*undistort"):
        read_model(folder)


def test_a_model_without_poses_is_named(tmp_path):
    writer = ColmapWriter()
    writer.camera("PINHOLE", 64, 64, (32, 32, 32, 32))
    with pytest.raises(DataError, match=r"none of the 0 pictures of .* has a pose"):
        read_model(writer.write(tmp_path / "m"))


def test_a_damaged_model_is_named(tmp_path):
    folder = one_picture(tmp_path / "m", "PINHOLE", 64, 64, (32, 32, 32, 32))
    (folder / "cameras.bin").write_bytes(b"\xff" * 50)
    with pytest.raises(DataError, match="cannot be read as a COLMAP model"):
        read_model(folder)


@pytest.mark.parametrize("inside", ["", "sparse", "sparse/0"])
def test_the_model_of_a_workspace(tmp_path, inside):
    folder = one_picture(tmp_path / "w" / inside, "PINHOLE", 64, 64, (32, 32, 32, 32))
    assert find_model(tmp_path / "w") == folder


def test_several_models_are_named(tmp_path):
    for number in "01":
        one_picture(tmp_path / "sparse" / number, "PINHOLE", 64, 64, (32, 32, 32, 32))
    with pytest.raises(DataError, match=r"has 2 models in sparse \(0, 1\), expected one"):
        find_model(tmp_path)


def test_a_folder_without_model_is_named(tmp_path):
    with pytest.raises(DataError, match="has no COLMAP model"):
        find_model(tmp_path)
