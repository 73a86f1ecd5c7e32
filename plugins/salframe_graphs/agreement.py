"""Matches with several reference frames that put the query in the same spot of the world support each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from salframe.graphs.matcher import GraphMatch
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import wrap_angle

TURN_RAD = np.radians(30)
"""Turn at which two poses no longer agree: chance agreement of position is common, of both rare."""
_NO_POSE = np.full((4, 4), np.nan)


def agree(
    matches: Sequence[GraphMatch], frames: Sequence[ReferenceFrame], share: float, radius_m: float
) -> list[GraphMatch]:
    """The matches, best first, with scores as of `agreed`."""
    poses = [_NO_POSE if match.T_scene_query is None else match.T_scene_query for match in matches]
    stood = np.array([frames[match.scene].T_world_pano for match in matches])
    score = agreed(np.array([match.score for match in matches]), stood @ np.array(poses), share, radius_m)
    raised = [replace(match, score=value) for match, value in zip(matches, score.tolist(), strict=True)]
    return sorted(raised, key=lambda match: -match.score)


def agreed(score: np.ndarray, T_world_query: np.ndarray, share: float, radius_m: float) -> np.ndarray:
    """(T,) the scores of matches (T,), each raised by `share` of the scores of the matches that agree with it.

    Agreement of two poses in the world, T_world_query (T, 4, 4), falls from 1 to 0 at radius_m and at 30 degrees;
    matches without a pose, NaN, keep their score.
    """
    yaw, position_m = np.arctan2(T_world_query[:, 1, 0], T_world_query[:, 0, 0]), T_world_query[:, :3, 3]
    apart = position_m[:, None] - position_m
    distance, turn = np.sqrt((apart * apart).sum(2)), np.abs(wrap_angle(yaw[:, None] - yaw))
    agreement = np.fmax(1 - distance / radius_m, 0) * np.fmax(1 - turn / TURN_RAD, 0)  # unknown: none
    agreement.flat[:: len(score) + 1] = 0  # not with itself
    raised: np.ndarray = score + share * agreement @ score
    return raised
