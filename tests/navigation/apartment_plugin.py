"""Two rooms with a door between them, a data set that shows where a panorama was taken, and localizers that read it
off.

Room a covers x from 0 to 4 m, room b from 4.2 to 8 m, both y from 0 to 4 m; the door in the wall between them is at y
from 1.5 to 2.5 m. A panorama's first row of ranges holds x, y, z and yaw.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from pydantic import Field

import salframe
from salframe.framework.component import ComponentConfig
from salframe.framework.errors import WeightsError
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, Localizer
from salframe.localization.ranking import rank_places
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import Connection, FloorMasks
from salframe.panoramas.frames import Fold, FrameKind, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.panorama import Panorama

RESOLUTION_M = 0.05
STOREY_M, STAIRS_M = 3.0, 6.0
POSES = {"a-west": (1.0, 2.0, 0.3), "a-north": (3.0, 3.5, -1.0), "b": (7.0, 2.0, 2.0), "door": (4.1, 2.0, 0.0)}


def masks(*boxes: tuple[float, float, float, float]) -> FloorMasks:
    """Return the floor, with obstacles in boxes (x0, y0, x1, y1) in metres."""
    y, x = np.meshgrid(
        4.5 - (np.arange(100) + 0.5) * RESOLUTION_M, -0.5 + (np.arange(180) + 0.5) * RESOLUTION_M, indexing="ij"
    )
    inside = (y > 0) & (y < 4)
    door = (y > 1.5) & (y < 2.5) & (x >= 4) & (x <= 4.2)
    region = np.where(inside & (x > 0) & (x < 4.1), 1, 0) + np.where(inside & (x > 4.1) & (x < 8), 2, 0)
    free = inside & (((x > 0) & (x < 4)) | ((x > 4.2) & (x < 8)) | door)
    obstacle = np.zeros(free.shape, bool)
    for x0, y0, x1, y1 in boxes:
        obstacle |= (x > x0) & (x < x1) & (y > y0) & (y < y1)
    return FloorMasks(free, region.astype(np.int32) * free, obstacle, RESOLUTION_M, (-0.5, 4.5), {1: "a", 2: "b"})


def panorama(id: str, pose: np.ndarray) -> Panorama:
    range_m = np.ones((4, 8), np.float32)
    range_m[0, :4] = np.array([*pose[:3, 3], pose_yaw(pose)]) + 100.0  # ranges are positive
    return Panorama(id, range_m=range_m)


def references() -> tuple[ReferenceFrame, ...]:
    frames = []
    for id, (x, y, yaw) in POSES.items():
        pose = pose_2d(x, y, yaw, 1.5)
        kind, place = (FrameKind.TRANSITION, id) if id == "door" else (FrameKind.SCENE, id[0])
        frames.append(ReferenceFrame(id, place, pose, kind, partial(panorama, id, pose)))
    return tuple(frames)


class Still(Dataset):
    """Has panoramas at its frames only: it cannot render."""

    name = "still"
    version = "1"
    provides = frozenset({"range"})
    fingerprint = "still"

    def folds(self) -> Sequence[Fold]:
        return [Fold("all", references(), (QueryFrame("query", references()[0].load),))]

    def truth(self, query_id: str) -> Truth:
        return Truth("a")

    def floors(self) -> Sequence[FloorMasks]:
        return [masks()]


class Apartment(Still):
    """Renders a panorama that encodes its pose, anywhere."""

    name = "apartment"

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        x, y, _ = T_world_pano[:3, 3]
        return panorama(f"at {x:.3f} {y:.3f}", T_world_pano)


class Tower(Apartment):
    """The apartment twice: the upper one is STOREY_M higher, and its names begin with "up-". Stairs connect the two
    rooms a."""

    name = "tower"

    def folds(self) -> Sequence[Fold]:
        raised = []
        for frame in references():
            pose = frame.T_world_pano + STOREY_M * np.eye(4)[2][:, None] * np.eye(4)[3]
            place, load = f"up-{frame.place}", partial(panorama, f"up-{frame.id}", pose)
            raised.append(ReferenceFrame(f"up-{frame.id}", place, pose, frame.kind, load))
        return [Fold("all", (*references(), *raised), (QueryFrame("query", references()[0].load),))]

    def floors(self) -> Sequence[FloorMasks]:
        upper = replace(masks(), z_m=STOREY_M, regions={1: "up-a", 2: "up-b"})
        return [masks(), upper]

    def connections(self) -> Sequence[Connection]:
        return [Connection(start="a", end="up-a", kind="stairs", length_m=STAIRS_M)]


class Unmasked(Apartment):
    """Renders, but has no floor masks."""

    name = "unmasked"

    def floors(self) -> Sequence[FloorMasks]:
        return ()


class Seer(Localizer):
    """Reads the pose from the panorama."""

    name = "seer"
    version = "1"
    needs = frozenset({"range"})

    class Config(ComponentConfig):
        shift_m: float = Field(0.0, description="how far to the east of the truth its answers are")
        crash_east_of_m: float = Field(99.0, description="raise on panoramas taken there")
        blind: bool = Field(False, description="never answer")
        posed: bool = Field(True, description="give poses, or places alone")

    def describe(self, panorama: Panorama) -> Description:
        return {"pose": panorama.range_m[0, :4].astype(float) - 100.0}

    def describe_identity(self) -> dict:
        return {"name": self.name}

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self.frames = frames

    def match(self, description: Description) -> Localization:
        x, y, z, yaw = description["pose"]
        if x > self.config.crash_east_of_m:
            raise ValueError("too far east")
        if self.config.blind:
            return Localization((), None, LocalizationStatus.LOW_SCORE)
        scores = np.exp(
            [-np.hypot(frame.T_world_pano[0, 3] - x, frame.T_world_pano[1, 3] - y) for frame in self.frames]
        )
        places = rank_places(self.frames, scores)
        if not self.config.posed:
            return Localization(places, None, LocalizationStatus.NO_POSE)
        return Localization(places, pose_2d(x + self.config.shift_m, y, yaw, z), LocalizationStatus.OK)


class Weightless(Seer):
    """Its weights are always missing."""

    name = "weightless"

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        raise WeightsError("weightless.pth is not at hand: salframe weights fetch weightless")


@salframe.hookimpl
def salframe_provides():
    return [Still, Apartment, Tower, Unmasked, Seer, Weightless]
