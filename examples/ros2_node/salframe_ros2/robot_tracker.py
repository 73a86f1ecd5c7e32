"""Track a robot in a map: messages of camera and odometry in, messages of pose, transform, objects and path out.

Imports no ROS. Messages are objects with the fields of ROS 2 messages, of rclpy or of rosbags.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import Field
from salframe_import.bag import CAMERA_INFO, IMAGE, ODOMETRY, TF
from salframe_import.bag_cameras import find_cameras
from salframe_import.bag_poses import odometry_source, read_transforms
from salframe_import.bag_rig import BagRig, BagShot
from salframe_import.view_selection import ViewSpacing
from scipy.spatial.transform import Rotation

from salframe.framework.errors import FRAME_ERRORS, DataError
from salframe.framework.validation import Settings
from salframe.localization.map import LocalizationMap
from salframe.localization.matched_objects import MapObject, find_matched_objects
from salframe.localization.tracker import TrackStatus
from salframe.localization.tracking import NUM_VIEWS, TrackedCamera, TrackStep
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import flat_pose, invert_pose, moved_covariance
from salframe.panoramas.range_encoding import MILLIMETRE, RangeKind
from salframe_ros2.live_messages import LiveMessages

SPHERE, TEXT, DELETE_ALL, ADD = 2, 9, 3, 0
"""Types and actions of visualization_msgs/Marker."""
OBJECT_M, TEXT_M = 0.2, 0.18
"""Diameter of the marker of an object and height of its text in metres."""
PLANAR = (0, 1, 5)
"""Rows of x, y and the rotation about z in the covariance of a ROS pose."""


class RobotSettings(Settings):
    """Parameters of the node."""

    map_frame: str = Field("map", description="frame of the poses of the map (REP-105)")
    tracker: str | None = Field(None, description="name of the tracker; null: the default tracker")
    num_views: int = Field(NUM_VIEWS, ge=1, description="number of the latest views that are localized together")
    view_distance_m: float = Field(0.5, gt=0, description="distance after which a new view is localized (m)")
    view_turn_deg: float = Field(45.0, gt=0, description="turn after which a new view is localized (degrees)")
    projection: Literal["auto", "equirectangular", "pinhole"] = Field(
        "auto", description="projection of the images; auto: pinhole if there is a message on the topic camera_info"
    )
    camera_axes: Literal["auto", "optical", "body"] = Field(
        "auto",
        description="axes of the frame of equirectangular images. optical: x right, y down, z forward; body: x "
        "forward, y left, z up; auto: the axes for which the first image is upright",
    )
    has_depth: bool = Field(True, description="whether images have depth on the topic depth")
    depth_unit_m: float = Field(MILLIMETRE, gt=0, description="metres per unit of 16-bit depth; REP-118: 0.001")
    depth_kind: Literal["ray", "z"] | None = Field(
        None, description="quantity in the depth. null: z for pinhole images, ray for equirectangular ones"
    )
    height: int = Field(512, ge=64, le=4096, description="height of the panorama of a pinhole image in pixels")
    tolerance_s: float = Field(
        0.02, gt=0, le=1, description="maximum difference of the stamps of messages that belong together (s)"
    )
    max_path_poses: int = Field(2000, ge=1, description="number of the latest poses in the path")


@dataclass(frozen=True)
class RobotTopics:
    """Names of the topics, as they are after remapping."""

    image: str = "/image"
    depth: str = "/depth"
    camera_info: str = "/camera_info"
    odometry: str = "/odom"
    tf: str = "/tf"
    tf_static: str = "/tf_static"

    @property
    def types(self) -> dict[str, str]:
        """Type of the messages of each topic."""
        return {
            self.image: IMAGE,
            self.depth: IMAGE,
            self.camera_info: CAMERA_INFO,
            self.odometry: ODOMETRY,
            self.tf: TF,
            self.tf_static: TF,
        }


class MakeMessage(Protocol):
    """Creates a message of a type such as "geometry_msgs/msg/Point", with default values for missing fields."""

    def __call__(self, msgtype: str, /, **fields: Any) -> Any: ...


@dataclass(frozen=True, eq=False)
class RobotUpdate:
    """The result of localizing one view (an image that is far enough from the last view).

    Attributes:
        step: The belief of the tracker, the answer and errors. Its pose is that of the panorama.
        T_map_base: (4, 4) pose of the robot's base; None unless the status is `tracking`.
        pose: geometry_msgs/PoseWithCovarianceStamped of the base; None unless the status is `tracking`.
        path: nav_msgs/Path of the base; None unless the status is `tracking`.
        markers: visualization_msgs/MarkerArray of the matched objects of the map.
        status: std_msgs/String with the status.
    """

    step: TrackStep
    T_map_base: np.ndarray | None
    pose: Any
    path: Any
    markers: Any
    status: Any


class RobotTracker:
    """Tracks a robot. `receive` and `update` may be called by different threads, `update` by one at a time."""

    def __init__(
        self, map: LocalizationMap, settings: RobotSettings, make: MakeMessage, topics: RobotTopics | None = None
    ) -> None:
        self._map, self._settings, self._make = map, settings, make
        self._topics = topics or RobotTopics()
        self._messages = LiveMessages(self._topics.types)
        self._camera = TrackedCamera(map, settings.tracker, num_views=settings.num_views)
        self._spacing = ViewSpacing(1, 1, settings.view_distance_m, np.radians(settings.view_turn_deg))
        self._rig: BagRig | None = None
        self._T_odom_pano: np.ndarray | None = None  # of the last view
        self._T_map_odom: np.ndarray | None = None
        self._odom_frame = ""
        self._last_ns = 0
        self._path: deque[Any] = deque(maxlen=settings.max_path_poses)

    def receive(self, topic: str, message: Any, received_ns: int) -> None:
        """Store a message of one of the topics. This is fast."""
        self._messages.add(topic, message, received_ns)

    def update(self) -> RobotUpdate | None:
        """Localize the newest image that is a view; None if there is none.

        An image is a view if its odometry is known, and it is far enough from the last view.

        Raises:
            DataError: Messages are missing or invalid, such as an unknown encoding or a transform that is not in
                /tf_static. The message states what is missing.
        """
        rig = self._open_rig()
        tree = read_transforms(self._messages)
        odometry = odometry_source(self._messages, tree, self._topics.odometry)
        tolerance_s = self._settings.tolerance_s
        shots = [shot for shot in rig.find_shots()[0] if shot.stamp_ns > self._last_ns]
        for shot in reversed(shots):
            T_odom_frame = odometry.pose(rig.frame, shot.stamp_ns, tolerance_s)
            T_odom_base = None if odometry.odometry is None else odometry.odometry.pose(shot.stamp_ns, tolerance_s)
            if T_odom_frame is None or T_odom_base is None:
                continue
            record = rig.record(shot, T_odom_frame, self._settings.height)
            T_odom_pano = flat_pose(np.asarray(record.T_world_pano))
            if self._T_odom_pano is not None and not self._spacing.is_view(T_odom_pano, self._T_odom_pano):
                continue
            self._last_ns, self._odom_frame = shot.stamp_ns, odometry.world
            last, self._T_odom_pano = self._T_odom_pano, T_odom_pano
            motion = None if last is None else invert_pose(last) @ T_odom_pano
            step = self._camera.step(QueryFrame(record.id, record.load), motion)
            return self._describe(step, shot, T_odom_base)
        return None

    def map_to_odom(self, stamp: Any) -> Any:
        """Return the transform from the frame of odometry to the map at a time as geometry_msgs/TransformStamped.

        The transform is that of the last view with the status `tracking`; None before the first such view.

        Args:
            stamp: Time of the transform, builtin_interfaces/Time.
        """
        if self._T_map_odom is None:
            return None
        position, turn = self._numbers(self._T_map_odom)
        return self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(stamp, self._settings.map_frame),
            child_frame_id=self._odom_frame,
            transform=self._make(
                "geometry_msgs/msg/Transform",
                translation=self._make("geometry_msgs/msg/Vector3", **position),
                rotation=self._make("geometry_msgs/msg/Quaternion", **turn),
            ),
        )

    def _open_rig(self) -> BagRig:
        """Return the cameras, which are found once. Raises DataError while messages are missing."""
        settings, topics = self._settings, self._topics
        tree = read_transforms(self._messages)
        if self._rig is not None:
            return replace(self._rig, tree=tree)
        has_info = topics.camera_info in self._messages.types
        cameras = find_cameras(
            self._messages,
            topics.image,
            topics.depth if settings.has_depth else "none",
            topics.camera_info if has_info else None,
            settings.projection,
        )
        is_equirectangular = cameras[0].color.camera is None
        default = RangeKind.RAY if is_equirectangular else RangeKind.Z
        kind = default if settings.depth_kind is None else RangeKind(settings.depth_kind)
        if is_equirectangular and kind is RangeKind.Z:
            raise DataError("the parameter depth_kind is 'z', expected 'ray' or null for equirectangular images")
        rig = BagRig(self._messages, tuple(cameras), tree, settings.tolerance_s, settings.depth_unit_m, kind)
        odometry = odometry_source(self._messages, tree, topics.odometry)
        poses = [odometry.pose(rig.frame, shot.stamp_ns, settings.tolerance_s) for shot in rig.find_shots()[0]]
        known = [pose for pose in poses if pose is not None]
        if not known:
            raise DataError(
                f"no message of the topic {topics.odometry} is within {settings.tolerance_s:g} s of an image of the "
                f"topic {topics.image}: check that the stamps of both topics are from the same clock"
            )
        self._rig = rig.with_upright_axes(known[:1], settings.camera_axes)
        return self._rig

    def _describe(self, step: TrackStep, shot: BagShot, T_odom_base: np.ndarray) -> RobotUpdate:
        """Return the messages of a step."""
        stamp = self._make("builtin_interfaces/msg/Time", sec=shot.stamp_ns // 10**9, nanosec=shot.stamp_ns % 10**9)
        belief, T_map_base, pose, path = step.pose, None, None, None
        if belief.status is TrackStatus.TRACKING and belief.T_world_pano is not None:
            T_map_pano = flat_pose(belief.T_world_pano)
            self._T_map_odom = T_map_pano @ invert_pose(np.asarray(self._T_odom_pano))
            T_map_base = self._T_map_odom @ T_odom_base
            pose = self._pose_message(stamp, T_map_base, belief.covariance, T_map_base[:3, 3] - T_map_pano[:3, 3])
            header = self._header(stamp, self._settings.map_frame)
            self._path.append(self._make("geometry_msgs/msg/PoseStamped", header=header, pose=pose.pose.pose))
            path = self._make("nav_msgs/msg/Path", header=header, poses=list(self._path))
        status = self._make("std_msgs/msg/String", data=str(belief.status))
        return RobotUpdate(step, T_map_base, pose, path, self._markers(stamp, self._matched(step)), status)

    def _matched(self, step: TrackStep) -> list[MapObject]:
        """Return the matched objects of the map; none where they cannot be used."""
        if step.answer is None or step.description is None or step.pose.status is not TrackStatus.TRACKING:
            return []
        try:
            return list(find_matched_objects(self._map, step.description, step.answer).values())
        except FRAME_ERRORS:
            return []

    def _pose_message(
        self, stamp: Any, T_map_base: np.ndarray, covariance: np.ndarray | None, offset_m: np.ndarray
    ) -> Any:
        """Return the pose of the base, whose offset from the panorama is in the axes of the map.

        As in amcl, the variances of z, roll and pitch are 0, and those of an unknown covariance too.
        """
        matrix = np.zeros((6, 6))
        if covariance is not None:
            matrix[np.ix_(PLANAR, PLANAR)] = moved_covariance(covariance, offset_m)
        position, turn = self._numbers(T_map_base)
        pose = self._make(
            "geometry_msgs/msg/Pose",
            position=self._make("geometry_msgs/msg/Point", **position),
            orientation=self._make("geometry_msgs/msg/Quaternion", **turn),
        )
        return self._make(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header=self._header(stamp, self._settings.map_frame),
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=matrix.ravel()),
        )

    def _markers(self, stamp: Any, objects: Sequence[MapObject]) -> Any:
        """Return a sphere and a text for each object, after a marker that deletes the earlier ones."""
        header = self._header(stamp, self._settings.map_frame)
        markers = [self._make("visualization_msgs/msg/Marker", header=header, action=DELETE_ALL)]
        for number, thing in enumerate(objects):
            x, y, z = map(float, thing.xyz_m)
            for kind, size_m, lift_m, text in ((SPHERE, OBJECT_M, 0.0, ""), (TEXT, TEXT_M, 0.25, thing.label)):
                position = self._make("geometry_msgs/msg/Point", x=x, y=y, z=z + lift_m)
                turn = self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
                markers.append(
                    self._make(
                        "visualization_msgs/msg/Marker",
                        header=header,
                        ns="objects" if kind == SPHERE else "labels",
                        id=number,
                        type=kind,
                        action=ADD,
                        pose=self._make("geometry_msgs/msg/Pose", position=position, orientation=turn),
                        scale=self._make("geometry_msgs/msg/Vector3", x=size_m, y=size_m, z=size_m),
                        color=self._make("std_msgs/msg/ColorRGBA", r=0.12, g=0.31, b=0.63, a=1.0),
                        text=text,
                    )
                )
        return self._make("visualization_msgs/msg/MarkerArray", markers=markers)

    def _header(self, stamp: Any, frame: str) -> Any:
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    @staticmethod
    def _numbers(pose: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
        """Return position and quaternion of a pose (4, 4)."""
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
        return dict(zip("xyz", pose[:3, 3].tolist(), strict=True)), dict(zip("xyzw", turn.tolist(), strict=True))
