"""Launch the node: ros2 launch salframe_ros2 track.launch.py map:=/maps/office image:=/camera/image_raw ..."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

TOPICS = {
    "image": "/camera/image_raw",
    "depth": "/camera/depth/image_raw",
    "camera_info": "/camera/camera_info",
    "odom": "/odom",
}
"""Default topic of each input."""


def generate_launch_description() -> LaunchDescription:
    """Return the node with its arguments."""
    config = Path(get_package_share_directory("salframe_ros2")) / "config" / "track.yaml"
    arguments = [
        DeclareLaunchArgument("map", description="map folder of salframe build"),
        DeclareLaunchArgument("params", default_value=str(config), description="YAML file with parameters"),
        *(DeclareLaunchArgument(name, default_value=topic) for name, topic in TOPICS.items()),
    ]
    node = Node(
        package="salframe_ros2",
        executable="track",
        name="salframe",
        parameters=[LaunchConfiguration("params"), {"map": LaunchConfiguration("map")}],
        remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
        output="screen",
    )
    return LaunchDescription([*arguments, node])
