"""Localize an agent by the panoramas that it takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from salframe.framework.errors import FRAME_ERRORS, DataError, InputMissing, MethodFailed, MethodUnavailable
from salframe.framework.files.cache import Cache
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.described_query import DescribedView, describe_view
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.unusable_frames import check_unusable, unusable_note
from salframe.navigation.agent import Located
from salframe.navigation.world import World
from salframe.panoramas.floors import MAX_CAMERA_M, FloorMasks
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw, wrap_angle

MAX_HEADING_ERROR_RAD = np.radians(45.0)
"""Maximum error, in radians, of the heading by odometry within an episode. A pose of the localizer whose heading
differs more from odometry is rejected."""


def localize_nearest(world: World, T_world_pano: np.ndarray, yaw_rad: float, turn: np.ndarray | None = None) -> Located:
    """Simulate perfect place recognition without a localizer.

    The agent is localized at the nearest node of the map to which it can walk straight. If there is no such node, it is
    localized at the nearest node below it, not on another storey.

    Args:
        world: The world.
        T_world_pano: (4, 4) true pose of the agent.
        yaw_rad: Heading by odometry.
        turn: As in `AgentLocalizer.localize`; not used.
    """
    nodes = world.chart.map.nodes
    point_m = np.array([node.xyz_m for node in nodes])
    distance_m = world.chart.reach(T_world_pano[:3, 3], point_m)
    if not np.isfinite(distance_m).any():
        offset_m = point_m - T_world_pano[:3, 3]
        is_on_storey = (offset_m[:, 2] <= 0) & (offset_m[:, 2] >= -MAX_CAMERA_M)
        distance_m = np.where(is_on_storey | ~is_on_storey.any(), np.linalg.norm(offset_m, axis=1), np.inf)
    nearest = int(distance_m.argmin())
    x, y, _ = point_m[nearest]
    name, pose = nodes[nearest].id, pose_2d(x, y, yaw_rad, T_world_pano[2, 3])
    return Located(Localization((RankedPlace(name, name, 1.0),), pose, LocalizationStatus.OK), name)


class AgentLocalizer:
    """Localizes agents in worlds with a localizer.

    Without `positioning`, or if the localizer returns no usable pose, the agent gets the position of the reference
    frame of the best place.

    Args:
        localizer: The localizer.
        dataset: The `content_key` of the dataset, for the cache of descriptions of reference frames.
        positioning: Whether to use the poses of the localizer.
    """

    def __init__(self, localizer: Localizer, dataset: str, positioning: bool) -> None:
        self._localizer, self._dataset, self._positioning, self._cache = localizer, dataset, positioning, Cache()
        self._descriptions: dict[str, Description | None] = {}
        self._unusable_frames: dict[str, DataError | InputMissing] = {}
        self._frames: dict[str, ReferenceFrame] = {}
        self._map: LocalizationMap | None = None
        self._views: list[tuple[DescribedView, np.ndarray]] = []

    @property
    def warning(self) -> str | None:
        """A warning on reference frames that were left out; None if no frame was left out."""
        return unusable_note(self._unusable_frames)

    def localize(
        self, world: World, T_world_pano: np.ndarray, yaw_rad: float, turn: np.ndarray | None = None
    ) -> Located:
        """Localize an agent. All views that the agent took since its last walk are localized together.

        Args:
            world: The world.
            T_world_pano: (4, 4) true pose of the agent, where the panorama is taken.
            yaw_rad: Heading by odometry, used if the localizer returns no pose.
            turn: (4, 4) measured motion since the last panorama, if the agent only turned on the spot; None if it
                walked.
        """
        map = self._map_of(world.references(T_world_pano), world.chart.map.floors)
        panorama = world.observe(T_world_pano)
        view = describe_view(self._localizer, QueryFrame(panorama.id, lambda: panorama))
        earlier = [] if turn is None else [(one, invert_pose(turn) @ T_last_view) for one, T_last_view in self._views]
        self._views = [*earlier, (view, np.eye(4))]
        views, T_last_view = zip(*self._views, strict=True)
        answer = map.answer_query(map.describe_query(views, np.stack(T_last_view)))
        if not answer.status.names_a_place:
            return Located(answer)
        pose = answer.T_world_query if self._positioning else None
        if pose is not None and abs(wrap_angle(pose_yaw(pose) - yaw_rad)) <= MAX_HEADING_ERROR_RAD:
            return Located(answer)
        frame = answer.places[0].frame
        x, y, z = self._frames[frame].T_world_pano[:3, 3]
        pose = pose_2d(x, y, yaw_rad, z)
        return Located(replace(answer, T_world_query=pose, covariance=None, status=LocalizationStatus.OK), frame)

    def _map_of(self, frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]) -> LocalizationMap:
        """Return the map of these frames and floors. Each frame is described only once. Frames that cannot be used are
        left out. If they are too many, raises MethodUnavailable or MethodFailed."""
        usable = [frame for frame in frames if self._describe(frame) is not None]
        if self._map is not None and [frame.id for frame in usable] == list(self._frames):
            return self._map
        unusable = {one.id: self._unusable_frames[one.id] for one in frames if one.id in self._unusable_frames}
        try:
            check_unusable(unusable, len(frames))
        except InputMissing as error:
            raise MethodUnavailable(str(error)) from error
        except DataError as error:
            raise MethodFailed(str(error)) from error
        self._frames = {frame.id: frame for frame in usable}
        descriptions = [description for id in self._frames if (description := self._descriptions[id]) is not None]
        calibration = None if self._map is None else self._map.calibration
        self._map = LocalizationMap.from_descriptions(
            self._localizer, descriptions, usable, floors, calibrate=self._map is None
        )
        self._map.calibration = self._map.calibration or calibration  # the same calibration for all maps of a building
        return self._map

    def _describe(self, frame: ReferenceFrame) -> Description | None:
        if frame.id not in self._descriptions:
            try:
                self._descriptions[frame.id] = describe_frame(self._localizer, frame, self._cache, self._dataset)[0]
            except FRAME_ERRORS as error:
                self._descriptions[frame.id] = None
                self._unusable_frames[frame.id] = error
        return self._descriptions[frame.id]
