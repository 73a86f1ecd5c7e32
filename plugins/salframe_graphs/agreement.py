"""Matches with several map frames that put the query in the same spot of the world support each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from salframe.graphs.matcher import GraphMatch
from salframe.panoramas.frames import MapFrame
from salframe.panoramas.geometry import wrap_angle

_TURN_RAD = np.radians(30)
"""Turn at which two poses no longer agree: chance agreement of position is common, of both rare."""


def agree(matches: Sequence[GraphMatch], frames: Sequence[MapFrame], share: float, radius_m: float) -> list[GraphMatch]:
    """The matches, best first, each score raised by `share` of the scores of the matches that agree with it.

    Agreement of two poses in the world falls from 1 to 0 at radius_m and at 30 degrees; matches without a pose keep
    their score.
    """
    posed = [i for i, match in enumerate(matches) if match.T_scene_query is not None]
    if len(posed) < 2:
        return list(matches)
    stood = np.array([frames[matches[i].scene].T_world_pano for i in posed])
    poses = stood @ np.array([matches[i].T_scene_query for i in posed])
    score = np.array([matches[i].score for i in posed])
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    distance = np.linalg.norm(poses[:, None, :3, 3] - poses[None, :, :3, 3], axis=2)
    turn = np.abs(wrap_angle(yaw[:, None] - yaw[None]))
    agreement = np.maximum(1 - distance / radius_m, 0) * np.maximum(1 - turn / _TURN_RAD, 0)
    np.fill_diagonal(agreement, 0)
    raised = list(matches)
    for i, value in zip(posed, score + share * agreement @ score, strict=True):
        if value != matches[i].score:
            raised[i] = replace(matches[i], score=float(value))
    return sorted(raised, key=lambda match: -match.score)
