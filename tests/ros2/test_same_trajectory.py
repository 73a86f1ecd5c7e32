"""One walk through `track`, a session of the service and the ROS module: the same trajectory."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from command_line import run

from ros2.recorded_walk import RecordedWalk
from ros2.same_trajectory import NEAR, TOLERANCE, check_same_trajectory
from salframe.panoramas.camera_sequence import read_sequence
from salframe.panoramas.geometry import invert_pose
from salframe.testing.rooms import ROOMS, look, stand


def rooms_walk() -> RecordedWalk:
    poses = [stand(ROOMS[2], 0.35 + 0.06 * step, 0.4 + 0.03 * step, 0.4 * step) for step in range(6)]
    return RecordedWalk.of([look(ROOMS[2], f"view {step}", pose) for step, pose in enumerate(poses)], poses)


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
    assert "expected a sequence name only for a folder with a manifest.json" in error.err


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
