"""Level the panoramas that localizers describe, and answer with the pose of the camera before levelling."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from salframe.localization.answers import Localization, NodeMatches, PointMatches
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.levelling import (
    estimate_level_rotation,
    may_be_flat,
    pose_level_rotation,
    tilt_deg,
    turn_panorama,
)
from salframe.panoramas.panorama import Panorama

R_LEVEL_PANO = "R_level_pano"
"""Key in the description of a panorama that was levelled: (3, 3) rotation from its frame to the levelled frame."""
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0])
"""Rotation that levels a camera that hangs upside down."""
VERSION = "1"
"""Changes whenever the levelled panoramas change. It is part of the cache keys of descriptions."""


def level_key(localizer: Localizer, frame: ReferenceFrame | QueryFrame) -> dict[str, Any]:
    """Return the inputs of the levelling other than the panorama, for cache keys; {} if it is off."""
    if localizer.level == "off":
        return {}
    rotation = pose_level_rotation(frame.T_world_pano) if isinstance(frame, ReferenceFrame) else None
    by_pose = isinstance(frame, ReferenceFrame) and not may_be_flat(frame.T_world_pano)
    return {"level": [VERSION, by_pose, None if rotation is None else rotation.round(9).tolist()]}


def level_panorama(
    localizer: Localizer, frame: ReferenceFrame | QueryFrame, panorama: Panorama
) -> tuple[Panorama, np.ndarray | None]:
    """Return the panorama of a frame, levelled if it is tilted, and the rotation R_level_pano (3, 3) or None.

    A reference frame is levelled by its pose. The tilt of a query is estimated from the images that the localizer uses.
    So is the tilt of a reference frame with an exactly level pose, which may come from a system that does not measure
    tilt.
    """
    if localizer.level == "off":
        return panorama, None
    if isinstance(frame, ReferenceFrame) and not may_be_flat(frame.T_world_pano):
        rotation = pose_level_rotation(frame.T_world_pano)
    else:
        rotation = estimate_level_rotation(panorama, localizer.needs | localizer.uses)
    return (panorama, None) if rotation is None else (turn_panorama(panorama, rotation), rotation)


def upright_frame(localizer: Localizer, frame: ReferenceFrame) -> ReferenceFrame:
    """Return a reference frame with the pose of its levelled panorama, as `Localizer.index` receives it."""
    rotation = None if localizer.level == "off" else pose_level_rotation(frame.T_world_pano)
    if rotation is None:
        return frame
    return replace(frame, T_world_pano=frame.T_world_pano @ _as_pose(rotation.T))


def split_level(description: Description) -> tuple[Description, np.ndarray | None]:
    """Return the description without the rotation of the levelling, and that rotation (3, 3), None if there is
    none."""
    if R_LEVEL_PANO not in description:
        return description, None
    return {name: value for name, value in description.items() if name != R_LEVEL_PANO}, description[R_LEVEL_PANO]


def level_motions(T_last_view: np.ndarray, rotations: list[np.ndarray | None]) -> np.ndarray:
    """Return the motions between levelled views, (V, 4, 4).

    Motions in the plane, with a heading and no tilt, are those between levelled views already.

    Args:
        T_last_view: (V, 4, 4) motions between the views as they were taken.
        rotations: R_level_pano (3, 3) of each view, None if it was not levelled.
    """
    if all(map(may_be_flat, T_last_view)):
        return T_last_view
    T_level_pano = np.array([_as_pose(np.eye(3) if rotation is None else rotation) for rotation in rotations])
    levelled: np.ndarray = T_level_pano[-1] @ T_last_view @ np.linalg.inv(T_level_pano)
    return levelled


def as_it_stood(answer: Localization, rotation: np.ndarray | None) -> Localization:
    """Return an answer for a levelled panorama as one for the panorama itself, with a note on its tilt."""
    if rotation is None:
        return answer
    note = f"the query was levelled from a tilt of {tilt_deg(rotation):.1f} deg; the pose is that of the tilted camera"
    pose, heading_rad = answer.T_world_query, answer.heading_rad
    if pose is not None:
        pose = pose @ _as_pose(rotation)
    elif heading_rad is not None:
        heading_rad = pose_yaw(pose_2d(0, 0, heading_rad) @ _as_pose(rotation))
    return replace(answer, T_world_query=pose, heading_rad=heading_rad, notes=(*answer.notes, note))


def of_turned(description: Description, rotation: np.ndarray) -> Description:
    """Return the description of a panorama that was turned by a rotation (3, 3), as one of the panorama itself."""
    description, level = split_level(description)
    return {**description, R_LEVEL_PANO: rotation if level is None else level @ rotation}


def better_answer(first: Localization, second: Localization) -> Localization:
    """Return the answer with the higher score of two answers by one localizer; the first if they are equal."""
    scores = [answer.places[0].score if answer.status.names_a_place else -np.inf for answer in (first, second)]
    return second if scores[1] > scores[0] else first


def correspond(localizer: Localizer, query: Description, reference: Description) -> PointMatches | NodeMatches | None:
    """Return the matches of two descriptions by `Localizer.correspond`, in the frames of the panoramas themselves."""
    (query, query_rotation), (reference, reference_rotation) = split_level(query), split_level(reference)
    matches = localizer.correspond(query, reference)
    turns = [np.eye(3) if rotation is None else rotation for rotation in (query_rotation, reference_rotation)]
    if isinstance(matches, PointMatches):
        return replace(matches, query=matches.query @ turns[0], reference=matches.reference @ turns[1])
    if isinstance(matches, NodeMatches):
        return replace(matches, query_m=matches.query_m @ turns[0], reference_m=matches.reference_m @ turns[1])
    return matches


def _as_pose(rotation: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = rotation
    return pose
