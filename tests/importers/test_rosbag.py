from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_writer import START_S, STORAGES, BagWriter
from marked_point import draw, expected_at, shown_at

from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas.importer import PanoramaRecord, Recording
from salframe.panoramas.importing import find_importer, read_recording

POINT_M = np.array([4.0, 1.0, 0.9])
OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""Quaternion (x, y, z, w) of an optical frame by REP-103 on a base that it looks ahead from."""
IDENTITY = (0, 0, 0, 1)
MOUNT_M = np.array([0.2, 0.0, 1.2])
K = 300.0, 302.0, 318.0, 242.0
SIZE = 640, 480


def turn(yaw_deg: float) -> tuple[float, float, float, float]:
    half = np.radians(yaw_deg) / 2
    return 0, 0, float(np.sin(half)), float(np.cos(half))


def base_pose(t_s: float) -> tuple[tuple[float, float, float], float]:
    """The robot drives along +x at 0.5 m/s and turns by 10 deg/s. It sees the point for 3 s."""
    return (0.5 * t_s, -0.3, 0.0), 10 * t_s - 5


def pano_pose(t_s: float, yaw_deg: float = 0.0, mount_m: np.ndarray = MOUNT_M) -> np.ndarray:
    """Pose of the level panorama at the camera, turned by a yaw on its base."""
    position, heading_deg = base_pose(t_s)
    c, s = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
    x, y, z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ mount_m + position
    c, s = np.cos(np.radians(heading_deg + yaw_deg)), np.sin(np.radians(heading_deg + yaw_deg))
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def in_pano(pose: np.ndarray) -> np.ndarray:
    return pose[:3, :3].T @ (POINT_M - pose[:3, 3])


def pinhole_picture(pose: np.ndarray) -> tuple[np.ndarray, float]:
    """Picture of the camera whose level panorama has a pose, and the z-depth of the point."""
    forward, left, up = in_pano(pose)
    fx, fy, cx, cy = K
    return draw(*SIZE, fx * -left / forward + cx + 0.5, fy * -up / forward + cy + 0.5), forward


def write_robot(writer: BagWriter, xyzw=OPTICAL, mount_m=MOUNT_M, frame: str = "camera_optical", clock_s=0.0) -> None:
    for step in range(31):
        position, yaw_deg = base_pose(step / 10)
        writer.odometry("/odom", step / 10 + clock_s, "odom", "base_link", position, turn(yaw_deg), delay_s=-clock_s)
    writer.transform("/tf_static", 0.0, "base_link", frame, mount_m, xyzw)


def write_pinhole(path: Path, storage: str = "mcap", *, depth: str | None = "16UC1", **robot) -> Path:
    with BagWriter(path, storage) as writer:
        write_robot(writer, **robot)
        for t_s in (0.55, 1.5, 2.0):
            rgb, z_m = pinhole_picture(pano_pose(t_s))
            writer.image("/camera/image_raw", t_s, "camera_optical", rgb, "rgb8")
            if depth == "16UC1":
                steps = np.full(SIZE[::-1], round(z_m * 1000), np.uint16)
                writer.image("/camera/depth/image", t_s + 0.01, "camera_optical", steps, depth)
            elif depth == "32FC1":
                writer.image("/camera/depth/image", t_s, "camera_optical", np.full(SIZE[::-1], z_m, np.float32), depth)
            writer.info("/camera/camera_info", t_s, "camera_optical", SIZE, K)
    return path


def write_equirectangular(path: Path, frame: str = "camera_optical", xyzw=OPTICAL, *, tilted: bool = False) -> Path:
    with BagWriter(path) as writer:
        write_robot(writer, xyzw, frame=frame)
        for t_s in (0.5, 1.5, 2.5):
            column, row, range_m = expected_at(POINT_M, pano_pose(t_s), 256)
            data = cv2.imencode(".png", draw(512, 256, column, row)[..., ::-1])[1].tobytes()
            writer.compressed("/pano/image/compressed", t_s, frame, data, "png")
            writer.image("/pano/range", t_s, frame, np.full((128, 256), range_m * 1000, np.uint16), "16UC1")
    return path


def read(source: Path, *settings: str) -> Recording:
    return read_recording(find_importer("rosbag", settings), source)


def assert_known_point(record: PanoramaRecord, *, has_range: bool = True) -> None:
    panorama = record.load()
    column, row, range_m = expected_at(POINT_M, record.T_world_pano, len(panorama.rgb))
    assert shown_at(panorama.rgb) == pytest.approx((column, row), abs=0.6)
    if has_range:
        assert panorama.range_m[int(row), int(column)] == pytest.approx(range_m, rel=0.01)


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("depth", ["16UC1", "32FC1"])
def test_pinhole_images_with_depth(tmp_path, storage, depth):
    recording = read(write_pinhole(tmp_path / ("a.bag" if storage == "ros1" else "a"), storage, depth=depth))
    assert recording.notes == ()
    assert [record.id for record in recording.records] == ["000000", "000001", "000002"]
    for record, t_s in zip(recording.records, (0.55, 1.5, 2.0), strict=True):
        assert np.allclose(record.T_world_pano, pano_pose(t_s), atol=1e-6)  # 0.55 s is between two poses
        assert record.t_s == pytest.approx(START_S + t_s)
        assert record.parts == {"rgb", "range", "valid"}
        assert_known_point(record)


def test_equirectangular_images_with_range(tmp_path):
    recording = read(write_equirectangular(tmp_path / "a"))
    for record, t_s in zip(recording.records, (0.5, 1.5, 2.5), strict=True):
        assert np.allclose(record.T_world_pano, pano_pose(t_s), atol=1e-6)
        assert record.parts == {"rgb", "range"}
        assert_known_point(record)


def test_a_frame_of_equirectangular_images_with_the_axes_of_a_body(tmp_path):
    recording = read(write_equirectangular(tmp_path / "a", frame="camera_link", xyzw=IDENTITY))
    for record in recording.records:
        assert_known_point(record)


def test_cube_depth_becomes_range(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        write_robot(writer)
        writer.image("/pano", 1.0, "camera_optical", np.zeros((128, 256, 3), np.uint8), "rgb8")
        writer.image("/depth", 1.0, "camera_optical", np.full((128, 256), 2000, np.uint16), "16UC1")
    (record,) = read(tmp_path / "a", "depth_kind=cube").records
    range_m = record.load().range_m
    assert range_m[64, 128] == pytest.approx(2.0, abs=0.001)
    assert range_m[64, 128 + 32] == pytest.approx(2 * np.sqrt(2), abs=0.05)  # an edge of the cube at 45 deg


def test_range_along_the_ray_of_pinhole_images(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        write_robot(writer)
        writer.image("/image", 1.0, "camera_optical", np.zeros((480, 640, 3), np.uint8), "rgb8")
        writer.image("/depth", 1.0, "camera_optical", np.full((480, 640), 2000, np.uint16), "16UC1")
        writer.info("/camera_info", 1.0, "camera_optical", SIZE, K)
    (record,) = read(tmp_path / "a", "depth_kind=ray").records
    panorama = record.load()
    assert np.nanmin(panorama.range_m) == pytest.approx(2, abs=0.02)
    assert np.nanmax(panorama.range_m) == pytest.approx(2, abs=0.02)


def test_two_cameras_are_one_panorama(tmp_path):
    """A camera ahead and one to the left, each with depth; only the second sees the point."""
    left = tuple(float(x) for x in _product(turn(90), OPTICAL))
    with BagWriter(tmp_path / "a") as writer:
        for step in range(3):
            writer.odometry("/odom", step / 2, "odom", "base_link", (3.8, -2.0, 0), turn(0))
        pose = np.eye(4)
        pose[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
        pose[:3, 3] = 3.9, -1.9, 1.2
        rgb, z_m = pinhole_picture(pose)
        blank, far = draw(*SIZE, -99, -99), 3000
        for name, xyzw, mount_m, picture, steps in (
            ("ahead", OPTICAL, (0.2, 0, 1.2), blank, far),
            ("left", left, (0.1, 0.1, 1.2), rgb, round(z_m * 1000)),
        ):
            writer.transform("/tf_static", 0, "base_link", f"{name}_optical", mount_m, xyzw)
            writer.image(f"/{name}/image", 0.5, f"{name}_optical", picture, "rgb8")
            writer.image(f"/{name}/depth", 0.5, f"{name}_optical", np.full(SIZE[::-1], steps, np.uint16), "16UC1")
            writer.info(f"/{name}/camera_info", 0.5, f"{name}_optical", SIZE, K)
    (record,) = read(tmp_path / "a", "image=/ahead/image,/left/image", "depth=/ahead/depth,/left/depth").records
    # Midway between the cameras; the heading is that of a level camera.
    assert np.allclose(record.T_world_pano[:3, 3], (3.95, -1.95, 1.2))
    assert_known_point(record)
    assert 0.15 < record.load().valid.mean() < 0.25  # two views of 94 x 77 deg


def _product(first, second):
    """Product of two quaternions (x, y, z, w)."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def test_rectified_images_have_no_distortion(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        write_robot(writer)
        rgb, _ = pinhole_picture(pano_pose(1.0))
        writer.image("/camera/image_rect_color", 1.0, "camera_optical", rgb, "rgb8")
        writer.info("/camera/camera_info", 1.0, "camera_optical", SIZE, K, (-0.3, 0.1, 0, 0, 0))
    (record,) = read(tmp_path / "a").records
    assert_known_point(record, has_range=False)


def test_distortion_is_undone(tmp_path):
    distortion = (-0.2, 0.04, 0.001, -0.0005, 0.0)
    forward, left, up = in_pano(pano_pose(1.0))
    fx, fy, cx, cy = K
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    point = np.array([[-left, -up, forward]])
    ((pixel,),) = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, np.array(distortion))[0].tolist()
    with BagWriter(tmp_path / "a") as writer:
        write_robot(writer)
        writer.image("/camera/image", 1.0, "camera_optical", draw(*SIZE, pixel[0] + 0.5, pixel[1] + 0.5), "rgb8")
        writer.info("/camera/camera_info", 1.0, "camera_optical", SIZE, K, distortion)
    (record,) = read(tmp_path / "a").records
    assert_known_point(record, has_range=False)


def test_depth_without_a_picture_in_time_is_left_out(tmp_path):
    write_pinhole(tmp_path / "a")
    assert len(read(tmp_path / "a").records) == 3
    with pytest.raises(
        DataError, match="3 of 3 pictures of /camera/image_raw are left out, because no message of /camera/depth"
    ):
        read(tmp_path / "a", "tolerance_s=0.001")
    assert len(read(tmp_path / "a", "tolerance_s=0.001", "depth=none").records) == 3


def test_pictures_without_a_pose_are_counted(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        write_robot(writer)
        for t_s in (1.0, 2.0, 4.0):
            writer.image("/pano", t_s, "camera_optical", np.zeros((128, 256, 3), np.uint8), "rgb8")
    recording = read(tmp_path / "a")
    assert len(recording.records) == 2
    assert recording.notes == ("1 of 3 pictures are left out: no pose at the time of the picture",)


def write_drive(path: Path) -> Path:
    """Ten metres along +x at 1 m/s, four pictures a second, and odometry that drifts to the left."""
    with BagWriter(path) as writer:
        for step in range(101):
            t_s = step / 10
            writer.transform("/tf", t_s, "map", "base_link", (t_s, 0, 0), IDENTITY)
            writer.odometry("/odom", t_s, "odom", "base_link", (5 + t_s, 0.1 * t_s, 0), IDENTITY)
        writer.transform("/tf_static", 0.0, "base_link", "camera_optical", MOUNT_M, OPTICAL)
        for step in range(41):
            writer.image("/pano", step / 4, "camera_optical", np.zeros((128, 256, 3), np.uint8), "rgb8")
    return path


def test_sequences_of_views(tmp_path):
    recording = read(write_drive(tmp_path / "a"), "num_views=3", "sequence_period=8", "view_distance_m=0.4")
    (note,) = recording.notes
    assert note == (
        "the poses are from tf, in the frame map; other poses are in /odom: to use them, pass --set poses=TOPIC"
    )
    views = [record for record in recording.records if record.sequence]
    # A view every 0.5 m; the sixth to the eighth of every eight are a sequence.
    assert [record.t_s - START_S for record in views] == pytest.approx([2.5, 3.0, 3.5, 6.5, 7.0, 7.5])
    assert [record.sequence for record in views] == ["sequence-001"] * 3 + ["sequence-002"] * 3
    assert all(record.is_query for record in views)
    others = [record.t_s - START_S for record in recording.records if not record.sequence]
    assert others == pytest.approx([t for t in np.arange(41) / 4 if not (2.5 <= t <= 3.5 or 6.5 <= t <= 7.5)])
    t_s, x_m, y_m, z_m, yaw_deg = recording.odometry.T
    assert np.allclose(t_s - START_S, [2.5, 3, 3.5, 6.5, 7, 7.5])
    assert np.allclose(x_m, t_s - START_S + 5.2, atol=1e-6)
    assert np.allclose(y_m, 0.1 * (t_s - START_S), atol=1e-6)
    assert np.allclose(z_m, 1.2)
    assert np.allclose(yaw_deg, 0)


def test_images_of_a_camera_that_turns_are_one_panorama(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        for step in range(13):
            writer.odometry("/odom", step / 10, "odom", "base_link", (2, 0.5, 0), turn(30 * step))
            pose = np.eye(4)
            c, s = np.cos(np.radians(30 * step)), np.sin(np.radians(30 * step))
            pose[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
            pose[:3, 3] = 2, 0.5, 1.2
            ahead = in_pano(pose)[0] > 0.5
            rgb, z_m = pinhole_picture(pose) if ahead else (draw(*SIZE, -99, -99), 3.0)
            writer.image("/image", step / 10, "camera_optical", rgb, "rgb8")
            depth = np.full(SIZE[::-1], round(z_m * 1000), np.uint16)
            writer.image("/depth", step / 10, "camera_optical", depth, "16UC1")
        writer.info("/camera_info", 0.0, "camera_optical", SIZE, K)
        writer.transform("/tf_static", 0.0, "base_link", "camera_optical", (0, 0, 1.2), OPTICAL)
    record, *_ = read(tmp_path / "a", "group_by=motion").records
    assert record.id == "station-001"
    assert record.load().valid[250:260].all()
    assert_known_point(record, has_range=False)


def test_several_topics_are_listed(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        write_robot(writer)
        for name in ("/left", "/right"):
            writer.image(name, 1.0, "camera_optical", np.zeros((128, 256, 3), np.uint8), "rgb8")
    with pytest.raises(
        DataError, match=r"has 2 topics .* \(/left, /right\), expected one: select it with --set image=TOPIC"
    ):
        read(tmp_path / "a")
    assert len(read(tmp_path / "a", "image=/right").records) == 1


def test_missing_intrinsics_are_named(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        write_robot(writer)
        writer.image("/camera/image_raw", 1.0, "camera_optical", np.zeros((480, 640, 3), np.uint8), "rgb8")
    with pytest.raises(DataError, match=r"images of 640 x 480 without intrinsics, expected width = 2 x height"):
        read(tmp_path / "a")


# Wrong settings and damaged recordings are named in one line.


def test_inverted_extrinsics_are_named(tmp_path):
    inverse = (0.5, -0.5, 0.5, 0.5)
    (note,) = read(write_pinhole(tmp_path / "a", xyzw=inverse), "depth=none").notes
    assert note.startswith("the topic /camera/image_raw: the image is rolled: its x axis has an elevation of ")
    assert note.endswith("the frame camera_optical in /tf_static, and whether they are inverted")
    with pytest.raises(
        DataError, match=r"frame camera_optical\) are not upright according to their poses: .* \(not inverted, quat"
    ):
        read(write_equirectangular(tmp_path / "b", xyzw=inverse))


def test_an_optical_frame_with_the_axes_of_the_body_is_named(tmp_path):
    (note,) = read(write_pinhole(tmp_path / "a", xyzw=IDENTITY), "depth=none").notes
    assert note.startswith(
        "the topic /camera/image_raw: the optical axis of the camera points up by 90 deg; expected T_base_camera to map"
    )


def test_the_quaternion_of_an_optical_frame_in_the_order_w_x_y_z_is_harmless(tmp_path):
    x, y, z, w = OPTICAL
    recording = read(write_pinhole(tmp_path / "a", xyzw=(w, x, y, z)))
    assert np.allclose(recording.records[1].T_world_pano, pano_pose(1.5), atol=1e-6)


def test_clocks_that_differ_by_half_a_second_are_named(tmp_path):
    (note,) = read(write_pinhole(tmp_path / "a", clock_s=0.5), "depth=none").notes
    assert note.startswith("the delay from header stamp to recording is 0.00 s for the pictures and ")
    assert " s for the poses from /odom, in the frame odom, expected" in note
    assert note.endswith("check that both stamps are from the same clock")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["depth_kind=cube"], "the setting depth_kind is 'cube', expected z or ray for pinhole images"),
        (["projection=equirectangular"], "images of 640 x 480 without intrinsics, expected width = 2 x height"),
        (
            ["depth=/camera/image_raw"],
            "the topic /camera/image_raw (setting depth) contains pictures, expected depth images: choose another "
            "topic with --set depth=TOPIC",
        ),
        (
            ["image=/camera/depth/image"],
            "the topic /camera/depth/image (setting image) contains depth images, expected pictures: choose another "
            "topic with --set image=TOPIC",
        ),
        (["camera_info=/camera/image_raw"], "has the type sensor_msgs/msg/Image, expected sensor_msgs/msg/CameraInfo"),
        (["num_views=20"], "num_views is 20, expected less than 20, the value of sequence_period"),
        (["num_views=3", "group_by=motion"], "num_views is 3 with group_by=motion, expected 0: set num_views=0"),
        (["num_views=3"], "too few views for a sequence, expected 20 views that are 0.5 m or 45 deg apart"),
        (["world=map"], "has no frame map in /tf and /tf_static, expected one of its frames: base_link"),
        (["poses=/odom", "world=odom"], "the setting `world` is 'odom', but the poses are from the topic /odom"),
    ],
)
def test_wrong_settings_are_named(tmp_path, settings, message):
    write_pinhole(tmp_path / "a")
    with pytest.raises((DataError, ConfigError)) as raised:
        read(tmp_path / "a", *settings)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
