"""The command `track`."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import run
from PIL import Image
from robustness.small_building import write_floors
from tracked_folder import write_tracked_folder

from salframe.drawing.trail_picture import COLOURS, trail_image
from salframe.localization.tracker import TrackedPose, TrackStatus
from salframe.localization.tracking import NUM_VIEWS, Track, TrackStep
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.geometry import pose_2d


@pytest.fixture
def walk(tmp_path, monkeypatch):
    """A folder with a sequence and the map `map` of it."""
    monkeypatch.chdir(tmp_path)
    write_tracked_folder(tmp_path / "walk")
    write_floors(tmp_path / "walk")
    assert run("build", "walk", "-o", "map").code == 0


def test_a_sequence_is_tracked_and_written(walk, tmp_path):
    printed = run("track", "map", "walk", "-o", "out")
    assert printed.code == 0
    *lines, last = printed.out.splitlines()
    assert len(lines) == 6
    assert all(line.split()[2] == "tracking" for line in lines)
    assert lines[0].startswith("10 s  tracking  bedroom  x 1.")
    assert last == "written to out: trajectory.tum, track.json, trail.png"
    assert len((tmp_path / "out" / "trajectory.tum").read_text().splitlines()) == 2 + 6
    colours = {tuple(pixel) for pixel in np.asarray(Image.open(tmp_path / "out" / "trail.png")).reshape(-1, 3)}
    assert COLOURS[TrackStatus.TRACKING] in colours
    content = run("track", "map", "walk", "--json").json
    assert [step["place"] for step in content["steps"]] == ["bedroom"] * 3 + ["kitchen"] * 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--sequence", "wlak"), "unknown sequence 'wlak'"),
        (("--tracker", "vote"), "unknown tracker 'vote', did you mean 'votes'?"),
        (("--views", "0"), "Input should be greater than or equal to 1"),
    ],
)
def test_wrong_options_are_refused_in_one_line(walk, words, message):
    error = run("track", "map", "walk", *words)
    assert error.code == 2
    assert message in error.err
    assert len(error.err.strip().splitlines()) == 1


def test_the_help_names_the_default_number_of_views():
    assert f"(default: {NUM_VIEWS})" in " ".join(run("track", "--help").out.replace("│", " ").split())


def test_a_trail_is_drawn_where_it_is_on_the_floor(tmp_path):
    """The trail is 2 m long, along x, in the middle of the picture; without floors the rest of the plan is empty."""
    poses = [pose_2d(x, 1.0, 0.0, 1.5) for x in (0.0, 1.0, 2.0)]
    steps = [TrackStep(TrackedPose(TrackStatus.TRACKING, "hall", pose, support=1.0)) for pose in poses]
    image = trail_image(Track("walk", np.arange(3.0), ("a", "b", "c"), tuple(steps)))
    plan = image[: 2 * 80]  # 1 m of margin above and below, 80 pixels per metre
    rows, columns = np.nonzero((plan == COLOURS[TrackStatus.TRACKING]).all(-1))
    assert rows.mean() == pytest.approx(80, abs=2)
    assert columns.min() == pytest.approx(80 - 5, abs=2)
    assert columns.max() == pytest.approx(3 * 80 + 12, abs=3)
    write_tracked_folder(tmp_path)
    write_floors(tmp_path)
    floors = FolderDataset(FolderDataset.Config(root=tmp_path)).floors()
    on_floor = trail_image(Track("walk", np.arange(3.0), ("a", "b", "c"), tuple(steps)), floors)
    assert (on_floor == (222, 235, 247)).all(-1).any() or (on_floor == (229, 241, 222)).all(-1).any()


def test_a_track_without_a_pose_is_drawn():
    steps = (TrackStep(TrackedPose(TrackStatus.LOST), error="no image"),)
    assert trail_image(Track("walk", np.zeros(1), ("a",), steps)).shape[2] == 3
