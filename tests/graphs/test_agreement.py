"""Matches that put a query in the same spot of the world."""

import numpy as np
import pytest
from salframe_graphs.agreement import agree

from salframe.graphs.matcher import GraphMatch
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d


def test_agreeing_matches_outvote_a_lone_one():
    frames = [ReferenceFrame(str(i), f"place-{i}", pose_2d(2.0 * i, 0, 0.5 * i)) for i in range(4)]
    there = pose_2d(3.0, 1.0, 0.3)
    matches = [GraphMatch(3, 1.0, np.zeros((0, 2), int), pose_2d(0, 0, 2.0))]
    matches += [
        GraphMatch(i, 0.8, np.zeros((0, 2), int), invert_pose(frames[i].T_world_pano) @ there) for i in range(2)
    ]
    matches.append(GraphMatch(2, 0.1, np.zeros((0, 2), int)))
    ranked = agree(matches, frames, 0.5, 1.5)
    assert [m.scene for m in ranked] == [0, 1, 3, 2]
    assert [m.score for m in ranked] == pytest.approx([1.2, 1.2, 1.0, 0.1])
