"""A walk of a robot with a camera, as a folder of panoramas, as a ROS bag, as messages and as HTTP requests."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from salframe.localization.map import LocalizationMap
from salframe.panoramas.folder_format import FrameEntry, TruthEntry, write_manifest, write_panorama
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_encoding import RangeEncoding

IMAGE, DEPTH, INFO, ODOM = "/camera/image", "/camera/depth", "/camera/camera_info", "/odom"
T_BASE_PANO = pose_2d(0.3, -0.1, 0.0, 1.2)
"""Pose of the camera on the robot."""
OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""Quaternion (x, y, z, w) of the optical frame of a camera that looks ahead, by REP-103."""
START_S = 1_700_000_000
"""Time of the first view in bags and messages."""


@dataclass
class RecordedWalk:
    """Views, one each second, with true poses and poses by odometry that drifts, of the panorama."""

    views: Sequence[Panorama]
    truth: Sequence[np.ndarray]
    odometry: Sequence[np.ndarray]

    @classmethod
    def of(cls, views: Sequence[Panorama], truth: Sequence[np.ndarray]) -> RecordedWalk:
        """A walk whose odometry measures 2 % too much and 0.5 degrees more in each step, from another origin."""
        odometry = [pose_2d(5.0, -2.0, 1.0, truth[0][2, 3])]
        for before, pose in pairwise(truth):
            motion = invert_pose(before) @ pose
            x, y = 1.02 * motion[:2, 3]
            odometry.append(odometry[-1] @ pose_2d(x, y, pose_yaw(motion) + np.radians(0.5)))
        return cls(views, truth, odometry)

    @property
    def depths_mm(self) -> list[np.ndarray]:
        """Range of each view in whole millimetres, 0 where it is unknown."""
        return [RangeEncoding().panorama_steps(view.range_m) for view in self.views]

    def write_folder(self, root: Path) -> Path:
        """Write a folder of panoramas with a sequence and the truth of all views."""
        entries, truth, rows = [self._reference(root)], {}, ["t_s,x_m,y_m,z_m,yaw_deg"]
        for number, (view, pose) in enumerate(zip(self.views, self.odometry, strict=True)):
            files = {"rgb": f"frames/{number}.png", "range": f"frames/{number}.range.png"}
            entry = FrameEntry(id=f"view-{number}", role="query", sequence="walk", t_s=float(number), **files)
            write_panorama(root, entry, view.rgb, view.range_m)
            entries.append(entry)
            true_pose = tuple(self.truth[number].ravel().tolist())
            truth[entry.id] = TruthEntry(place="somewhere", pose=true_pose)
            numbers = [number, *pose[:3, 3].tolist(), float(np.degrees(pose_yaw(pose)))]
            rows.append(",".join(map(repr, numbers)))
        (root / "odometry.csv").write_text("\n".join(rows) + "\n")
        write_manifest(root, entries, truth, odometry="odometry.csv")
        return root

    def _reference(self, root: Path) -> FrameEntry:
        """Write the reference frame that every folder needs."""
        pose = tuple(self.truth[0].ravel().tolist())
        entry = FrameEntry(id="start", role="map", rgb="frames/start.png", place="somewhere", pose=pose)
        write_panorama(root, entry, self.views[0].rgb)
        return entry

    def write_bag(self, path: Path, *, truth: bool = False) -> Path:
        """Write a ROS 2 bag. truth: whether /tf has the true pose of the frame of odometry in `map`."""
        from bag_writer import BagWriter

        with BagWriter(path) as writer:
            writer.transform("/tf_static", 0.0, "base_link", "camera_optical", T_BASE_PANO[:3, 3], OPTICAL)
            rows = zip(self.views, self.depths_mm, self.truth, self.odometry, strict=True)
            for number, (view, depth, true_pose, pose) in enumerate(rows):
                T_odom_base = pose @ invert_pose(T_BASE_PANO)
                turn = Rotation.from_matrix(T_odom_base[:3, :3]).as_quat()
                writer.odometry(ODOM, number, "odom", "base_link", T_odom_base[:3, 3], turn)
                T_map_odom = true_pose @ invert_pose(pose)
                if truth:
                    turn = Rotation.from_matrix(T_map_odom[:3, :3]).as_quat()
                    writer.transform("/tf", number, "map", "odom", T_map_odom[:3, 3], turn)
                    turn = Rotation.from_matrix(T_odom_base[:3, :3]).as_quat()
                    writer.transform("/tf", number, "odom", "base_link", T_odom_base[:3, 3], turn)
                writer.image(IMAGE, number, "camera_optical", view.rgb, "rgb8")
                writer.image(DEPTH, number, "camera_optical", depth, "16UC1")
        return path

    def observe(self, client: httpx.Client) -> list[dict[str, Any]]:
        """Send the views to a session of a service, and return its beliefs."""
        session = client.post("/sessions").raise_for_status().json()["id"]
        beliefs = []
        for number, (view, depth) in enumerate(zip(self.views, self.depths_mm, strict=True)):
            data: dict[str, Any] = {"t_s": number}
            if number:
                motion = invert_pose(self.odometry[number - 1]) @ self.odometry[number]
                x, y, z = motion[:3, 3].tolist()
                sent = {"x_m": x, "y_m": y, "z_m": z, "yaw_deg": float(np.degrees(pose_yaw(motion)))}
                data["odometry"] = json.dumps(sent)
            files = {"image": png(view.rgb[..., ::-1]), "range": png(depth)}
            uploads = {name: (f"{name}.png", io.BytesIO(content), "image/png") for name, content in files.items()}
            answer = client.post(f"/sessions/{session}/observations", files=uploads, data=data)
            beliefs.append(answer.raise_for_status().json()["belief"])
        return beliefs


def png(pixels: np.ndarray) -> bytes:
    """Pixels as OpenCV orders them, as PNG."""
    return cv2.imencode(".png", pixels)[1].tobytes()


class RosMessages:
    """Creates messages of rosbags, with the default values of ROS for missing fields, and checks their types."""

    def __init__(self) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)

    def __call__(self, msgtype: str, /, **fields: Any) -> Any:
        known = dict(self._store.fielddefs[msgtype][1])
        assert fields.keys() <= known.keys(), msgtype
        values = {name: fields[name] if name in fields else self._default(kind) for name, kind in known.items()}
        return self._store.types[msgtype](**values)

    def serialized(self, message: Any) -> Any:
        """Return a message after it was written and read, as another node receives it."""
        name = message.__msgtype__
        return self._store.deserialize_cdr(self._store.serialize_cdr(message, name), name)

    def _default(self, kind: Any) -> Any:
        node, content = int(kind[0]), kind[1]
        if node == 2:
            return self(content)
        if node == 1:
            return {"string": "", "bool": False}.get(content[0], 0.0 if content[0].startswith("float") else 0)
        inner = content[0]
        if int(inner[0]) == 1 and inner[1][0] != "string":
            return np.zeros(content[1] if node == 3 else 0, np.dtype(inner[1][0]))
        return []


def replay(
    map: LocalizationMap, bag: Path, settings: Any, *, topics: Any = None, tracked: Any = None
) -> tuple[list[Any], Any]:
    """Give the messages of a bag to a `RobotTracker` in their order. Returns its updates, and the tracker."""
    from rosbags.highlevel import AnyReader
    from salframe_ros2.robot_tracker import RobotTopics, RobotTracker

    from salframe.framework.errors import DataError

    topics = topics or RobotTopics(IMAGE, DEPTH, INFO, ODOM)
    tracked = tracked or RobotTracker(map, settings, RosMessages(), topics)
    updates = []
    with AnyReader([bag]) as reader:
        for connection, log_ns, raw in reader.messages():
            tracked.receive(connection.topic, reader.deserialize(raw, connection.msgtype), log_ns)
            try:
                update = tracked.update()
            except DataError:  # messages are missing
                continue
            if update is not None:
                updates.append(update)
    return updates, tracked
