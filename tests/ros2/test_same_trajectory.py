"""One walk through `track`, a session of the service and the ROS module: the same trajectory."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from ros2.recorded_walk import T_BASE_PANO, RecordedWalk, replay
from salframe.localization.map import open_map
from salframe.localization.tracking import track
from salframe.panoramas.camera_sequence import read_sequence
from salframe.panoramas.geometry import invert_pose
from salframe.testing.rooms import ROOMS, look, stand

TOLERANCE = 1e-6
NEAR = "view_distance_m=0.05"


def rooms_walk() -> RecordedWalk:
    poses = [stand(ROOMS[2], 0.35 + 0.06 * step, 0.4 + 0.03 * step, 0.4 * step) for step in range(6)]
    return RecordedWalk.of([look(ROOMS[2], f"view {step}", pose) for step, pose in enumerate(poses)], poses)


def check_same_trajectory(map_folder: Path, walk: RecordedWalk, tmp_path: Path, settings: list[str]) -> np.ndarray:
    """Check the trajectories of a walk against that of `track` on a folder, and return the latter."""
    from salframe_ros2.robot_tracker import RobotSettings
    from serving.rooms_service import serving

    opened = open_map(map_folder)
    tracked = track(opened, walk.write_folder(tmp_path / "walk"))
    assert tracked.is_tracking.all()
    trajectory = np.array([step.pose.T_world_pano for step in tracked.steps])

    bag = walk.write_bag(tmp_path / "walk.mcap")
    from_bag = track(opened, read_sequence(bag, settings=settings))
    assert (
        np.abs([step.pose.T_world_pano - pose for step, pose in zip(from_bag.steps, trajectory, strict=True)]).max()
        < TOLERANCE
    )

    with serving(map_folder) as service:
        beliefs = walk.observe(service.client)
    assert {belief["status"] for belief in beliefs} == {"tracking"}
    assert np.abs(np.array([belief["T_world_base"] for belief in beliefs]) - trajectory).max() < TOLERANCE

    options = RobotSettings(**{key: json.loads(value) for key, value in (setting.split("=") for setting in settings)})
    updates, _ = replay(opened, bag, options)
    by_ros = np.array([update.T_map_base @ T_BASE_PANO for update in updates])
    assert np.abs(by_ros - trajectory).max() < TOLERANCE
    covariances = np.array([update.step.pose.covariance for update in updates])
    assert np.abs(covariances - [step.pose.covariance for step in tracked.steps]).max() < TOLERANCE
    return trajectory


def test_a_walk_through_the_rooms_has_one_trajectory(rooms_map, tmp_path):
    walk = rooms_walk()
    trajectory = check_same_trajectory(rooms_map, walk, tmp_path, [NEAR])
    assert np.abs(trajectory - walk.truth).max() < 0.15


def test_the_command_reads_bags(rooms_map, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bag = rooms_walk().write_bag(tmp_path / "walk.mcap")
    printed = run("track", rooms_map, bag, "--set", NEAR, "-o", "out")
    assert printed.code == 0, printed.err
    assert printed.out.splitlines()[0].startswith("1700000000 s  tracking  ")
    rows = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    np.testing.assert_allclose(rows[:, 0], 1_700_000_000 + np.arange(6))
    error = run("track", rooms_map, bag, "--sequence", "walk")
    assert error.code == 2
    assert "expected it only with a folder of panoramas" in error.err


def test_a_bag_with_the_frame_map_has_the_truth_beside_the_odometry(rooms_map, tmp_path):
    walk = rooms_walk()
    moving = read_sequence(walk.write_bag(tmp_path / "walk.mcap", truth=True), settings=[NEAR])
    assert np.abs(np.array(moving.truth) - walk.truth).max() < TOLERANCE
    assert np.abs(np.array(moving.odometry) - walk.odometry).max() < TOLERANCE
    without = read_sequence(walk.write_bag(tmp_path / "other.mcap"), settings=[NEAR])
    assert without.truth == (None,) * 6
    assert np.abs(np.array(without.odometry) - walk.odometry).max() < TOLERANCE


def test_views_are_apart(rooms_map, tmp_path):
    """Each is 0.35 m to 0.4 m and 23 degrees from the one before, so every second one is a view."""
    walk = rooms_walk()
    assert all(0.2 < np.linalg.norm((invert_pose(a) @ b)[:3, 3]) < 0.5 for a, b in pairwise(walk.odometry))
    moving = read_sequence(walk.write_bag(tmp_path / "walk.mcap"))
    assert [frame.id for frame in moving.frames] == ["000000", "000002", "000004"]


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
