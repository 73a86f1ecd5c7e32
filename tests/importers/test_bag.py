from __future__ import annotations

import numpy as np
import pytest
from bag_writer import START_S, BagWriter
from salframe_import.bag import CAMERA_INFO, IMAGE, ODOMETRY, Bag

from salframe.framework.errors import DataError

PIXELS = np.zeros((2, 4, 3), np.uint8)


def write(path, storage="mcap", **options):
    with BagWriter(path, storage, **options) as writer:
        for t_s in (0.0, 0.5, 1.0):
            writer.image("/left", t_s, "left", PIXELS, "rgb8", delay_s=0.1)
        writer.image("/right", 0.25, "right", PIXELS, "rgb8")
        writer.odometry("/odom", 0.0, "odom", "base", (1, 2, 3), (0, 0, 0, 1))
    return path


def test_stamps_are_those_of_the_headers(tmp_path):
    stamps = Bag(write(tmp_path / "a"), "humble").stamps(["/left"])["/left"] - START_S * 10**9
    assert stamps.tolist() == [[0, 10**8], [5 * 10**8, 6 * 10**8], [10**9, 11 * 10**8]]


def test_a_message_is_read_by_its_stamp(tmp_path):
    bag = Bag(write(tmp_path / "a"), "humble")
    start_ns = START_S * 10**9
    message = bag.read("/left", start_ns + 5 * 10**8, start_ns + 6 * 10**8)
    assert message.header.stamp.sec == START_S
    assert message.header.stamp.nanosec == 5 * 10**8
    with pytest.raises(DataError, match=r"no longer contains the message of the topic /left at 1700000000\.500 s"):
        bag.read("/left", start_ns + 5 * 10**8, start_ns + 5 * 10**8)


@pytest.mark.parametrize(("storage", "suffix"), [("mcap", ".mcap"), ("sqlite3", ".db3")])
def test_a_single_file_of_a_ros_2_bag(tmp_path, storage, suffix):
    folder = write(tmp_path / "a", storage)
    (file,) = folder.glob(f"*{suffix}")
    assert Bag(file, "humble").topics([IMAGE]) == ["/left", "/right"]


def test_a_folder_of_ros_1_bags(tmp_path):
    write(tmp_path / "a.bag", "ros1")
    with BagWriter(tmp_path / "b.bag", "ros1") as writer:
        writer.image("/left", 2.0, "left", PIXELS, "rgb8")
    assert len(Bag(tmp_path, "humble").stamps(["/left"])["/left"]) == 4


@pytest.mark.parametrize("distribution", ["foxy", "humble", "jazzy"])
def test_a_bag_without_message_definitions(tmp_path, distribution):
    bag = Bag(write(tmp_path / "a", "sqlite3", has_definitions=False), distribution)
    position = bag.first("/odom").content.pose.pose.position
    assert (position.x, position.y, position.z) == (1, 2, 3)


def test_topics_are_chosen(tmp_path):
    bag = Bag(write(tmp_path / "a"), "humble")
    assert bag.choose("poses", None, [ODOMETRY]) == "/odom"
    assert bag.choose("image", "/right", [IMAGE]) == "/right"
    with pytest.raises(
        DataError, match=r"2 topics .*Image \(/left, /right\), expected one: select it with --set image=TOPIC"
    ):
        bag.choose("image", None, [IMAGE])
    with pytest.raises(DataError, match=r"has no topic /up, expected a topic of the type .*: /left, /right"):
        bag.choose("image", "/up", [IMAGE])
    with pytest.raises(DataError, match=r"the topic /odom has the type nav_msgs/msg/Odometry, expected sensor_msgs"):
        bag.choose("image", "/odom", [IMAGE])
    with pytest.raises(DataError, match=r"no topic .*CameraInfo \(all topics: /left \[sensor_msgs/msg/Image\]"):
        bag.choose("camera_info", None, [CAMERA_INFO])


def test_stamps_of_zero_are_named(tmp_path):
    with BagWriter(tmp_path / "a") as writer:
        writer.image("/left", -START_S, "left", PIXELS, "rgb8", delay_s=START_S)
    with pytest.raises(DataError, match=r"the topic /left of .* has a message whose header stamp is 0"):
        Bag(tmp_path / "a", "humble").stamps(["/left"])


def test_what_is_no_bag_is_named(tmp_path):
    with pytest.raises(DataError, match=r"nothing does not exist, expected a ROS bag: a \.bag, \.mcap or \.db3 file"):
        Bag(tmp_path / "nothing", "humble")
    with pytest.raises(DataError, match=r"has no metadata\.yaml and no \.bag file, expected a ROS bag"):
        Bag(tmp_path, "humble")
    for name in ("a.bag", "a.mcap", "a.db3", "a.txt"):
        (tmp_path / name).write_bytes(b"no bag" * 100)
        with pytest.raises(DataError, match=r"a\.\w+ cannot be read as a ROS bag: "):
            Bag(tmp_path / name, "humble")


@pytest.mark.parametrize("storage", ["ros1", "mcap"])
def test_a_truncated_bag_is_named(tmp_path, storage):
    path = write(tmp_path / ("a.bag" if storage == "ros1" else "a"), storage)
    file = path if storage == "ros1" else next(path.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:-400])
    with pytest.raises(DataError, match=r"cannot be read"):
        Bag(file, "humble").stamps(["/left"])
