"""Sequences of the folder format: poses between odometry rows, and the views of a query in the order of time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas.data_checks import data_notes
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.folder_format import FrameEntry, TruthEntry, write_manifest, write_panorama
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.opening import find_frame
from salframe.panoramas.sequences import MAX_GAP_S, Odometry

HEADER = "t_s,x_m,y_m,z_m,yaw_deg\n"
ROWS = "0,0,0,1,170\n0.5,1,0,1,-170\n1.5,1,2,1,-90\n9,5,5,1,0\n"
POSE = tuple(pose_2d(0, 0, 0, 1.5).ravel().tolist())
RANGE_M = np.full((32, 64), 2.0, np.float32)


def odometry(folder: Path, rows: str = ROWS) -> Odometry:
    (folder / "odometry.csv").write_text(HEADER + rows)
    return Odometry.read(folder / "odometry.csv")


@pytest.mark.parametrize("reordered", [False, True])
def test_poses_are_interpolated_along_the_shorter_arc(tmp_path, reordered):
    rows = ROWS.splitlines(keepends=True)
    poses = odometry(tmp_path, "".join(rows[::-1] if reordered else rows))
    np.testing.assert_allclose(poses.pose(0.0), pose_2d(0, 0, np.radians(170), 1), atol=1e-12)
    np.testing.assert_allclose(poses.pose(0.25), pose_2d(0.5, 0, np.pi, 1), atol=1e-12)
    np.testing.assert_allclose(poses.pose(1.0), pose_2d(1, 1, np.radians(-130), 1), atol=1e-12)
    np.testing.assert_allclose(poses.pose(9.0 + MAX_GAP_S), pose_2d(5, 5, 0, 1), atol=1e-12)


@pytest.mark.parametrize("t_s", [-1.01, 2.0, 8.9, 10.01])
def test_a_time_without_near_rows_has_no_pose(tmp_path, t_s):
    assert odometry(tmp_path).pose(t_s) is None
    assert odometry(tmp_path).motions([0.0, t_s]) is None


def test_motions_map_to_the_last_view(tmp_path):
    first, last = odometry(tmp_path, "3,0,0,1,90\n2,0,-2,1,90\n").motions([2.0, 3.0])
    np.testing.assert_allclose(first, pose_2d(-2, 0, 0), atol=1e-12)  # the robot drove 2 m ahead
    np.testing.assert_array_equal(last, np.eye(4))


@pytest.mark.parametrize(
    ("rows", "message"),
    [("", "has no row, expected rows with t_s, x_m"), ("1,0,0,0,0\n1,0,0,0,5\n", "has two different poses at t_s = 1")],
)
def test_wrong_odometry_is_refused(tmp_path, rows, message):
    with pytest.raises(DataError, match=message):
        odometry(tmp_path, rows)


def write_folder(root: Path, times: dict[str, float], odometry: str | None) -> Path:
    """A folder with a reference frame, and the views of one sequence at these times."""
    entries = [FrameEntry(id="map", role="map", range="map.png", place="hall", pose=POSE)]
    entries += [
        FrameEntry(id=id, role="query", range=f"{id}.png", sequence="walk", t_s=t_s) for id, t_s in times.items()
    ]
    for entry in entries:
        write_panorama(root, entry, range_m=RANGE_M)
    if odometry is not None:
        (root / "odometry.csv").write_text(HEADER + odometry)
    truth = {id: TruthEntry(place="hall", pose=POSE) for id in times}
    write_manifest(root, entries, truth, odometry=None if odometry is None else "odometry.csv")
    return root


def query(root: Path):
    (fold,) = FolderDataset(FolderDataset.Config(root=root)).folds()
    (frame,) = fold.queries
    return frame


def test_the_views_of_a_sequence_are_one_query_in_the_order_of_time(tmp_path):
    root = write_folder(tmp_path, {"c": 1.5, "a": 0.0, "b": 0.5}, ROWS)
    frame = query(root)
    assert frame.id == "c"
    assert [view.id for view in frame.views] == ["a", "b", "c"]
    assert [view.load().id for view in frame.views] == ["a", "b", "c"]
    dataset = FolderDataset(FolderDataset.Config(root=root))
    assert find_frame(dataset, "b").earlier == ()
    assert len(find_frame(dataset, "c").earlier) == 2
    np.testing.assert_allclose(frame.T_last_view[1], pose_2d(2, 0, np.radians(-80)), atol=1e-12)
    before = FolderDataset(FolderDataset.Config(root=root)).fingerprint
    (root / "odometry.csv").write_text(HEADER + ROWS.replace("1.5,1,2", "1.5,1,3"))
    assert FolderDataset(FolderDataset.Config(root=root)).fingerprint != before


@pytest.mark.parametrize("rows", [None, "0,0,0,1,0\n", "9,0,0,1,0\n0,0,0,1,0\n"])
def test_missing_odometry_leaves_the_motion_unknown(tmp_path, rows):
    frame = query(write_folder(tmp_path, {"a": 0.0, "b": 4.0}, rows))
    assert [view.id for view in frame.views] == ["a", "b"]
    assert frame.T_last_view is None
    (note,) = [note for note in data_notes(FolderDataset(FolderDataset.Config(root=tmp_path))) if "motion" in note]
    assert note.startswith("1 of 1 queries with several views have no motion between the views, such as b")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"role": "map", "place": "hall", "pose": POSE}, "the reference frame a has the key `sequence`"),
        ({"t_s": None}, "the view a of the sequence 'walk' has no `t_s`"),
        ({"t_s": 4.0}, "two views of the sequence 'walk' have the same t_s"),
    ],
)
def test_a_wrong_sequence_is_refused(tmp_path, change, message):
    root = write_folder(tmp_path, {"a": 0.0, "b": 4.0}, None)
    manifest = json.loads((root / "manifest.json").read_text())
    manifest["frames"][1] |= change
    (root / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match=message):
        query(root)
