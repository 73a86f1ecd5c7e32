from __future__ import annotations

import numpy as np
import pytest
from bag_writer import START_S, STORAGES, BagWriter
from salframe_import.bag import Bag
from salframe_import.bag_poses import PoseSource, find_poses, read_odometry, read_transforms

from salframe.framework.errors import DataError

OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""Quaternion (x, y, z, w) of an optical frame on a base that looks along its z axis: REP-103."""
TOLERANCE_S = 0.02


def turn(yaw_deg: float) -> tuple[float, float, float, float]:
    half = np.radians(yaw_deg) / 2
    return 0, 0, float(np.sin(half)), float(np.cos(half))


def at(t_s: float) -> int:
    return START_S * 10**9 + round(t_s * 1e9)


def write(path, storage="mcap", *, world="odom", has_odometry=True, has_tf=True, extrinsics=True):
    """A robot that drives along +x of its world, then turns to the left: 1 m/s for 2 s, then 90 deg in 1 s."""
    with BagWriter(path, storage) as writer:
        for step in range(31):
            t_s = step / 10
            position, yaw_deg = (min(t_s, 2.0), 0, 0), max(t_s - 2, 0) * 90
            if has_odometry:
                writer.odometry("/odom", t_s, "odom", "base_link", position, turn(yaw_deg))
            if has_tf:
                writer.transform("/tf", t_s, world, "base_link", position, turn(yaw_deg))
        if extrinsics:
            writer.transform("/tf_static", 0.0, "base_link", "mast", (0.2, 0, 1.0), (0, 0, 0, 1))
            writer.transform("/tf_static", 0.0, "mast", "camera_optical", (0, 0.1, 0.3), OPTICAL)
    return Bag(path, "humble")


def source(bag, topic=None, world=None, frame="camera_optical") -> PoseSource:
    return find_poses(bag, read_transforms(bag), frame, topic, world)


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("topic", ["/odom", "tf"])
def test_the_pose_of_a_camera_on_a_robot(tmp_path, storage, topic):
    poses = source(write(tmp_path / ("a.bag" if storage == "ros1" else "a"), storage), topic)
    # At 1.25 s the base is at (1.25, 0, 0) and looks along +x; the camera is 0.2 m ahead, 0.1 m to the left, 1.3 m up.
    expected = [[0, 0, 1, 1.45], [-1, 0, 0, 0.1], [0, -1, 0, 1.3], [0, 0, 0, 1]]
    assert np.allclose(poses.pose("camera_optical", at(1.25), TOLERANCE_S), expected, atol=1e-9)
    # At 3 s it looks along +y.
    expected = [[1, 0, 0, 1.9], [0, 0, 1, 0.2], [0, -1, 0, 1.3], [0, 0, 0, 1]]
    assert np.allclose(poses.pose("camera_optical", at(3.0), TOLERANCE_S), expected, atol=1e-9)
    # Halfway between two turns of 9 deg each.
    heading = poses.pose("base_link", at(2.55), TOLERANCE_S)[:2, 0]
    assert np.allclose(heading, (np.cos(np.radians(49.5)), np.sin(np.radians(49.5))))


def test_poses_are_not_extrapolated(tmp_path):
    poses = source(write(tmp_path / "bag"), "/odom")
    assert poses.pose("camera_optical", at(3.05), TOLERANCE_S) is None
    assert poses.pose("camera_optical", at(-0.05), TOLERANCE_S) is None
    assert np.allclose(poses.pose("base_link", at(3.01), TOLERANCE_S), poses.pose("base_link", at(3.0), TOLERANCE_S))


def test_poses_are_not_interpolated_over_a_gap(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for t_s in (0.0, 0.9, 3.0):
            writer.odometry("/odom", t_s, "odom", "camera", (t_s, 0, 0), (0, 0, 0, 1))
    poses = source(Bag(tmp_path / "bag", "humble"), "/odom", frame="camera")
    assert poses.pose("camera", at(0.45), TOLERANCE_S)[0, 3] == pytest.approx(0.45)
    assert poses.pose("camera", at(2.0), TOLERANCE_S) is None


def test_a_map_is_preferred_to_odometry(tmp_path):
    assert str(source(write(tmp_path / "a"))) == "/odom, in the frame odom"
    assert str(source(write(tmp_path / "b", world="map"))) == "tf, in the frame map"
    assert str(source(write(tmp_path / "c", has_odometry=False))) == "tf, in the frame odom"
    assert str(source(write(tmp_path / "d", world="map"), "/odom")) == "/odom, in the frame odom"


def test_a_chain_of_moving_transforms(tmp_path):
    """map to odom to base_link: the localization turns the odometry by 90 deg and moves it."""
    with BagWriter(tmp_path / "bag") as writer:
        for t_s in (0.0, 0.5, 1.0):
            writer.transform("/tf", t_s, "map", "odom", (10, 0, 0), turn(90))
            writer.transform("/tf", t_s, "odom", "base_link", (t_s, 0, 0), (0, 0, 0, 1))
    poses = source(Bag(tmp_path / "bag", "humble"), frame="base_link")
    assert np.allclose(poses.pose("base_link", at(0.75), TOLERANCE_S)[:3, 3], (10, 0.75, 0))


def test_the_slash_of_tf_1_is_ignored(tmp_path):
    with BagWriter(tmp_path / "bag.bag", "ros1") as writer:
        for t_s in (0.0, 0.5):
            writer.transform("/tf", t_s, "/odom", "/base_link", (t_s, 0, 0), (0, 0, 0, 1))
    assert read_transforms(Bag(tmp_path / "bag.bag", "humble")).frames == ["base_link", "odom"]


def test_frames_that_are_not_connected_are_named(tmp_path):
    poses = source(write(tmp_path / "bag", extrinsics=False), "/odom")
    with pytest.raises(DataError, match=r"not connect the frames camera_optical and base_link.* base_link, odom"):
        poses.pose("camera_optical", at(1.0), TOLERANCE_S)


def test_a_bag_without_poses_is_named(tmp_path):
    bag = write(tmp_path / "bag", has_odometry=False, has_tf=False)
    with pytest.raises(
        DataError, match=r"has no poses of the camera over time, expected a topic of the type nav_msgs/msg/Odometry"
    ):
        source(bag)


def test_a_frame_that_is_missing_is_named(tmp_path):
    with pytest.raises(
        DataError, match="has no frame world in /tf and /tf_static, expected one of its frames: base_link, "
    ):
        source(write(tmp_path / "bag"), world="world")


def test_several_topics_of_odometry_are_listed(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for topic in ("/wheels", "/visual"):
            writer.odometry(topic, 0.0, "odom", "camera", (0, 0, 0), (0, 0, 0, 1))
    bag = Bag(tmp_path / "bag", "humble")
    with pytest.raises(
        DataError, match=r"2 topics .* \(/visual, /wheels\), expected one: select it with --set poses=TOPIC"
    ):
        source(bag, frame="camera")


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (0, 0, 0, 0.5), (float("nan"), 0, 0, 1)])
def test_a_quaternion_without_length_1_is_named(tmp_path, quaternion):
    with BagWriter(tmp_path / "bag") as writer:
        writer.odometry("/odom", 0.0, "odom", "camera", (0, 0, 0), quaternion)
    with pytest.raises(DataError, match=r"the transform from camera to odom at 1700000000\.000 s has the quaternion"):
        read_odometry(Bag(tmp_path / "bag", "humble"), "/odom")


def test_a_loop_is_named(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.transform("/tf", 0.0, "a", "b", (0, 0, 0), (0, 0, 0, 1))
        writer.transform("/tf", 0.0, "b", "a", (0, 0, 0), (0, 0, 0, 1))
    with pytest.raises(DataError, match="have a loop at the frame"):
        source(Bag(tmp_path / "bag", "humble"), frame="a")
