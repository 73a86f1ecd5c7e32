"""Localization with perfect place recognition, with expected values computed by hand for the apartment."""

import numpy as np
import pytest

from salframe.navigation.agent_localizer import localize_nearest
from salframe.panoramas.geometry import pose_2d


@pytest.mark.parametrize(
    ("x_m", "y_m", "node_m"),
    [(0.5, 1.0, (1.0, 2.0)), (3.4, 2.1, (4.1, 2.0)), (4.5, 3.5, (7.0, 2.0))],
    ids=["a frame", "the doorway", "a-north would be nearer, through the wall"],
)
def test_told_its_place_an_agent_stands_at_the_nearest_node_in_sight(world, x_m, y_m, node_m):
    located = localize_nearest(world, pose_2d(x_m, y_m, 2.0, 1.5), 0.3)
    np.testing.assert_allclose(located.answer.T_world_query, pose_2d(*node_m, 0.3, 1.5), atol=0.03)
