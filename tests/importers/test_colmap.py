from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from colmap_writer import UNIT_M, ColmapWriter, optical_pose
from marked_point import draw, expected_at, shown_at
from salframe_import.colmap import read_dense_depth

import salframe
from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas.importer import Recording
from salframe.panoramas.importing import find_importer, read_recording

pycolmap = pytest.importorskip("pycolmap")

POINT_M = np.array([3.5, 0.3, 1.1])
POSES = {f"{room}/{n}": optical_pose(n, 0.5 * n, 1.5, 60 * n) for n, room in enumerate(["hall", "hall", "hall", "den"])}
SCALE = f"scale={UNIT_M}"


def read(source: Path, *settings: str) -> Recording:
    return read_recording(find_importer("colmap", settings), source)


def save(path: Path, rgb: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), rgb[..., ::-1])


def in_camera(T_world_camera: np.ndarray) -> np.ndarray:
    return T_world_camera[:3, :3].T @ (POINT_M - T_world_camera[:3, 3])


def photograph(camera: pycolmap.Camera, T_world_camera: np.ndarray) -> np.ndarray:
    """Picture in which the point is where pycolmap projects it."""
    (pixel,) = np.array(camera.img_from_cam(in_camera(T_world_camera)[None]))
    return draw(camera.width, camera.height, *pixel)


def equirectangular(root: Path, poses: dict[str, np.ndarray] = POSES, *, text: bool = False) -> Path:
    writer = ColmapWriter()
    number = writer.camera("EQUIRECTANGULAR", 512, 256, (512, 256))
    for name, pose in poses.items():
        writer.picture(f"{name}.png", number, pose)
        save(root / "images" / f"{name}.png", photograph(writer.model.cameras[number], pose))
    floor = np.random.default_rng(0).uniform((-5, -5, 0), (5, 5, 0), (400, 3))
    writer.points(floor)
    writer.write(root / "sparse" / "0", text=text)
    return root


def relative(T: np.ndarray, first: np.ndarray) -> np.ndarray:
    return np.linalg.inv(first) @ T


def assert_known_point(recording: Recording, poses: dict[str, np.ndarray], tolerance_px: float = 0.6) -> None:
    """The panorama shows the point in its direction, for its pose in the world of the fixture."""
    first = recording.records[0]
    T_fixture_world = fixture_pano(poses[first.id]) @ np.linalg.inv(first.T_world_pano)
    for record in recording.records:
        T_fixture_pano = T_fixture_world @ record.T_world_pano
        rgb = record.load().rgb
        column, row, _ = expected_at(POINT_M, T_fixture_pano, len(rgb))
        assert shown_at(rgb) == pytest.approx((column, row), abs=tolerance_px)


def fixture_pano(T_world_camera: np.ndarray) -> np.ndarray:
    """Pose of the level panorama (x forward, y left, z up) of an optical frame."""
    return T_world_camera @ np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])


@pytest.mark.parametrize("text", [True, False])
def test_an_equirectangular_model(tmp_path, text):
    recording = read(equirectangular(tmp_path, text=text), SCALE)
    poses = [record.T_world_pano for record in recording.records]
    names = sorted(POSES)
    assert [record.id for record in recording.records] == names
    assert [record.places["folder"] for record in recording.records] == ["den", "hall", "hall", "hall"]
    for name, pose in zip(names, poses, strict=True):
        expected = relative(fixture_pano(POSES[name]), fixture_pano(POSES[names[0]]))
        assert np.allclose(relative(pose, poses[0]), expected, atol=1e-9)
        assert np.allclose(pose[2, :3], (0, 0, 1), atol=1e-9)  # upright
    assert_known_point(recording, POSES)


def test_the_scale_by_the_height_of_the_cameras(tmp_path):
    recording = read(equirectangular(tmp_path), "camera_height=1.5")
    poses = {record.id: record.T_world_pano for record in recording.records}
    assert np.linalg.norm(poses["den/3"][:3, 3] - poses["hall/0"][:3, 3]) == pytest.approx(np.hypot(3, 1.5))
    assert [pose[2, 3] for pose in poses.values()] == pytest.approx([1.5] * 4)  # the floor is at 0
    assert recording.notes == (
        "scale: 2.5 m per unit of the model, computed from the camera height of 1.5 m above the floor",
    )


def test_a_camera_of_another_size_than_its_pictures(tmp_path):
    writer = ColmapWriter()
    camera = writer.camera("PINHOLE", 640, 480, (300, 300, 320, 240))
    pose = optical_pose(0, 0, 1.5, 20)
    writer.picture("a.png", camera, pose)
    writer.write(tmp_path / "sparse")
    large = photograph(writer.model.cameras[camera], pose)
    save(tmp_path / "images" / "a.png", cv2.resize(large, (320, 240), interpolation=cv2.INTER_AREA))
    assert_known_point(read(tmp_path, SCALE), {"a": pose})


@pytest.mark.parametrize(
    ("model", "params"),
    [
        ("PINHOLE", (300.0, 302.0, 318.0, 243.0)),
        ("OPENCV", (300.0, 302.0, 318.0, 243.0, -0.2, 0.04, 0.001, -0.0005)),
        ("OPENCV_FISHEYE", (250.0, 252.0, 318.0, 243.0, -0.02, 0.01, 0.002, -0.001)),
    ],
)
def test_a_photograph_is_a_partial_panorama(tmp_path, model, params):
    writer = ColmapWriter()
    number = writer.camera(model, 640, 480, params)
    camera = writer.model.cameras[number]
    poses = {"a": optical_pose(0.5, -1, 1.5, 50), "b": optical_pose(1, 2, 1.5, -30)}
    for name, pose in poses.items():
        writer.picture(f"{name}.png", number, pose)
        save(tmp_path / "images" / f"{name}.png", photograph(camera, pose))
        z_m = in_camera(pose)[2]
        save_depth(tmp_path / "depth" / f"{name}.png", z_m)
    writer.write(tmp_path / "sparse" / "0")
    recording = read(tmp_path, SCALE, f"depth={tmp_path / 'depth'}")
    assert_known_point(recording, poses)
    for record in recording.records:
        panorama = record.load()
        column, row = shown_at(panorama.rgb)
        expected_m = np.linalg.norm(POINT_M - poses[record.id][:3, 3])
        assert panorama.range_m[int(row), int(column)] == pytest.approx(expected_m, rel=0.01)
        assert record.parts == {"rgb", "range", "valid"}
        assert 0.05 < panorama.valid.mean() < 0.3


def save_depth(path: Path, depth_m: float) -> None:
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), np.full((480, 640), round(depth_m * 1000), np.uint16))


def test_depth_maps_of_colmap_have_the_unit_of_the_model(tmp_path):
    writer = ColmapWriter()
    number = writer.camera("PINHOLE", 640, 480, (300, 300, 320, 240))
    pose = optical_pose(0.5, -1, 1.5, 50)
    writer.picture("a.png", number, pose)
    writer.write(tmp_path / "sparse")
    save(tmp_path / "images" / "a.png", photograph(writer.model.cameras[number], pose))
    depth = np.full((240, 320), in_camera(pose)[2] / UNIT_M, np.float32)  # stereo works at a lower resolution
    folder = tmp_path / "stereo" / "depth_maps"
    folder.mkdir(parents=True)
    pycolmap.DepthMap.from_array(depth, 0.1, 10.0).write(str(folder / "a.png.geometric.bin"))
    (record,) = read(tmp_path, SCALE, f"depth={folder}").records
    panorama = record.load()
    column, row = shown_at(panorama.rgb)
    expected_m = np.linalg.norm(POINT_M - pose[:3, 3])
    assert panorama.range_m[int(row), int(column)] == pytest.approx(expected_m, rel=0.01)


def test_a_damaged_depth_map_is_named(tmp_path):
    path = tmp_path / "a.png.geometric.bin"
    path.write_bytes(b"12&")
    with pytest.raises(DataError, match=r"a\.png\.geometric\.bin is not a depth map of COLMAP"):
        read_dense_depth(path)


def test_the_pictures_of_a_rig_are_one_panorama(tmp_path):
    writer = ColmapWriter()
    cameras = [writer.camera("PINHOLE", 300, 300, (150, 150, 150, 150), trivial_rig=False) for _ in range(4)]
    T_rig_cameras = []
    for quarter in (1, 2, 3):  # to the right, to the back, to the left
        c, s = np.cos(np.pi / 2 * quarter), np.sin(np.pi / 2 * quarter)
        T_rig_cameras.append(np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]]))
    rig = writer.rig(cameras, T_rig_cameras)
    poses = {f"{n}": optical_pose(n, 0, 1.5, 70 * n) for n in range(3)}
    for name, pose in poses.items():
        names = [f"camera{camera}/{name}.png" for camera in range(4)]
        writer.rig_pictures(rig, names, cameras, pose)
        for file, camera, T in zip(names, cameras, [np.eye(4), *T_rig_cameras], strict=True):
            model, T_world_camera = writer.model.cameras[camera], pose @ T
            ahead = in_camera(T_world_camera)[2] > 0
            picture = photograph(model, T_world_camera) if ahead else draw(300, 300, -99, -99)
            save(tmp_path / "images" / file, picture)
    writer.write(tmp_path / "sparse")
    recording = read(tmp_path, SCALE)
    assert [record.id for record in recording.records] == ["0", "1", "2"]
    assert_known_point(recording, poses)
    assert recording.records[0].load().valid[230:240].all()  # four views of 90 deg see the whole horizon


def test_a_scale_that_the_floor_contradicts_is_named(tmp_path):
    (note,) = read(equirectangular(tmp_path), "scale=25").notes
    assert note.startswith("the cameras are 15 m above the floor of the model, expected 0.45 to 2.8 m")


@pytest.mark.parametrize("settings", [[], ["scale=1", "camera_height=1"]])
def test_the_unit_is_needed_once(tmp_path, settings):
    with pytest.raises(ConfigError, match=r"scale .* camera_height, expected exactly one: a COLMAP model has no unit"):
        read(equirectangular(tmp_path), *settings)


def test_pictures_that_the_model_does_not_have_are_counted(tmp_path):
    equirectangular(tmp_path)
    save(tmp_path / "images" / "den" / "9.png", draw(512, 256, 1, 1))
    (note,) = read(tmp_path, SCALE).notes
    assert note.startswith("1 pictures in ")


def test_a_missing_depth_image_is_named(tmp_path):
    equirectangular(tmp_path)
    (tmp_path / "depth").mkdir()
    with pytest.raises(DataError, match=r"has no depth image of the picture den/3\.png, expected den/3\.png$"):
        read(tmp_path, SCALE, f"depth={tmp_path / 'depth'}")


def test_missing_pictures_are_named(tmp_path):
    equirectangular(tmp_path).joinpath("images").rename(tmp_path / "pictures")
    with pytest.raises(DataError, match="the pictures of the model are missing, expected a folder `images`"):
        read(tmp_path, SCALE)
    assert len(read(tmp_path, SCALE, f"images={tmp_path / 'pictures'}").records) == 4


def test_a_picture_that_cannot_be_read_costs_its_own_line(tmp_path):
    equirectangular(tmp_path / "model")
    (tmp_path / "model" / "images" / "hall" / "1.png").write_bytes(b"no picture")
    result = salframe.import_data("colmap", tmp_path / "model", tmp_path / "folder", settings=[SCALE])
    assert list(result.failures) == ["hall/1"]
    assert result.num_references == 3
    assert result.num_places == 2
