"""Compare the trajectories of one walk through `track`, a bag, a session of the service and the ROS module."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ros2.recorded_walk import T_BASE_PANO, RecordedWalk, replay
from salframe.localization.map import open_map
from salframe.localization.tracking import track
from salframe.panoramas.camera_sequence import read_sequence

TOLERANCE = 1e-6
NEAR = "view_distance_m=0.05"


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
