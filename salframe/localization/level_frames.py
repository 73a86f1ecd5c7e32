"""Level tilted panoramas before they are described, and convert answers back to the pose of the tilted camera."""

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
"""(3, 3) rotation that levels a camera that hangs upside down."""
VERSION = "1"
"""Version of the levelling (rotation of tilted panoramas), as part of the cache keys of descriptions."""


def level_key(localizer: Localizer, frame: ReferenceFrame | QueryFrame) -> dict[str, Any]:
    """Return what the levelling (rotation of tilted panoramas) of a frame depends on besides the panorama, for cache
    keys; {} if levelling is off."""
    if localizer.level == "off":
        return {}
    rotation = pose_level_rotation(frame.T_world_pano) if isinstance(frame, ReferenceFrame) else None
    by_pose = isinstance(frame, ReferenceFrame) and not may_be_flat(frame.T_world_pano)
    return {"level": [VERSION, by_pose, None if rotation is None else rotation.round(9).tolist()]}


def level_panorama(
    localizer: Localizer, frame: ReferenceFrame | QueryFrame, panorama: Panorama
) -> tuple[Panorama, np.ndarray | None]:
    """Return the panorama of a frame, levelled if it is tilted, and the rotation R_level_pano (3, 3); None if it was
    not levelled.

    A reference frame is levelled by its pose. The tilt of a query is estimated from the images that the localizer uses.
    If the pose of a reference frame is exactly level, it may come from a system that does not measure tilt. Its tilt is
    then also estimated from the images.
    """
    if localizer.level == "off":
        return panorama, None
    if isinstance(frame, ReferenceFrame) and not may_be_flat(frame.T_world_pano):
        rotation = pose_level_rotation(frame.T_world_pano)
    else:
        rotation = estimate_level_rotation(panorama, localizer.needs | localizer.uses)
    return (panorama, None) if rotation is None else (turn_panorama(panorama, rotation), rotation)


def upright_frame(localizer: Localizer, frame: ReferenceFrame) -> ReferenceFrame:
    """Return a reference frame with the pose of its levelled (upright) panorama, as `Localizer.index` receives it."""
    rotation = None if localizer.level == "off" else pose_level_rotation(frame.T_world_pano)
    if rotation is None:
        return frame
    return replace(frame, T_world_pano=frame.T_world_pano @ _as_pose(rotation.T))


def split_level(description: Description) -> tuple[Description, np.ndarray | None]:
    """Return the description without its entry R_LEVEL_PANO, and the rotation (3, 3) in this entry.

    The rotation is None if the panorama was not levelled.
    """
    if R_LEVEL_PANO not in description:
        return description, None
    return {name: value for name, value in description.items() if name != R_LEVEL_PANO}, description[R_LEVEL_PANO]


def level_motions(T_last_view: np.ndarray, rotations: list[np.ndarray | None]) -> np.ndarray:
    """Return the poses of the levelled views in the frame of the levelled last view, (V, 4, 4).

    If no pose in `T_last_view` has a tilt, the poses are assumed to be those of levelled views, and are returned
    unchanged.

    Args:
        T_last_view: (V, 4, 4) poses of the views in the frame of the last view, before levelling.
        rotations: R_level_pano (3, 3) of each view; None for a view that was not levelled.
    """
    if all(map(may_be_flat, T_last_view)):
        return T_last_view
    T_level_pano = np.array([_as_pose(np.eye(3) if rotation is None else rotation) for rotation in rotations])
    levelled: np.ndarray = T_level_pano[-1] @ T_last_view @ np.linalg.inv(T_level_pano)
    return levelled


def unlevel_answer(answer: Localization, rotation: np.ndarray | None) -> Localization:
    """Return an answer with the pose of the tilted camera and a note on the tilt, from the answer to the levelled
    panorama.

    Args:
        answer: The answer to the levelled panorama.
        rotation: R_level_pano (3, 3); None if the panorama was not levelled.
    """
    if rotation is None:
        return answer
    note = f"the query was levelled from a tilt of {tilt_deg(rotation):.1f} deg; the pose is that of the tilted camera"
    pose, heading_rad = answer.T_world_query, answer.heading_rad
    if pose is not None:
        pose = pose @ _as_pose(rotation)
    elif heading_rad is not None:
        heading_rad = pose_yaw(pose_2d(0, 0, heading_rad) @ _as_pose(rotation))
    return replace(answer, T_world_query=pose, heading_rad=heading_rad, notes=(*answer.notes, note))


def unturn_description(description: Description, rotation: np.ndarray) -> Description:
    """Convert the description of a rotated panorama to a description of the panorama before the rotation. Only the
    entry R_LEVEL_PANO (rotation from the panorama frame to the levelled frame) changes.

    Args:
        description: The description of the rotated panorama.
        rotation: (3, 3) rotation from the frame of the original panorama to the frame of the rotated panorama.
    """
    description, level = split_level(description)
    return {**description, R_LEVEL_PANO: rotation if level is None else level @ rotation}


def better_answer(first: Localization, second: Localization) -> Localization:
    """Return the answer whose first place has the higher score; the first answer if the scores are equal. An answer
    that names no place has the lowest score."""
    scores = [answer.places[0].score if answer.status.names_a_place else -np.inf for answer in (first, second)]
    return second if scores[1] > scores[0] else first


def correspond(localizer: Localizer, query: Description, reference: Description) -> PointMatches | NodeMatches | None:
    """Return the matched points or objects of two descriptions (`Localizer.correspond`), in the frames of the panoramas
    before they were levelled; None if the localizer matches neither."""
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
