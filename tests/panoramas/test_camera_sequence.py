"""Views of a moving camera: from a folder, and what is refused. tests/ros2 reads bags."""

from __future__ import annotations

import json

import numpy as np
import pytest
from tracked_folder import poses, write_tracked_folder

from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas.camera_sequence import read_sequence
from salframe.panoramas.geometry import invert_pose


def test_a_folder_has_views_odometry_and_truth(tmp_path):
    root = write_tracked_folder(tmp_path, dropped=1)
    manifest = json.loads((root / "manifest.json").read_text())
    truth = {"queries": {"step-5": {"place": "kitchen", "pose": poses()[5].ravel().tolist()}}}
    (root / "truth.json").write_text(json.dumps(truth))
    (root / "manifest.json").write_text(json.dumps({**manifest, "truth": "truth.json"}))
    views = read_sequence(root)
    assert views.name == "walk"
    assert [frame.id for frame in views.frames] == [f"step-{number}" for number in range(6)]
    np.testing.assert_array_equal(views.t_s, 10.0 + 3 * np.arange(6))
    assert [pose is None for pose in views.odometry] == [False, True, False, False, False, False]
    motion = invert_pose(views.odometry[2]) @ views.odometry[3]
    np.testing.assert_allclose(motion, invert_pose(poses()[2]) @ poses()[3], atol=1e-9)
    assert [pose is None for pose in views.truth] == [True] * 5 + [False]
    np.testing.assert_allclose(views.truth[5], poses()[5])


def test_a_missing_recording_is_refused(tmp_path):
    with pytest.raises(
        DataError, match=r"none\.mcap does not exist, expected a folder with a manifest\.json, or a rec"
    ):
        read_sequence(tmp_path / "none.mcap")


def test_a_folder_of_neither_kind_is_refused(tmp_path):
    with pytest.raises(
        DataError, match=r"expected a ROS bag: .*; a folder of panoramas with a manifest\.json is also accepted"
    ):
        read_sequence(tmp_path)


def test_a_format_without_odometry_is_refused(tmp_path):
    with pytest.raises(
        DataError, match=r"in the format tum have no odometry .*, expected a format with odometry such as"
    ):
        read_sequence(tmp_path, format="tum")


def test_arguments_that_do_not_apply_are_refused(tmp_path):
    with pytest.raises(
        ConfigError, match=r"received the importer setting .*, expected none, because a folder with a manifest.json"
    ):
        read_sequence(write_tracked_folder(tmp_path), settings=["height=256"])
    with pytest.raises(
        ConfigError, match=r"received the sequence 'walk' for .*, expected a sequence name only for a folder"
    ):
        read_sequence(tmp_path / "a.mcap", "walk")
