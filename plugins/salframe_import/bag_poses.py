"""Poses of ROS bags over time: odometry, and the tree of /tf and /tf_static."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.geometry import invert_pose
from salframe_import.bag import ODOMETRY, TF_TYPES, MessageStore

MAX_GAP_S = 1.0
"""Maximum time in seconds between two poses between which a pose is interpolated."""
MAX_NORM_ERROR = 0.01
"""Maximum difference between the length of a quaternion and 1."""
MAP, TF_SOURCE = "map", "tf"
"""Name of the map frame by REP-105, and the name that selects /tf as the source of poses."""
MAX_DEPTH = 100
"""Maximum number of transforms from a frame to the root of the tree. A longer chain is reported as a loop."""


class StampedPose(NamedTuple):
    """A pose of a message.

    Attributes:
        stamp_ns: Header stamp in nanoseconds.
        log_ns: Recording time in nanoseconds.
        numbers: Position x, y, z, then quaternion x, y, z, w.
    """

    stamp_ns: int
    log_ns: int
    numbers: list[float]


@dataclass
class PoseTrack:
    """The pose of a child frame in its parent frame over time.

    Attributes:
        parent: Name of the parent frame.
        child: Name of the child frame.
        stamp_ns: (N,) int64 header stamps, increasing.
        position_m: (N, 3) float64 positions in metres.
        quaternion_xyzw: (N, 4) float64 unit quaternions.
        is_static: Whether the track has a single pose that holds at all times.
        delay_s: Median time from the header stamp to the recording, in seconds.
    """

    parent: str
    child: str
    stamp_ns: np.ndarray
    position_m: np.ndarray
    quaternion_xyzw: np.ndarray
    is_static: bool = False
    delay_s: float = 0.0

    @classmethod
    def of_rows(cls, parent: str, child: str, rows: Sequence[StampedPose], *, is_static: bool = False) -> PoseTrack:
        """Create a track.

        Args:
            parent: Name of the parent frame.
            child: Name of the child frame.
            rows: The poses in any order. The last of several poses with the same stamp is used.
            is_static: Whether the last pose holds at all times.

        Raises:
            DataError: A number is not finite, or a quaternion is not of unit length.
        """
        latest = {row.stamp_ns: row.numbers for row in rows}
        stamps = sorted(latest) if not is_static else [rows[-1].stamp_ns]
        values = np.array([latest[stamp] for stamp in stamps], np.float64)
        norms = np.linalg.norm(values[:, 3:], axis=1)
        is_wrong = ~(np.isfinite(values).all(axis=1) & (np.abs(norms - 1) <= MAX_NORM_ERROR))
        if is_wrong.any():
            first = int(is_wrong.argmax())
            raise DataError(
                f"the transform from {child} to {parent} at {stamps[first] / 1e9:.3f} s has the quaternion (x, y, z, "
                f"w) {values[first, 3:].tolist()} and the translation {values[first, :3].tolist()}, expected finite "
                "numbers and a quaternion of length 1"
            )
        quaternions = values[:, 3:] / norms[:, None]
        delay_s = float(np.median([row.log_ns - row.stamp_ns for row in rows])) / 1e9
        return cls(parent, child, np.array(stamps, np.int64), values[:, :3], quaternions, is_static, delay_s)

    def pose(self, stamp_ns: int, tolerance_s: float) -> np.ndarray | None:
        """Return the pose (4, 4) at a time, interpolated between the poses before and after it.

        None if these two poses are more than MAX_GAP_S apart, or if the time is more than `tolerance_s` before the
        first or after the last pose.
        """
        from scipy.spatial.transform import Rotation

        after = int(np.searchsorted(self.stamp_ns, stamp_ns))
        before = max(after - 1, 0)
        after = min(after, len(self.stamp_ns) - 1)
        first, last = int(self.stamp_ns[before]), int(self.stamp_ns[after])
        if self.is_static:
            share = 0.0
        elif not first <= stamp_ns <= last:
            nearest = first if stamp_ns < first else last
            if abs(stamp_ns - nearest) > tolerance_s * 1e9:
                return None
            share = float(nearest == last)
        elif stamp_ns in (first, last):
            share = float(stamp_ns == last)
        elif last - first > MAX_GAP_S * 1e9:
            return None
        else:
            share = (stamp_ns - first) / (last - first)
        start, end = Rotation.from_quat(self.quaternion_xyzw[[before, after]])
        pose = np.eye(4)
        pose[:3, :3] = (start * Rotation.from_rotvec(share * (start.inv() * end).as_rotvec())).as_matrix()
        pose[:3, 3] = (1 - share) * self.position_m[before] + share * self.position_m[after]
        return pose


@dataclass
class TransformTree:
    """The transforms of /tf and /tf_static, by child frame."""

    tracks: dict[str, PoseTrack] = field(default_factory=dict)

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted({name for track in self.tracks.values() for name in (track.parent, track.child)})

    def root(self, frame: str) -> str:
        """Return the root of the tree above a frame. Raises DataError if the transforms form a loop."""
        return self.chain(frame)[-1].parent if frame in self.tracks else frame

    def pose(self, target: str, source: str, stamp_ns: int, tolerance_s: float) -> np.ndarray | None:
        """Return T_target_source (4, 4) at a time; None if a transform has no pose at this time.

        Raises:
            DataError: The frames are not connected, or the transforms form a loop.
        """
        up, down = self.chain(source), self.chain(target)
        while up and down and up[-1] is down[-1]:  # shared above both frames
            up.pop()
            down.pop()
        above = up[-1].parent if up else source
        if above != (down[-1].parent if down else target):
            raise DataError(
                f"/tf and /tf_static do not connect the frames {source} and {target}, expected a transform from each "
                f"to a common frame; the bag has the frames {', '.join(self.frames) or 'none'}"
            )
        T_above = []
        for chain in (down, up):
            T = np.eye(4)
            for track in chain:
                pose = track.pose(stamp_ns, tolerance_s)
                if pose is None:
                    return None
                T = pose @ T
            T_above.append(T)
        return invert_pose(T_above[0]) @ T_above[1]

    def chain(self, frame: str) -> list[PoseTrack]:
        """Return the transforms from a frame up to the root. Raises DataError if they form a loop."""
        chain: list[PoseTrack] = []
        while frame in self.tracks:
            chain.append(self.tracks[frame])
            frame = chain[-1].parent
            if len(chain) > MAX_DEPTH:
                raise DataError(f"/tf and /tf_static have a loop at the frame {frame}, expected a tree")
        return chain


def read_transforms(bag: MessageStore) -> TransformTree:
    """Read /tf and /tf_static of a bag, of any namespace. Raises DataError if a transform is invalid."""
    rows: dict[str, list[StampedPose]] = {}
    parents: dict[str, str] = {}
    static: set[str] = set()
    for topic, message in bag.messages(bag.topics(TF_TYPES)):
        for transform in message.content.transforms:
            child = frame_name(transform.child_frame_id)
            parents[child] = frame_name(transform.header.frame_id)
            if topic.endswith("tf_static"):
                static.add(child)
            stamp = transform.header.stamp
            numbers = _numbers(transform.transform.translation, transform.transform.rotation)
            row = StampedPose(stamp.sec * 10**9 + stamp.nanosec, message.log_ns, numbers)
            rows.setdefault(child, []).append(row)
    return TransformTree(
        {child: PoseTrack.of_rows(parents[child], child, rows[child], is_static=child in static) for child in rows}
    )


def read_odometry(bag: MessageStore, topic: str) -> PoseTrack:
    """Read the poses of an odometry topic. Raises DataError if it is empty or a pose is invalid."""
    rows, names = [], set()
    for _, message in bag.messages([topic]):
        odometry = message.content
        names.add((frame_name(odometry.header.frame_id), frame_name(odometry.child_frame_id)))
        numbers = _numbers(odometry.pose.pose.position, odometry.pose.pose.orientation)
        rows.append(StampedPose(message.stamp_ns, message.log_ns, numbers))
    if len(names) != 1:
        received = f"{len(names)} pairs of frames" if names else "no message"
        raise DataError(
            f"the topic {topic} of {bag.path} has {received}, expected the same frame_id and child_frame_id in all "
            "messages"
        )
    parent, child = names.pop()
    if not child:
        raise DataError(f"the topic {topic} of {bag.path} has no child_frame_id, expected the frame of the robot")
    return PoseTrack.of_rows(parent, child, rows)


@dataclass(frozen=True, eq=False)
class PoseSource:
    """Source of the poses of a recording: an odometry topic with the tree of transforms, or the tree alone.

    Attributes:
        tree: The transforms of the bag.
        world: Name of the frame in which the poses are expressed.
        odometry: The odometry; None if the poses come from the tree alone.
        topic: Name of the odometry topic; "tf" if the poses come from the tree alone.
    """

    tree: TransformTree
    world: str
    odometry: PoseTrack | None = None
    topic: str = TF_SOURCE

    def __str__(self) -> str:
        return f"{self.topic}, in the frame {self.world}"

    @property
    def delay_s(self) -> float:
        """Median time from the header stamp of a pose to its recording, in seconds."""
        moving = [track.delay_s for track in self.tree.tracks.values() if not track.is_static]
        if self.odometry is not None:
            return self.odometry.delay_s
        return float(np.median(moving)) if moving else 0.0

    def pose(self, frame: str, stamp_ns: int, tolerance_s: float) -> np.ndarray | None:
        """Return T_world_frame (4, 4) at a time; None if it is unknown.

        Raises:
            DataError: The transforms do not connect the frames.
        """
        if self.odometry is None:
            return self.tree.pose(self.world, frame, stamp_ns, tolerance_s)
        T_world_child = self.odometry.pose(stamp_ns, tolerance_s)
        T_child_frame = self.tree.pose(self.odometry.child, frame, stamp_ns, tolerance_s)
        return None if T_world_child is None or T_child_frame is None else T_world_child @ T_child_frame


def find_poses(bag: MessageStore, tree: TransformTree, frame: str, topic: str | None, world: str | None) -> PoseSource:
    """Return the source of the poses of a frame.

    Args:
        bag: The bag.
        tree: The transforms of the bag.
        frame: Name of the frame of the camera.
        topic: Odometry topic, or TF_SOURCE. None: TF_SOURCE if `world` is not None, if the tree has the frame MAP above
            the camera, or if the bag has no odometry; otherwise the only odometry topic.
        world: Frame in which the poses of the tree are expressed; None: MAP if it is above the camera, otherwise the
            root above the camera.

    Raises:
        DataError: The bag has no such topic or frame, no pose over time, or several topics of odometry.
    """
    above = {track.parent for track in tree.chain(frame)}
    if topic is None and not (world is not None or MAP in above) and bag.topics([ODOMETRY]):
        topic = bag.choose("poses", None, [ODOMETRY])
    if topic not in (None, TF_SOURCE):
        if world is not None:
            raise DataError(
                f"the setting `world` is {world!r}, but the poses are from the topic {topic}, which has its own world "
                f"frame: remove `world`, or set poses={TF_SOURCE}"
            )
        return odometry_source(bag, tree, bag.choose("poses", topic, [ODOMETRY]))
    world = world or (MAP if MAP in above else tree.root(frame))
    if world not in tree.frames:
        raise DataError(
            f"{bag.path} has no frame {world} in /tf and /tf_static, expected one of its frames: "
            f"{', '.join(tree.frames) or 'none'}"
        )
    if all(track.is_static for track in tree.chain(frame)):
        raise DataError(
            f"{bag.path} has no poses of the camera over time, expected a topic of the type {ODOMETRY}, or transforms "
            f"in /tf that move the frame {frame}; the bag has the frames {', '.join(tree.frames) or 'none'}"
        )
    return PoseSource(tree, world)


def odometry_source(bag: MessageStore, tree: TransformTree, topic: str) -> PoseSource:
    """Return an odometry topic as a source of poses. Raises DataError if it is empty or a pose is invalid."""
    odometry = read_odometry(bag, topic)
    return PoseSource(tree, odometry.parent, odometry, topic)


def frame_name(name: str) -> str:
    """Return the name of a frame without the leading slash that tf 1 allowed."""
    return name.lstrip("/")


def _numbers(position: Any, quaternion: Any) -> list[float]:
    return [position.x, position.y, position.z, quaternion.x, quaternion.y, quaternion.z, quaternion.w]
