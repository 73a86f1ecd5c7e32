"""ROS bags written by rosbags: ROS 1, ROS 2 with sqlite3, and MCAP."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORAGES = ("ros1", "sqlite3", "mcap")
TF = "tf2_msgs/msg/TFMessage"
START_S = 1_700_000_000
"""Time of the stamp 0 of this writer: bags have absolute times."""


class BagWriter:
    """Writes messages to a bag. Stamps are in seconds; messages are recorded `delay_s` after their stamp."""

    def __init__(self, path: Path, storage: str = "mcap", *, has_definitions: bool = True) -> None:
        self.path = path
        self._is_ros1 = storage == "ros1"
        self._store = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_HUMBLE)
        if self._is_ros1:
            definition = "geometry_msgs/TransformStamped[] transforms"  # tf2_msgs is not a part of this typestore
            self._store.register(get_types_from_msg(definition, TF))
            self._writer: Any = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
            self._writer = Writer2(path, version=8, storage_plugin=plugin)
        self._has_definitions = has_definitions
        self._connections: dict[str, Any] = {}
        self._messages: list[tuple[int, str, str, Any]] = []

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._writer:
            for log_ns, topic, msgtype, message in sorted(self._messages, key=lambda row: row[0]):
                serialize = self._store.serialize_ros1 if self._is_ros1 else self._store.serialize_cdr
                self._writer.write(self._connection(topic, msgtype), log_ns, serialize(message, msgtype))
        if not self._has_definitions:
            forget_definitions(self.path)

    def image(
        self, topic: str, t_s: float, frame: str, pixels: np.ndarray, encoding: str, *, padding: int = 0, **times: float
    ) -> None:
        """Add an image. padding: bytes at the end of each row."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
        fields = {"height": len(pixels), "width": pixels.shape[1], "encoding": encoding, "is_bigendian": 0}
        self._add(
            topic, t_s, frame, "sensor_msgs/msg/Image", **fields, step=padded.shape[1], data=padded.ravel(), **times
        )

    def compressed(self, topic: str, t_s: float, frame: str, data: bytes, format: str, **times: float) -> None:
        content = np.frombuffer(data, np.uint8)
        self._add(topic, t_s, frame, "sensor_msgs/msg/CompressedImage", format=format, data=content, **times)

    def info(
        self,
        topic: str,
        t_s: float,
        frame: str,
        size: tuple[int, int],
        K: Sequence[float],
        D: Sequence[float] = (),
        model: str = "plumb_bob",
    ) -> None:
        """Add a CameraInfo; K: fx, fy, cx, cy."""
        fx, fy, cx, cy = K
        roi = self._make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        matrices = {
            "D": np.array(D, np.float64),
            "K": np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
            "R": np.eye(3).ravel(),
            "P": np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], np.float64),
        }
        names = matrices if self._is_ros1 else {name.lower(): matrix for name, matrix in matrices.items()}
        width, height = size
        fields = {
            "width": width,
            "height": height,
            "distortion_model": model,
            "binning_x": 0,
            "binning_y": 0,
            "roi": roi,
        }
        self._add(topic, t_s, frame, "sensor_msgs/msg/CameraInfo", **fields, **names)

    def odometry(
        self,
        topic: str,
        t_s: float,
        parent: str,
        child: str,
        position_m: Sequence[float],
        xyzw: Sequence[float],
        **times: float,
    ) -> None:
        pose = self._make(
            "geometry_msgs/msg/Pose", position=self._vector("Point", position_m), orientation=self._turn(xyzw)
        )
        zero = self._vector("Vector3", (0, 0, 0))
        twist = self._make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        covariance = np.zeros(36)
        self._add(
            topic,
            t_s,
            parent,
            "nav_msgs/msg/Odometry",
            child_frame_id=child,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
            **times,
        )

    def transform(
        self, topic: str, t_s: float, parent: str, child: str, position_m: Sequence[float], xyzw: Sequence[float]
    ) -> None:
        transform = self._make(
            "geometry_msgs/msg/Transform", translation=self._vector("Vector3", position_m), rotation=self._turn(xyzw)
        )
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(t_s, parent),
            child_frame_id=child,
            transform=transform,
        )
        message = self._make(TF, transforms=[stamped])
        self._messages.append((_nanoseconds(t_s), topic, TF, message))

    def _add(self, topic: str, t_s: float, frame: str, msgtype: str, delay_s: float = 0.0, **fields: Any) -> None:
        message = self._make(msgtype, header=self._header(t_s, frame), **fields)
        self._messages.append((_nanoseconds(t_s + delay_s), topic, msgtype, message))

    def _make(self, msgtype: str, **fields: Any) -> Any:
        return self._store.types[msgtype](**fields)

    def _header(self, t_s: float, frame: str) -> Any:
        stamp_ns = _nanoseconds(t_s)
        stamp = self._make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        sequence = {"seq": 0} if self._is_ros1 else {}
        return self._make("std_msgs/msg/Header", **sequence, stamp=stamp, frame_id=frame)

    def _vector(self, kind: str, values: Sequence[float]) -> Any:
        x, y, z = map(float, values)
        return self._make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def _turn(self, xyzw: Sequence[float]) -> Any:
        x, y, z, w = map(float, xyzw)
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _connection(self, topic: str, msgtype: str) -> Any:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, msgtype, typestore=self._store)
        return self._connections[topic]


def forget_definitions(path: Path) -> None:
    """Remove the message definitions of a ROS 2 bag with sqlite3, as in bags of Humble and older."""
    import sqlite3

    for file in path.glob("*.db3"):
        with sqlite3.connect(file) as database:
            database.execute("DELETE FROM message_definitions")


def _nanoseconds(t_s: float) -> int:
    return START_S * 10**9 + round(t_s * 1e9)
