"""A walk through a rendered home: the same trajectory by every way in."""

from __future__ import annotations

import numpy as np
import pytest

from ros2.recorded_walk import RecordedWalk
from ros2.same_trajectory import NEAR, check_same_trajectory


@pytest.mark.slow
def test_a_walk_through_house_12_has_one_trajectory(tmp_path, monkeypatch):
    """12 views of a walk through at least two rooms, with the detector panoseg."""
    import salframe
    from salframe.evaluation.tasks.tracking.walks import draw_walk
    from salframe.framework.components.defaults import default_of
    from salframe.framework.components.presets import configure_default
    from salframe.navigation.episodes import Site
    from salframe.navigation.guide import Guide

    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    salframe.build_map("house-12", tmp_path / "map", overrides=["detector.kind=panoseg"])
    (world,) = salframe.find_dataset("house-12").worlds()
    planner = configure_default("planner", default_of("navigation_planner"))
    drawn = draw_walk(Site(world, Guide(world.chart, planner)), 0, 0)
    walk = RecordedWalk.of([world.observe(pose) for pose in drawn.poses], drawn.poses)
    trajectory = check_same_trajectory(tmp_path / "map", walk, tmp_path, [NEAR])
    assert np.linalg.norm(trajectory[-1, :2, 3] - drawn.poses[-1][:2, 3]) < 0.5
