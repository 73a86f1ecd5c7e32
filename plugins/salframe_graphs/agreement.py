"""Agreement of matches: matches with different reference frames support each other if they give the same query pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from salframe.graphs.matcher import GraphMatch
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import wrap_angle

TURN_RAD = np.radians(30)
"""Maximum difference between the headings of two agreeing poses. Headings are compared too, because two positions often
agree by chance."""

_NO_POSE = np.full((4, 4), np.nan)


def agree(
    matches: Sequence[GraphMatch], frames: Sequence[ReferenceFrame], share: float, radius_m: float
) -> list[GraphMatch]:
    """Increase the scores of matches that agree with each other (`add_agreement`), and return the matches, best first.

    Args:
        matches: Matches of a query with the graphs of reference frames.
        frames: The reference frames of the map.
        share: Fraction of the score of each agreeing match that is added.
        radius_m: Maximum distance in metres between two agreeing poses.
    """
    poses = [_NO_POSE if match.T_scene_query is None else match.T_scene_query for match in matches]
    T_world_scene = np.array([frames[match.scene].T_world_pano for match in matches])
    score = add_agreement(
        np.array([match.score for match in matches]), T_world_scene @ np.array(poses), share, radius_m
    )
    raised = [replace(match, score=value) for match, value in zip(matches, score.tolist(), strict=True)]
    return sorted(raised, key=lambda match: -match.score)


def add_agreement(score: np.ndarray, T_world_query: np.ndarray, share: float, radius_m: float) -> np.ndarray:
    """Increase the score of each match by `share` times the sum of agreement * score over all other matches.

    The agreement of two poses falls from 1 at no difference to 0 at a distance of `radius_m` or a turn of 30 degrees.

    Args:
        score: (T,) scores of the matches.
        T_world_query: (T, 4, 4) pose of the query in the world that each match gives. The score of a match without a
            pose (NaN) does not change.
        share: Fraction of the score of each agreeing match that is added.
        radius_m: Maximum distance in metres between two agreeing poses.

    Returns:
        (T,) float64 increased scores.
    """
    yaw_rad, position_m = np.arctan2(T_world_query[:, 1, 0], T_world_query[:, 0, 0]), T_world_query[:, :3, 3]
    offset_m = position_m[:, None] - position_m
    distance_m, turn_rad = np.sqrt((offset_m * offset_m).sum(2)), np.abs(wrap_angle(yaw_rad[:, None] - yaw_rad))
    agreement = np.fmax(1 - distance_m / radius_m, 0) * np.fmax(1 - turn_rad / TURN_RAD, 0)  # 0 where a pose is unknown
    agreement.flat[:: len(score) + 1] = 0  # a match does not support itself
    raised: np.ndarray = score + share * agreement @ score
    return raised
