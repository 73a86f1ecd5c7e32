"""What an agent makes of a panorama: a localizer's answer as a pose in the world."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import FRAME_ERRORS, MethodFailed
from salframe.framework.files.cache import Cache
from salframe.localization.answers import LocalizationStatus
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map import LocalizationMap
from salframe.navigation.agent import Located
from salframe.navigation.world import World
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw, wrap_angle

ASTRAY_RAD = np.radians(45.0)
"""Odometry does not go astray by more than this within an episode: a pose that contradicts it is wrong."""


def see_place(world: World, T_world_pano: np.ndarray, yaw_rad: float) -> Located:
    """What an agent makes of being told its true place, without any localizer: it takes itself to stand at the map's
    node, doorways included, that is nearest of those it could walk straight to. `yaw_rad` is its heading."""
    nodes = world.chart.map.nodes
    point_m = np.array([node.xyz_m for node in nodes])
    away_m = world.chart.reach(T_world_pano[:3, 3], point_m)
    if not np.isfinite(away_m).any():
        away_m = np.linalg.norm(point_m - T_world_pano[:3, 3], axis=1)
    nearest = int(away_m.argmin())
    x, y, _ = point_m[nearest]
    return Located(pose_2d(x, y, yaw_rad, T_world_pano[2, 3]), 1.0, nodes[nearest].id)


class Sight:
    """A localizer that looks around in worlds; `dataset` is the content_key under which reference frames are cached.

    Without `positioning`, or where the localizer gives no pose, an agent takes itself to stand at the frame of the
    first place.
    """

    def __init__(self, localizer: Localizer, dataset: str, positioning: bool) -> None:
        self._localizer, self._dataset, self._positioning, self._cache = localizer, dataset, positioning, Cache()
        self._described: dict[str, Description | None] = {}
        self._left_out: list[str] = []
        self._frames: dict[str, ReferenceFrame] = {}
        self._map: LocalizationMap | None = None

    @property
    def warning(self) -> str | None:
        """What the user must know of the reference frames."""
        return (
            f"{len(self._left_out)} reference frame(s) left out, the first: {self._left_out[0]}"
            if self._left_out
            else None
        )

    def look(self, world: World, T_world_pano: np.ndarray, yaw_rad: float) -> Located | None:
        """Where the localizer says that the agent is, None where it fails; `yaw_rad` is the heading where it gives no
        pose."""
        known = self._map_of(world.references(T_world_pano), world.chart.map.floors)
        panorama = world.observe(T_world_pano)
        answer = known.answer(describe_frame(self._localizer, QueryFrame(panorama.id, lambda: panorama))[0])
        if not answer.status.names_a_place or not answer.places:
            return None
        best = answer.places[0]
        pose = answer.T_world_query if self._positioning and answer.status is LocalizationStatus.OK else None
        if pose is not None and abs(wrap_angle(pose_yaw(pose) - yaw_rad)) <= ASTRAY_RAD:
            return Located(pose, best.score)
        x, y, z = self._frames[best.frame].T_world_pano[:3, 3]
        return Located(pose_2d(x, y, yaw_rad, z), best.score, best.frame)

    def _map_of(self, frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]) -> LocalizationMap:
        """Return the map of these frames, each of which is described once, on these floors; frames that cannot be used
        are left out."""
        usable = [frame for frame in frames if self._describe(frame) is not None]
        if self._map is not None and [frame.id for frame in usable] == list(self._frames):
            return self._map
        if not usable:
            raise MethodFailed("; ".join(["no reference frame can be used", *self._left_out[:1]]))
        self._frames = {frame.id: frame for frame in usable}
        known = [described for id in self._frames if (described := self._described[id]) is not None]
        self._map = LocalizationMap.from_descriptions(self._localizer, known, usable, floors)
        return self._map

    def _describe(self, frame: ReferenceFrame) -> Description | None:
        if frame.id not in self._described:
            try:
                self._described[frame.id] = describe_frame(self._localizer, frame, self._cache, self._dataset)[0]
            except FRAME_ERRORS as error:
                self._described[frame.id] = None
                self._left_out.append(f"{frame.id}: {error}")
        return self._described[frame.id]
