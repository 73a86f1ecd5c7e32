"""Rank places from the scores of reference frames (docs/explanation/single-panoramas.md#doorways)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.localization.answers import RankedPlace
from salframe.panoramas.frames import FrameKind, ReferenceFrame


def rank_places(
    frames: Sequence[ReferenceFrame], scores: np.ndarray, T_world_query: np.ndarray | None = None
) -> tuple[RankedPlace, ...]:
    """Return the places of scored frames, best first, each with its best frame. Equal scores keep the order of the
    frames.

    A transition frame stands in a doorway between two places. If the best frame is a transition frame and the pose is
    known, the pose decides between the places: the scene frame nearest to the pose is ranked first, with the same
    score.

    Args:
        frames: The K reference frames.
        scores: (K,) scores, larger is better; -inf: the frame is not a candidate.
        T_world_query: (4, 4) pose of the query; None if it is unknown.
    """
    order = [int(i) for i in np.argsort(-scores, kind="stable") if np.isfinite(scores[i])]
    value = scores.astype(np.float64)
    if T_world_query is not None and order and frames[order[0]].kind is FrameKind.TRANSITION:
        scenes = [i for i, frame in enumerate(frames) if frame.kind is FrameKind.SCENE]
        if scenes:
            nearest = min(
                scenes, key=lambda i: float(np.linalg.norm(frames[i].T_world_pano[:3, 3] - T_world_query[:3, 3]))
            )
            value[nearest] = value[order[0]]
            order = [nearest, *(i for i in order if i != nearest)]
    ranked: dict[str, RankedPlace] = {}
    for i in order:
        ranked.setdefault(frames[i].place, RankedPlace(frames[i].id, frames[i].place, float(value[i])))
    return tuple(ranked.values())
