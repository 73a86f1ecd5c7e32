"""The node: subscriptions, publishers and parameters. All else is in robot_tracker.py."""

from __future__ import annotations

from typing import Any

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosidl_runtime_py.utilities import get_message
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from tf2_ros import TransformBroadcaster
from visualization_msgs.msg import MarkerArray

from salframe.framework.errors import SalframeError
from salframe.framework.validation import validate
from salframe.localization.map import open_map
from salframe_ros2.robot_tracker import RobotSettings, RobotTopics, RobotTracker

UPDATE_S, TRANSFORM_S = 0.05, 0.05
"""Periods of the timers that look for a new view and that publish the transform."""
LOG_S = 5.0
"""Minimum time between two equal log messages."""


def make_message(msgtype: str, /, **fields: Any) -> Any:
    """Create a message of rclpy."""
    return get_message(msgtype)(**fields)


class SalframeNode(Node):
    """Publishes the pose of a robot in a map of salframe."""

    def __init__(self) -> None:
        super().__init__("salframe")
        folder = self.declare_parameter("map", "", ParameterDescriptor(description="map folder of salframe build"))
        self.declare_parameter("publish_tf", True, ParameterDescriptor(description="whether to publish map -> odom"))
        settings = validate(RobotSettings, self._declare(), "parameters")
        names = ("image", "depth", "camera_info", "odom")
        topics = RobotTopics(*map(self.resolve_topic_name, names))
        self._tracker = RobotTracker(open_map(folder.value), settings, make_message, topics)
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        inputs = [
            (Image, topics.image, qos_profile_sensor_data),
            (CameraInfo, topics.camera_info, qos_profile_sensor_data),
            (Odometry, topics.odometry, qos_profile_sensor_data),
            (TFMessage, topics.tf, 100),
            (TFMessage, topics.tf_static, latched),
            *([(Image, topics.depth, qos_profile_sensor_data)] if settings.has_depth else []),
        ]
        receiving, updating = MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()
        for kind, topic, qos in inputs:
            self.create_subscription(kind, topic, self._receiver(topic), qos, callback_group=receiving)
        self._pose = self.create_publisher(PoseWithCovarianceStamped, "~/pose", 10)
        self._path = self.create_publisher(Path, "~/path", 1)
        self._objects = self.create_publisher(MarkerArray, "~/objects", 1)
        self._status = self.create_publisher(String, "~/status", 10)
        self._broadcaster = TransformBroadcaster(self)
        self.create_timer(UPDATE_S, self._update, callback_group=updating)
        if self.get_parameter("publish_tf").value:
            self.create_timer(TRANSFORM_S, self._publish_transform, callback_group=receiving)

    def _declare(self) -> dict[str, Any]:
        """Declare a parameter for each setting, and return those that differ from "", which stands for null."""
        values = {}
        for name, field in RobotSettings.model_fields.items():
            default = "" if field.default is None else field.default
            parameter = self.declare_parameter(name, default, ParameterDescriptor(description=field.description or ""))
            if parameter.value != "":
                values[name] = parameter.value
        return values

    def _receiver(self, topic: str) -> Any:
        return lambda message: self._tracker.receive(topic, message, self.get_clock().now().nanoseconds)

    def _update(self) -> None:
        try:
            update = self._tracker.update()
        except SalframeError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=LOG_S)
            return
        if update is None:
            return
        if update.step.error is not None:
            self.get_logger().warning(f"an image is left out: {update.step.error}", throttle_duration_sec=LOG_S)
        self._status.publish(update.status)
        self._objects.publish(update.markers)
        if update.pose is not None:
            self._pose.publish(update.pose)
            self._path.publish(update.path)

    def _publish_transform(self) -> None:
        transform = self._tracker.map_to_odom(self.get_clock().now().to_msg())
        if transform is not None:
            self._broadcaster.sendTransform(transform)


def main() -> None:
    """Run the node."""
    rclpy.init()
    node = SalframeNode()
    executor = MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    try:
        executor.spin()
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
