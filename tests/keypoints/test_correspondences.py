"""Correspondences of a matcher in two panoramas of a textured box with known ranges."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_keypoints.localizer import Keypoints

from salframe.evaluation.tasks.matching.judging import point_errors_px
from salframe.panoramas.geometry import invert_pose, pose_2d
from salframe.panoramas.panorama import Panorama

QUERY, REFERENCE = pose_2d(0.6, -0.4, 2.2, z_m=0.05), pose_2d(0.1, 0.0, 0.3)


@pytest.mark.parametrize("kind", ["sift", "xfeat"])
def test_most_matches_are_right_to_a_pixel(kind, configure, rooms):
    localizer = Keypoints(configure(kind, view_width_px=240, view_height_px=176))
    query, reference = rooms[1].panorama("query", QUERY, 256), rooms[1].panorama("reference", REFERENCE, 256)
    matches = localizer.correspond(localizer.describe(query), localizer.describe(reference))
    np.testing.assert_allclose(np.linalg.norm(np.stack([matches.query, matches.reference]), axis=2), 1, atol=1e-9)
    errors_px = point_errors_px(matches, query, reference, invert_pose(REFERENCE) @ QUERY)
    assert len(errors_px) > 200
    # these panoramas and their views have half the resolution of the pixels in which errors are counted
    assert np.median(errors_px) < 2
    assert (errors_px <= 6).mean() > 0.8


def test_a_blank_panorama_has_no_matches(configure, rooms):
    localizer = Keypoints(configure("sift", view_width_px=240, view_height_px=176))
    textured = localizer.describe(rooms[1].panorama("query", QUERY, 256))
    blank = localizer.describe(Panorama("blank", np.full((256, 512, 3), 90, np.uint8)))
    for pair in ((textured, blank), (blank, textured), (blank, blank)):
        matches = localizer.correspond(*pair)
        assert matches.query.shape == matches.reference.shape == (0, 3)
