"""Track a moving camera in a map: localize its latest views together, and update a tracker with the answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.framework.errors import FRAME_ERRORS, ConfigError
from salframe.framework.files.writing import write_json, write_text
from salframe.localization.answers import Localization
from salframe.localization.described_query import DescribedView, describe_view
from salframe.localization.localizer import Description
from salframe.localization.map import LocalizationMap
from salframe.localization.place_lookup import PlaceLookup
from salframe.localization.query_input import query_frame
from salframe.localization.tracker import TrackedPose, Tracker, TrackStatus
from salframe.localization.trajectory import tum_lines
from salframe.panoramas.camera_sequence import CameraSequence, read_sequence
from salframe.panoramas.floors import MIN_STOREY_GAP_M
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import invert_pose, pose_yaw
from salframe.panoramas.panorama import Panorama

NUM_VIEWS = 5
"""Default number of the latest views that are localized together. Chosen on `house-42`, seeds 100 and 101."""

MOTION_DECIMALS = 12
"""Number of decimals to which motions between views are rounded. A motion from a ROS bag and the same motion from an
HTTP request may differ by rounding errors; after rounding to this number of decimals, they are equal. Joining views can
amplify a rounding error of 1e-16 m to 1e-5 m."""


def open_tracker(map: LocalizationMap, tracker: ComponentConfig | str | None = None) -> Tracker:
    """Return a new tracker of a camera in a map.

    Args:
        map: The map.
        tracker: Name or configuration of the tracker; None: the default tracker.

    Raises:
        UnknownName: There is no tracker of this name.
    """
    if tracker is None or isinstance(tracker, str):
        tracker = configure_default(Tracker.role, tracker or default_of(Tracker.role))
    opened: Tracker = registry().build(Tracker.role, tracker)
    opened.find_place = PlaceLookup(map.floors, map.frames).at
    return opened


class ViewWindow:
    """The latest views of a camera, which are localized together."""

    def __init__(self, map: LocalizationMap, num_views: int) -> None:
        """Create an empty window.

        Args:
            map: The map.
            num_views: Maximum number of views, at least 1.
        """
        if num_views < 1:
            raise ConfigError(f"num_views is {num_views}, expected at least 1")
        self._map, self._num_views = map, num_views
        self._views: list[tuple[DescribedView, np.ndarray]] = []

    def move(self, odometry: np.ndarray | None) -> None:
        """Update the window by a motion, as in `Tracker.move`. An unknown motion (None) removes all views,
        and a motion to another storey removes the views from the storey before."""
        if odometry is None:
            self._views = []
            return
        back = invert_pose(np.round(odometry, MOTION_DECIMALS))
        moved = [(view, back @ T_present_view) for view, T_present_view in self._views]
        self._views = [(view, pose) for view, pose in moved if abs(pose[2, 3]) < MIN_STOREY_GAP_M]

    def localize(self, view: DescribedView) -> Localization:
        """Add a view, and localize all views of the window together.

        Raises:
            InvalidAnswer: As `LocalizationMap.answer_query`.
            DataError: As `LocalizationMap.answer_query`.
        """
        self._views = [*self._views, (view, np.eye(4))][-self._num_views :]
        views, motions = zip(*self._views, strict=True)
        return self._map.answer_query(self._map.describe_query(views, np.stack(motions)))


@dataclass(frozen=True, eq=False)
class TrackStep:
    """A step of a tracked camera.

    Attributes:
        pose: The belief (estimated pose and status) after the step.
        answer: The answer to the latest views; None if the view could not be used.
        error: The reason why the view could not be used; None if it was used.
        description: The description of the view; None if the view could not be used.
    """

    pose: TrackedPose
    answer: Localization | None = None
    error: str | None = None
    description: Description | None = None


class TrackedCamera:
    """A moving camera that is tracked in a map."""

    def __init__(
        self, map: LocalizationMap, tracker: ComponentConfig | str | None = None, *, num_views: int = NUM_VIEWS
    ) -> None:
        """Create a camera whose pose is unknown.

        Args:
            map: The map.
            tracker: As in `open_tracker`.
            num_views: Number of the latest views that are localized together.

        Raises:
            ConfigError: `num_views` is less than 1.
            UnknownName: As `open_tracker`.
        """
        self._map, self._tracker = map, open_tracker(map, tracker)
        self._window = ViewWindow(map, num_views)

    def step(self, view: Panorama | QueryFrame, odometry: np.ndarray | None = None) -> TrackStep:
        """Move the camera, localize its view, and return the belief (estimated pose and status).

        If the view cannot be used, the belief is updated only by the motion.

        Args:
            view: The panorama at the present pose.
            odometry: (4, 4) motion since the last step: the present pose of the camera, in the camera frame of the last
                step. None if it is unknown, and in the first step.

        Raises:
            DataError: The motion is not rigid.
        """
        self._tracker.move(odometry)
        self._window.move(odometry)
        try:
            described = describe_view(self._map.localizer, query_frame(self._map.localizer, view))
        except FRAME_ERRORS as error:
            return TrackStep(self._tracker.belief(), error=str(error))
        answer = self._window.localize(described)
        self._tracker.observe(answer)
        return TrackStep(self._tracker.belief(), answer, description=described.description)


@dataclass(frozen=True, eq=False)
class Track:
    """The track of a camera.

    Attributes:
        name: Name of the sequence.
        t_s: (N,) float64 times in seconds.
        frames: Ids of the N frames.
        steps: The N steps.
    """

    name: str
    t_s: np.ndarray
    frames: tuple[str, ...]
    steps: tuple[TrackStep, ...]

    @property
    def is_tracking(self) -> np.ndarray:
        """Whether the status of each step is `tracking`, (N,) bool."""
        return np.array([step.pose.status is TrackStatus.TRACKING for step in self.steps], bool)

    def to_tum(self) -> str:
        """Return the trajectory in the format of the TUM RGB-D benchmark: lines `t_s x y z qx qy qz qw`, in metres.

        Only steps with the status `tracking` are written. A comment at the start states the number of other steps.
        """
        poses = [
            (float(t_s), step.pose.T_world_pano)
            for t_s, step in zip(self.t_s, self.steps, strict=True)
            if step.pose.status is TrackStatus.TRACKING and step.pose.T_world_pano is not None
        ]
        return tum_lines(poses, [f"{self.name}; {(~self.is_tracking).sum()} steps are not tracked"])

    def to_json(self) -> dict[str, Any]:
        """Return the track as JSON, with all steps."""
        rows = zip(self.t_s.tolist(), self.frames, self.steps, strict=True)
        return {"sequence": self.name, "steps": [_step_json(t_s, frame, step) for t_s, frame, step in rows]}

    def __str__(self) -> str:
        """A line for each step: time, status, place and pose, and the reason if the frame could not be used."""
        lines = []
        for t_s, frame, step in zip(self.t_s, self.frames, self.steps, strict=True):
            pose = step.pose.T_world_pano
            where = ""
            if pose is not None:
                x, y = pose[:2, 3]
                where = f"  {step.pose.place}  x {x:.2f} m, y {y:.2f} m, yaw {np.degrees(pose_yaw(pose)):.1f} deg"
            error = f"  ({frame} cannot be used: {step.error})" if step.error else ""
            lines.append(f"{t_s:.13g} s  {step.pose.status}{where}{error}")
        return "\n".join(lines)

    def write(self, folder: str | Path) -> None:
        """Write `trajectory.tum` and `track.json` into a folder. The folder is created if it is missing."""
        write_text(Path(folder) / "trajectory.tum", self.to_tum())
        write_json(Path(folder) / "track.json", self.to_json())


def track(
    map: LocalizationMap,
    recording: str | Path | CameraSequence,
    sequence: str | None = None,
    *,
    tracker: ComponentConfig | str | None = None,
    num_views: int = NUM_VIEWS,
    progress: Callable[[int, int], None] | None = None,
) -> Track:
    """Track the camera of a sequence of views.

    True poses in the recording are not used. A frame that cannot be used affects only its own step.

    Args:
        map: The map.
        recording: The views, or the folder or recording that `read_sequence` reads them from.
        sequence: Name of the sequence in a folder; None: the only sequence.
        tracker: As in `open_tracker`.
        num_views: As in `TrackedCamera`.
        progress: Called as progress(done, total) with numbers of frames.

    Raises:
        ConfigError: As `read_sequence`, or `num_views` is less than 1.
        DataError: As `read_sequence`.
        UnknownName: As `read_sequence`, or there is no such tracker.
    """
    if not isinstance(recording, CameraSequence):
        recording = read_sequence(recording, sequence)
    camera = TrackedCamera(map, tracker, num_views=num_views)
    frames, steps = recording.frames, list[TrackStep]()
    last: np.ndarray | None = None
    for number, (frame, pose) in enumerate(zip(frames, recording.odometry, strict=True)):
        if progress:
            progress(number, len(frames))
        motion = None if last is None or pose is None else invert_pose(last) @ pose
        steps.append(camera.step(frame, motion))
        last = pose
    if progress:
        progress(len(frames), len(frames))
    return Track(recording.name, recording.t_s, tuple(frame.id for frame in frames), tuple(steps))


def _step_json(t_s: float, frame: str, step: TrackStep) -> dict[str, Any]:
    """Return a step as JSON: the belief, and the first place of the answer with its probability."""
    pose, answer = step.pose, step.answer
    first = answer.places[0] if answer is not None and answer.places else None
    return {
        "t_s": t_s,
        "frame": frame,
        "status": pose.status,
        "place": pose.place,
        "T_world_pano": None if pose.T_world_pano is None else pose.T_world_pano.tolist(),
        "covariance": None if pose.covariance is None else pose.covariance.tolist(),
        "support": pose.support,
        "answer": None
        if answer is None
        else {
            "status": answer.status,
            "accepted": answer.accepted,
            "place": first and first.place,
            "probability": first and first.probability,
            "out_of_map_probability": answer.out_of_map_probability,
        },
        "error": step.error,
    }
