"""The format `rosbag`: recordings of ROS 1 and ROS 2 as panoramas, without ROS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas.geometry import invert_pose, pose_yaw
from salframe.panoramas.importer import Importer, PanoramaRecord, Recording
from salframe.panoramas.range_encoding import MILLIMETRE, RangeKind
from salframe_import.bag import ODOMETRY, Bag
from salframe_import.bag_cameras import BagCamera, Projection, find_cameras
from salframe_import.bag_poses import PoseSource, find_poses, odometry_source, read_transforms
from salframe_import.bag_rig import BagRig, BagShot, CameraAxes
from salframe_import.stations import StationSettings, group_by_motion, station_record, thinned
from salframe_import.view_selection import ViewSpacing, choose_views

MAX_DELAY_S = 0.25
"""Maximum difference in seconds between the delay of pictures and the delay of poses. A delay is the time from the
header stamp to the recording. A larger difference gives a warning."""
VIEWS = "views"
"""Name of the sequence that `read_views` returns."""


class RosBagImporter(Importer):
    """ROS 1 bags, ROS 2 bags and MCAP files: images and depth, with poses from odometry or tf."""

    name = "rosbag"
    version = "1"
    requires = ("rosbags",)
    extra = "salframe[ros]"

    class Config(StationSettings):
        image: str | None = Field(
            None,
            description="topics of the colour images, separated by commas, such as /left/image,/right/image; null: "
            "the only topic with colour images",
        )
        depth: str | None = Field(
            None,
            description="topics of the depth images, separated by commas, one for each topic of `image` in the same "
            "order. none: no depth is imported; null: the only depth topic, if there is one",
        )
        camera_info: str | None = Field(
            None,
            description="topics of the camera intrinsics (CameraInfo), separated by commas, one for each topic of "
            "`image` in the same order; null: the topic camera_info in the namespace of each image topic, if it exists",
        )
        projection: Projection = Field(
            "auto",
            description="projection of the images. auto: pinhole if the bag has intrinsics of the images, otherwise "
            "equirectangular; equirectangular: panoramas; pinhole: perspective images",
        )
        camera_axes: CameraAxes = Field(
            "auto",
            description="axes of the camera frame of equirectangular images. auto: the axes for which the images are "
            "upright; optical: x right, y down, z forward; body: x forward, y left, z up",
        )
        poses: str | None = Field(
            None,
            description="source of the poses: the name of an odometry topic, or `tf`; null: `tf` in any of three "
            "cases: tf has the frame `map`, `world` has a value, or the bag has no odometry topic. In all other cases, "
            "the only odometry topic",
        )
        world: str | None = Field(
            None,
            description="name of the tf frame in which poses are expressed; null: map, or the root of the tf tree "
            "if there is no frame map",
        )
        odometry: str | None = Field(
            None,
            description="odometry topic that measures the motion between the views of a query; null: the topic of "
            "`poses` if it is an odometry topic, otherwise the only odometry topic. A bag without odometry topics "
            "uses tf",
        )
        tolerance_s: float = Field(
            0.02,
            gt=0,
            le=1,
            description="maximum time difference (s) between the header stamps of messages that belong together, "
            "such as an image and its depth",
        )
        depth_unit_m: float = Field(
            MILLIMETRE,
            gt=0,
            description="length (m) of one unit of 16-bit depth images (0.001: the values are in millimetres)",
        )
        depth_kind: Literal["ray", "z", "cube"] | None = Field(
            None,
            description="quantity that the depth images contain. ray: distance along the ray; z: depth along the "
            "optical axis; cube: depth along the axis of the face, for equirectangular pictures that were stitched "
            "from the faces of a cube; null: z for pinhole "
            "images, ray for equirectangular images",
        )
        group_by: Literal["time", "motion"] = Field(
            "time",
            description="pinhole images that are stitched to one panorama. time: images of all cameras at the same "
            "time; motion: successive images of a camera that turns without moving away",
        )
        num_views: int = Field(
            0,
            ge=0,
            le=100,
            description="number of views (images) of each query. The views of a query are a short sequence of the "
            "recording; 0: there are no queries of several views",
        )
        sequence_period: int = Field(
            20,
            ge=2,
            description="number of successive views that form a group; must be larger than `num_views`. A view is an "
            "image at which the camera has moved by view_distance_m or turned by view_turn_deg since the previous "
            "view. The last `num_views` views of each group are a query, and the other images between these views are "
            "left out. All other images of the recording, views or not, are reference frames. Only used if "
            "num_views is over 0",
        )
        view_distance_m: float = Field(
            0.5,
            gt=0,
            description="distance (m) that the camera moves between two views of a query. A turn by view_turn_deg "
            "also starts a new view",
        )
        view_turn_deg: float = Field(
            45.0,
            gt=0,
            description="angle (degrees) that the camera turns between two views of a query. A motion by "
            "view_distance_m also starts a new view",
        )
        distribution: Literal["foxy", "galactic", "humble", "iron", "jazzy", "kilted"] = Field(
            "humble", description="ROS 2 distribution whose message definitions are used if the bag contains none"
        )

    def read(self, source: Path) -> Recording:
        self._check_settings()
        config = self.config
        bag, rig = self._open(source)
        poses = find_poses(bag, rig.tree, rig.frame, config.poses, config.world)
        shots, notes = rig.find_shots()
        odometries = bag.topics([ODOMETRY])
        if config.poses is None and poses.odometry is None and odometries:
            others = ", ".join(odometries)
            notes.insert(
                0, f"the poses are from {poses}; other poses are in {others}: to use them, pass --set poses=TOPIC"
            )
        posed, more = _posed(rig, shots, poses)
        notes += [*more, *_delay_notes(shots, poses), *rig.notes(*posed[0])]
        rig = rig.with_upright_axes([T for _, T in posed], config.camera_axes)
        if config.group_by == "motion":
            images = [image for shot, T in posed for image in rig.posed_images(shot, T)]
            groups, note = group_by_motion(images, config)
            notes += [note] if note else []
            stations = (
                station_record(id, thinned(group, config.min_step_deg), config.height, bag.files)
                for id, group in groups.items()
            )
            return Recording(tuple(stations), notes=tuple(notes))
        records = [rig.record(shot, T, config.height, bag.files) for shot, T in posed]
        if not config.num_views:
            return Recording(tuple(records), notes=tuple(notes))
        motion = self._motion(bag, poses)
        sequenced, left_out = self._with_sequences(records)
        odometry = _odometry_rows(rig, motion, [(*shot, record) for shot, record in zip(posed, sequenced, strict=True)])
        remaining = tuple(record for number, record in enumerate(sequenced) if number not in left_out)
        return Recording(remaining, odometry, notes=tuple(notes))

    def read_views(self, source: Path) -> Recording:
        """Return the views of the recording as one sequence.

        A view is taken whenever the odometry has moved by `view_distance_m` or turned by `view_turn_deg`. The true
        poses of the views come from the setting `poses`. They are unknown if this source is the odometry itself.
        """
        if self.config.group_by == "motion":
            raise ConfigError(
                "the setting group_by is 'motion', expected 'time' for a sequence of views: set group_by=time"
            )
        bag, rig = self._open(source)
        poses = find_poses(bag, rig.tree, rig.frame, self.config.poses, self.config.world)
        motion = self._motion(bag, poses)
        shots, notes = rig.find_shots()
        posed, more = _posed(rig, shots, motion)
        notes += [*more, *_delay_notes(shots, motion), *rig.notes(*posed[0])]
        rig = rig.with_upright_axes([T for _, T in posed], self.config.camera_axes)
        records = [rig.record(shot, T, self.config.height, bag.files) for shot, T in posed]
        chosen = self._spacing.steps([record.T_world_pano for record in records if record.T_world_pano is not None])
        views, rows = [], []
        for number in chosen:
            (shot, T_motion_frame), record = posed[number], records[number]
            T_motion_pano = np.asarray(record.T_world_pano)
            truth = None if poses is motion else poses.pose(rig.frame, shot.stamp_ns, rig.tolerance_s)
            if truth is not None:
                truth = truth @ invert_pose(T_motion_frame) @ T_motion_pano
            views.append(replace(record, T_world_pano=truth, is_query=True, sequence=VIEWS))
            rows.append(_odometry_row(shot, T_motion_pano))
        return Recording(tuple(views), np.array(rows, np.float64), notes=tuple(notes))

    def _open(self, source: Path) -> tuple[Bag, BagRig]:
        """Return a bag and its cameras. The axes of the cameras are set to optical until they are checked."""
        config = self.config
        bag = Bag(source, config.distribution)
        cameras = find_cameras(bag, config.image, config.depth, config.camera_info, config.projection)
        tree, kind = read_transforms(bag), self._kind(cameras)
        return bag, BagRig(bag, tuple(cameras), tree, config.tolerance_s, config.depth_unit_m, kind)

    @property
    def _spacing(self) -> ViewSpacing:
        config = self.config
        return ViewSpacing(
            config.num_views, config.sequence_period, config.view_distance_m, np.radians(config.view_turn_deg)
        )

    def _check_settings(self) -> None:
        """Raise ConfigError if two settings contradict each other."""
        config = self.config
        if config.num_views and config.group_by == "motion":
            raise ConfigError(
                f"the setting num_views is {config.num_views} with group_by=motion, expected 0: set num_views=0, or "
                "set group_by=time to make sequences of views"
            )
        if config.num_views >= config.sequence_period:
            raise ConfigError(
                f"the setting num_views is {config.num_views}, expected less than {config.sequence_period}, the value "
                "of sequence_period"
            )

    def _kind(self, cameras: Sequence[BagCamera]) -> RangeKind:
        """Return the quantity in the depth images. Raises ConfigError if it does not apply to the projection."""
        is_equirectangular = any(camera.color.camera is None for camera in cameras)
        if is_equirectangular and len(cameras) > 1:
            raise ConfigError(
                f"the setting image has {len(cameras)} topics, one of them equirectangular, expected only the "
                "equirectangular topic"
            )
        if is_equirectangular and self.config.group_by == "motion":
            raise ConfigError(
                "the setting group_by is 'motion', expected 'time' for equirectangular images: set group_by=time"
            )
        kinds = [RangeKind.RAY, RangeKind.CUBE] if is_equirectangular else [RangeKind.Z, RangeKind.RAY]
        kind = kinds[0] if self.config.depth_kind is None else RangeKind(self.config.depth_kind)
        if kind not in kinds:
            projection = "equirectangular" if is_equirectangular else "pinhole"
            raise ConfigError(
                f"the setting depth_kind is {str(kind)!r}, expected {' or '.join(kinds)} for {projection} images"
            )
        return kind

    def _motion(self, bag: Bag, poses: PoseSource) -> PoseSource:
        """Return the source of the motion between views: odometry if the bag has it, otherwise `poses`."""
        topic = self.config.odometry
        if topic is None and poses.odometry is not None:
            return poses
        if topic is None and not bag.topics([ODOMETRY]):
            return poses
        return odometry_source(bag, poses.tree, bag.choose("odometry", topic, [ODOMETRY]))

    def _with_sequences(self, records: Sequence[PanoramaRecord]) -> tuple[list[PanoramaRecord], set[int]]:
        """Mark the records that are views of sequences.

        Returns:
            The records, and the indices of the records that lie between the views of a sequence.

        Raises:
            DataError: The recording has too few views for a sequence.
        """
        config = self.config
        spacing = self._spacing
        sequences = choose_views(
            [record.T_world_pano for record in records if record.T_world_pano is not None], spacing
        )
        if not sequences:
            raise DataError(
                f"the recording has too few views for a sequence, expected {spacing.period} views that are "
                f"{spacing.distance_m:g} m or {config.view_turn_deg:g} deg apart: decrease sequence_period, "
                "view_distance_m or view_turn_deg"
            )
        chosen, between = list(records), set[int]()
        for number, views in enumerate(sequences, 1):
            between |= set(range(views[0], views[-1])) - set(views)
            for view in views:
                chosen[view] = replace(records[view], is_query=True, sequence=f"sequence-{number:03d}")
        return chosen, between


def _posed(
    rig: BagRig, shots: Sequence[BagShot], poses: PoseSource
) -> tuple[list[tuple[BagShot, np.ndarray]], list[str]]:
    """Return the shots that have a pose, and notes about the others.

    Returns:
        Pairs of a shot and the pose (4, 4) of the frame of the first camera, at least one; and at most one note.

    Raises:
        DataError: No shot has a pose.
    """
    posed = [(shot, T) for shot in shots if (T := poses.pose(rig.frame, shot.stamp_ns, rig.tolerance_s)) is not None]
    if not posed:
        raise DataError(
            f"none of the {len(shots)} pictures of {rig.bag.path} has a pose from {poses} within "
            f"{rig.tolerance_s:g} s: check that the header stamps are from the same clock"
        )
    missing = len(shots) - len(posed)
    note = f"{missing} of {len(shots)} pictures are left out: no pose at the time of the picture"
    return posed, [note] if missing else []


def _delay_notes(shots: Sequence[BagShot], poses: PoseSource) -> list[str]:
    """Return a warning if the header stamps of pictures and poses seem to come from different clocks."""
    delay_s = float(np.median([log_ns - stamp_ns for shot in shots for stamp_ns, log_ns in shot.colors[:1]])) / 1e9
    if abs(delay_s - poses.delay_s) <= MAX_DELAY_S:
        return []
    return [
        f"the delay from header stamp to recording is {delay_s:.2f} s for the pictures and {poses.delay_s:.2f} s for "
        f"the poses from {poses}, expected a difference of at most {MAX_DELAY_S:g} s: check that both stamps are from "
        "the same clock"
    ]


def _odometry_rows(
    rig: BagRig, motion: PoseSource, shots: Sequence[tuple[BagShot, np.ndarray, PanoramaRecord]]
) -> np.ndarray:
    """Return the poses of the views of sequences by the odometry, (N, 5): t_s, x_m, y_m, z_m, yaw_deg.

    Args:
        rig: The cameras.
        motion: The odometry.
        shots: Each shot with T_world_frame and its record.
    """
    rows = []
    for shot, T_world_frame, record in shots:
        T_motion_frame = motion.pose(rig.frame, shot.stamp_ns, rig.tolerance_s)
        if record.sequence is not None and record.T_world_pano is not None and T_motion_frame is not None:
            pose = T_motion_frame @ invert_pose(T_world_frame) @ record.T_world_pano
            rows.append(_odometry_row(shot, pose))
    return np.array(rows, np.float64).reshape(-1, 5)


def _odometry_row(shot: BagShot, T_motion_pano: np.ndarray) -> list[float]:
    return [shot.stamp_ns / 1e9, *T_motion_pano[:3, 3], np.degrees(pose_yaw(T_motion_pano))]
