"""The ROS module: pinhole cameras, messages out, and what it does when messages are missing or wrong."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ros2.recorded_walk import DEPTH, IMAGE, INFO, ODOM, OPTICAL, T_BASE_PANO, RecordedWalk, RosMessages, replay
from salframe.framework.errors import DataError
from salframe.graphs.vocabulary import common_label
from salframe.localization.map import open_map
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import invert_pose, pose_2d, rays_to_pixels
from salframe.testing.rooms import ROOMS, look, stand

EXAMPLE = Path(__file__).parents[2] / "examples" / "ros2_node"
NEAR = {"view_distance_m": 0.05}


@pytest.fixture(scope="module")
def opened(rooms_map):
    return open_map(rooms_map)


@pytest.fixture(scope="module")
def walk() -> RecordedWalk:
    poses = [stand(ROOMS[2], 0.35 + 0.06 * step, 0.4 + 0.03 * step, 0.4 * step) for step in range(6)]
    return RecordedWalk.of([look(ROOMS[2], f"view {step}", pose) for step, pose in enumerate(poses)], poses)


@pytest.fixture(scope="module")
def replayed(opened, walk, tmp_path_factory):
    """The updates of the walk, and the tracker after it."""
    from salframe_ros2.robot_tracker import RobotSettings

    bag = walk.write_bag(tmp_path_factory.mktemp("bag") / "walk.mcap")
    return replay(opened, bag, RobotSettings(**NEAR))


def matrix(position, orientation) -> np.ndarray:
    pose = np.eye(4)
    turn = [orientation.x, orientation.y, orientation.z, orientation.w]
    pose[:3, :3] = Rotation.from_quat(turn).as_matrix()
    pose[:3, 3] = position.x, position.y, position.z
    return pose


def test_the_pose_is_that_of_the_base(replayed, walk):
    messages = RosMessages()
    for number, update in enumerate(replayed[0]):
        pose = messages.serialized(update.pose)
        assert (pose.header.frame_id, pose.header.stamp.sec) == ("map", 1_700_000_000 + number)
        T_map_base = matrix(pose.pose.pose.position, pose.pose.pose.orientation)
        true_base = walk.truth[number] @ invert_pose(T_BASE_PANO)
        assert np.linalg.norm((T_map_base - true_base)[:3, 3]) < 0.15
        assert messages.serialized(update.status).data == "tracking"


def test_the_covariance_is_that_of_the_base(replayed):
    """By sampling poses of the camera: the base is 0.32 m from it."""
    update = replayed[0][-1]
    belief = update.step.pose
    covariance = update.pose.pose.covariance.reshape(6, 6)
    rng = np.random.default_rng(0)
    x, y, yaw = rng.multivariate_normal(np.zeros(3), belief.covariance * 1e-4, 200_000).T
    T_pano_base = invert_pose(T_BASE_PANO)
    heading = np.arctan2(belief.T_world_pano[1, 0], belief.T_world_pano[0, 0]) + yaw
    offset = np.exp(1j * heading) * (T_pano_base[0, 3] + 1j * T_pano_base[1, 3])
    sampled = np.cov([x + offset.real, y + offset.imag, yaw]) * 1e4
    axes = np.ix_((0, 1, 5), (0, 1, 5))
    np.testing.assert_allclose(covariance[axes], sampled, rtol=0.02, atol=0.01 * np.abs(sampled).max())
    covariance[axes] = 0
    assert not covariance.any()


def test_the_transform_joins_map_and_odometry(replayed, walk):
    updates, tracker = replayed
    messages = RosMessages()
    stamp = messages("builtin_interfaces/msg/Time", sec=7, nanosec=5)
    transform = messages.serialized(tracker.map_to_odom(stamp))
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "odom")
    assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (7, 5)
    T_map_odom = matrix(transform.transform.translation, transform.transform.rotation)
    T_odom_base = walk.odometry[-1] @ invert_pose(T_BASE_PANO)
    np.testing.assert_allclose(T_map_odom @ T_odom_base, updates[-1].T_map_base, atol=1e-9)


def test_the_path_has_the_poses_so_far(replayed):
    messages = RosMessages()
    updates = replayed[0]
    path = messages.serialized(updates[2].path)
    assert [row.header.stamp.sec - 1_700_000_000 for row in path.poses] == [0, 1, 2]
    for row, update in zip(path.poses, updates[:3], strict=True):
        np.testing.assert_allclose(matrix(row.pose.position, row.pose.orientation), update.T_map_base, atol=1e-9)


def test_the_markers_are_the_objects_of_the_room(replayed):
    """Where the boxes of the room are in the world, with their labels."""
    markers = RosMessages().serialized(replayed[0][0].markers).markers
    assert (markers[0].action, markers[0].type) == (3, 0)
    corner = np.array([*ROOMS[2].corner_m, 0.0])
    spheres = [marker for marker in markers if marker.type == 2]
    texts = [marker for marker in markers if marker.type == 9]
    assert len(spheres) == len(texts) >= 3
    for sphere, text in zip(spheres, texts, strict=True):
        at = np.array([sphere.pose.position.x, sphere.pose.position.y, sphere.pose.position.z])
        boxes = [box for box in ROOMS[2].boxes if common_label(box.label) == text.text]
        outside_m = [np.abs(at - corner - box.centre_m) - np.array(box.size_m) / 2 for box in boxes]
        assert min(distance.max() for distance in outside_m) < 0.05  # in the box
        assert (sphere.ns, sphere.id, sphere.header.frame_id) == ("objects", text.id, "map")


@pytest.mark.parametrize("depth", ["16UC1", "32FC1"])
def test_a_pinhole_camera_with_camera_info_is_tracked(opened, walk, depth, tmp_path):
    """A camera of 120 degrees on the robot; depth in millimetres or metres along its optical axis."""
    from bag_writer import BagWriter
    from salframe_ros2.robot_tracker import RobotSettings

    camera = Camera.of_field_of_view(640, 480, 120)
    rays = camera.rays()
    column, row = rays_to_pixels(rays.reshape(-1, 3), walk.views[0].rgb.shape[0])
    pixels = np.floor(row).astype(int), np.floor(column).astype(int) % walk.views[0].rgb.shape[1]
    K = camera.fx, camera.fy, camera.cx, camera.cy
    with BagWriter(tmp_path / "walk.mcap") as writer:
        writer.transform("/tf_static", 0.0, "base_link", "camera_optical", T_BASE_PANO[:3, 3], OPTICAL)
        for number, (view, pose) in enumerate(zip(walk.views, walk.odometry, strict=True)):
            T_odom_base = pose @ invert_pose(T_BASE_PANO)
            turn = Rotation.from_matrix(T_odom_base[:3, :3]).as_quat()
            writer.odometry(ODOM, number, "odom", "base_link", T_odom_base[:3, 3], turn)
            z_m = view.range_m[pixels].reshape(480, 640) * rays[..., 0]
            stored = np.round(1000 * z_m).astype(np.uint16) if depth == "16UC1" else z_m.astype(np.float32)
            writer.info(INFO, number, "camera_optical", (640, 480), K)
            writer.image(IMAGE, number, "camera_optical", view.rgb[pixels].reshape(480, 640, 3), "rgb8")
            writer.image(DEPTH, number, "camera_optical", stored, depth)
    updates, _ = replay(opened, tmp_path / "walk.mcap", RobotSettings(**NEAR))
    assert len(updates) == 6
    last = updates[-1]
    assert last.step.error is None
    assert last.step.pose.status == "tracking"
    true_base = walk.truth[-1] @ invert_pose(T_BASE_PANO)
    assert np.linalg.norm((last.T_map_base - true_base)[:2, 3]) < 0.3


def test_missing_messages_are_named(opened):
    from salframe_ros2.robot_tracker import RobotSettings, RobotTopics, RobotTracker

    tracker = RobotTracker(opened, RobotSettings(), RosMessages(), RobotTopics(IMAGE, DEPTH, INFO, ODOM))
    with pytest.raises(DataError, match=f"the running topics has no topic {IMAGE}"):
        tracker.update()
    assert tracker.map_to_odom(None) is None


def test_images_near_the_last_view_are_not_localized(opened, walk, tmp_path):
    from salframe_ros2.robot_tracker import RobotSettings

    updates, _ = replay(opened, walk.write_bag(tmp_path / "walk.mcap"), RobotSettings())
    assert [update.pose.header.stamp.sec - 1_700_000_000 for update in updates] == [0, 2, 4]


def test_a_robot_in_another_building_has_no_pose(opened, tmp_path):
    """Its images are grey, so that no object is found."""
    from dataclasses import replace

    from salframe_ros2.robot_tracker import RobotSettings

    poses = [pose_2d(float(step), 0.0, 0.0, 1.5) for step in range(3)]
    view = look(ROOMS[2], "view", stand(ROOMS[2], 0.5, 0.5, 0.0))
    grey = replace(view, rgb=np.full_like(view.rgb, 128))
    bag = RecordedWalk.of([grey] * 3, poses).write_bag(tmp_path / "walk.mcap")
    updates, tracker = replay(opened, bag, RobotSettings())
    assert len(updates) == 3
    messages = RosMessages()
    for update in updates:
        assert update.pose is update.path is update.T_map_base is None
        assert messages.serialized(update.status).data in ("lost", "out-of-map")
        assert len(messages.serialized(update.markers).markers) == 1  # deletes the earlier ones
    assert tracker.map_to_odom(None) is None


def test_only_the_shell_imports_ros():
    for path in (EXAMPLE / "salframe_ros2").glob("*.py"):
        modules = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom):
                modules.add(str(node.module).partition(".")[0])
        ros = {name for name in modules if re.fullmatch(r"rclpy|ros\w*|rcl_\w+|\w+_msgs|tf2\w*|launch\w*", name)}
        assert bool(ros) == (path.name == "node.py"), path


def test_the_parameters_of_the_file_and_of_the_page_are_those_of_the_node():
    from salframe_ros2.robot_tracker import RobotSettings

    declared = yaml.safe_load((EXAMPLE / "config" / "track.yaml").read_text())["salframe"]["ros__parameters"]
    assert declared.pop("publish_tf") is True
    defaults = {
        name: "" if field.default is None else field.default for name, field in RobotSettings.model_fields.items()
    }
    assert declared == defaults
    page = (EXAMPLE.parents[1] / "docs" / "how-to" / "robots.md").read_text()
    section = page.partition("### Parameters")[2].partition("\n## ")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| `([^`]*)` \|", section, re.M))
    assert {name: yaml.safe_load(value) for name, value in rows.items()} == {"map": "", "publish_tf": True, **defaults}


def test_topics_and_packages_are_those_of_the_node():
    """The launch file remaps what the node resolves, and package.xml lists each package that the node imports."""
    node = (EXAMPLE / "salframe_ros2" / "node.py").read_text()
    launch = (EXAMPLE / "launch" / "track.launch.py").read_text()
    names = ast.literal_eval(re.search(r"names = (\(.*\))", node)[1])
    assert set(ast.literal_eval(re.search(r"TOPICS = (\{.*?\})", launch, re.S)[1])) == set(names)
    imported = set(re.findall(r"^from (\w+)(?:\.\w+)* import|^import (\w+)", node, re.M))
    packages = {a or b for a, b in imported} - {"__future__", "typing", "salframe", "salframe_ros2"}
    listed = set(re.findall(r"<exec_depend>(\w+)</exec_depend>", (EXAMPLE / "package.xml").read_text()))
    assert packages <= listed
