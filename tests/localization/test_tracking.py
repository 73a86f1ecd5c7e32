"""Tracking a camera in a map: the window of views, places at positions, and the track of a folder."""

from __future__ import annotations

import json

import numpy as np
import pytest
from robustness.small_building import write_floors
from scipy.spatial.transform import Rotation
from tracked_folder import poses, write_tracked_folder

from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, DataError, UnknownName
from salframe.localization.described_query import describe_view
from salframe.localization.map import LocalizationMap
from salframe.localization.place_lookup import PlaceLookup
from salframe.localization.tracker import TrackStatus
from salframe.localization.tracking import TrackedCamera, ViewWindow, track
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import invert_pose
from salframe.testing.rooms import ROOMS, look


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_tracked_folder(tmp_path_factory.mktemp("tracked"))


@pytest.fixture(scope="module")
def map(folder):
    localizer = registry().build("localizer", configure_default("localizer", "proposed", [{"detector": "annotations"}]))
    references = FolderDataset(FolderDataset.Config(root=folder)).folds()[0].references
    return LocalizationMap.build(localizer, references)


def errors(tracked, true_poses) -> list[tuple[float, float]]:
    """Errors of position (m) and heading (rad) of each step."""
    return [
        (
            float(np.linalg.norm(step.pose.T_world_pano[:3, 3] - pose[:3, 3])),
            float(Rotation.from_matrix(step.pose.T_world_pano[:3, :3].T @ pose[:3, :3]).magnitude()),
        )
        for step, pose in zip(tracked.steps, true_poses, strict=True)
    ]


def test_the_camera_of_a_folder_is_tracked_through_two_rooms(folder, map):
    tracked = track(map, folder)
    assert tracked.name == "walk"
    assert tracked.frames == tuple(f"step-{number}" for number in range(6))
    np.testing.assert_array_equal(tracked.t_s, 10.0 + 3 * np.arange(6))
    assert tracked.is_tracking.all()
    assert [step.pose.place for step in tracked.steps] == ["bedroom"] * 3 + ["kitchen"] * 3
    assert np.max(errors(tracked, poses()), axis=0) == pytest.approx((0.0, 0.0), abs=0.1)


def test_the_trajectory_is_in_the_format_of_tum(folder, map, tmp_path):
    tracked = track(map, folder, "walk")
    tracked.write(tmp_path / "out")
    columns, comment, *lines = (tmp_path / "out" / "trajectory.tum").read_text().splitlines()
    assert columns.startswith("# timestamp tx ty tz qx qy qz qw; seconds, metres")
    assert comment == "# walk; 0 steps are not tracked"
    rows = np.array([line.split() for line in lines], float)
    np.testing.assert_allclose(rows[:, 0], 10.0 + 3 * np.arange(6))
    for row, step in zip(rows, tracked.steps, strict=True):
        np.testing.assert_allclose(row[1:4], step.pose.T_world_pano[:3, 3], atol=1e-6)
        np.testing.assert_allclose(Rotation.from_quat(row[4:]).as_matrix(), step.pose.T_world_pano[:3, :3], atol=1e-5)
    content = json.loads((tmp_path / "out" / "track.json").read_text())
    assert content == tracked.to_json()
    assert [step["status"] for step in content["steps"]] == ["tracking"] * 6
    assert content["steps"][0]["answer"]["place"] == "bedroom"


def test_steps_that_are_not_tracked_are_counted_in_the_trajectory_and_kept_in_the_json(folder, map):
    tracked = track(map, folder, tracker=configure_default("tracker", "votes", [{"min_support": 100.0}]))
    assert not tracked.is_tracking.any()
    assert tracked.to_tum().splitlines()[1:] == ["# walk; 6 steps are not tracked"]
    assert len(tracked.to_json()["steps"]) == 6


def test_dropped_odometry_costs_no_more_than_the_views_before_it(tmp_path, map):
    tracked = track(map, write_tracked_folder(tmp_path / "dropped", dropped=1))
    assert tracked.is_tracking.all()  # each unknown motion is followed by an answer
    assert np.max(errors(tracked, poses()), axis=0) == pytest.approx((0.0, 0.0), abs=0.6)
    assert errors(tracked, poses())[-1] == pytest.approx((0.0, 0.0), abs=0.1)


def test_a_frame_that_cannot_be_read_costs_its_own_step(tmp_path, map):
    tracked = track(map, write_tracked_folder(tmp_path / "broken", broken=2))
    broken = tracked.steps[2]
    assert broken.answer is None
    assert "step-2" in broken.error
    assert broken.pose.status is TrackStatus.TRACKING  # by odometry
    assert errors(tracked, poses())[2] == pytest.approx((0.0, 0.0), abs=0.1)
    assert "cannot be used" in str(tracked).splitlines()[2]


@pytest.mark.parametrize(
    ("sequence", "error", "message"),
    [
        ("wlak", UnknownName, "unknown sequence 'wlak'.*walk"),
        (None, DataError, "has no sequence \\(recorded camera path\\), expected frames"),
    ],
)
def test_a_wrong_sequence_is_refused(folder, map, sequence, error, message, tmp_path):
    if sequence is None:
        from tiny_folder import write_tiny_folder

        folder = write_tiny_folder(tmp_path)
    with pytest.raises(error, match=message):
        track(map, folder, sequence)


def test_of_several_sequences_one_must_be_named(tmp_path, map):
    root = write_tracked_folder(tmp_path)
    manifest = json.loads((root / "manifest.json").read_text())
    for entry in manifest["frames"][-3:]:
        entry["sequence"] = "second"
    (root / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(
        ConfigError, match="has 2 sequences, expected the option --sequence with one of the names walk, second"
    ):
        track(map, root)
    tracked = track(map, root, "second")
    assert [step.pose.place for step in tracked.steps] == ["kitchen"] * 3


def test_a_window_joins_its_latest_views(map):
    views = [look(ROOMS[0], f"step-{number}", pose) for number, pose in enumerate(poses()[:3])]
    described = [describe_view(map.localizer, QueryFrame(view.id, lambda view=view: view)) for view in views]
    motions = [invert_pose(a) @ b for a, b in zip(poses()[:2], poses()[1:3], strict=True)]
    window = ViewWindow(map, 2)
    window.localize(described[0])
    for view, motion in zip(described[1:], motions, strict=True):
        window.move(motion)
        answer = window.localize(view)
    last_two = map.answer_query(map.describe_query(described[1:], np.stack([invert_pose(motions[1]), np.eye(4)])))
    assert [place.score for place in answer.places] == [place.score for place in last_two.places]
    window.move(None)
    alone = map.answer_query(map.describe_query(described[:1]))
    assert window.localize(described[0]).places == alone.places


def test_a_window_without_views_is_refused(map):
    with pytest.raises(ConfigError, match="num_views is 0, expected at least 1"):
        TrackedCamera(map, num_views=0)


def test_the_place_at_a_position_is_that_of_the_masks_or_of_the_nearest_frame(tmp_path):
    write_tracked_folder(tmp_path)
    write_floors(tmp_path)
    dataset = FolderDataset(FolderDataset.Config(root=tmp_path))
    frames = dataset.folds()[0].references
    with_masks, without = PlaceLookup(dataset.floors(), frames), PlaceLookup((), frames)
    (x_m, y_m), width_m = ROOMS[1].corner_m, ROOMS[0].size_m[0]
    inside = np.array([x_m + 0.2, y_m + 0.2, 1.5])  # in a corner of the kitchen
    assert (with_masks.at(inside), without.at(inside)) == ("kitchen", "kitchen")
    corner = np.array([width_m - 0.1, 0.2, 1.5])
    assert with_masks.at(corner) == "bedroom"
    assert with_masks.at(np.array([500.0, 0.0, 1.5])) == without.at(np.array([500.0, 0.0, 1.5]))  # outside the masks
