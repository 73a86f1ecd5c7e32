"""Wrong units, kinds, axes, orders of quaternions, times and extrinsics of COLMAP models and ROS bags are named."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from conftest import references
from drawn_home import stands
from foreign_formats import write_poses, write_rgb, write_steps
from home_writers import write_bag, write_colmap
from scipy.spatial.transform import Rotation

import salframe


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The drawn home as a model and as a bag."""
    root = tmp_path_factory.mktemp("home")
    return {"colmap": write_colmap(root / "colmap", stands()), "rosbag": write_bag(root / "bag", stands())}


@pytest.fixture
def import_from(tmp_path):
    """Imports a model with depth, or a bag, at 128 rows."""

    def run(format, source, *settings):
        depth = (f"depth={source / 'depth'}",) if format == "colmap" else ()
        return salframe.import_data(format, source, tmp_path / "out", settings=("height=128", *depth, *settings))

    return run


@pytest.mark.parametrize(("format", "settings"), [("colmap", ["camera_height=1.5"]), ("rosbag", [])])
def test_the_poses_are_those_of_the_home(import_from, home, format, settings):
    result = import_from(format, home[format], *settings)
    frames = references(result)
    assert len(frames) == len(stands())
    for frame, stand in zip(frames, stands(), strict=True):
        assert frame.T_world_pano == pytest.approx(stand.T_world_pano, abs=1e-3)
    assert [note for note in result.notes if not note.startswith("scale: 1 m per unit")] == []


@pytest.mark.parametrize(
    ("format", "settings", "message"),
    [
        (
            "colmap",
            ["camera_height=1.5", "depth_unit_m=0.0002"],
            "5 times too small, likely millimetres read as fifths",
        ),
        ("colmap", ["camera_height=1.5", "depth_kind=ray"], "the depth images of one place contradict each other"),
        (
            "colmap",
            ["camera_height=15"],
            "the camera height of 15 m above the floor. Expected a camera height of 0.45 to 2.8 m: check camera_height",
        ),
        ("colmap", ["scale=2.5"], "the cameras are 3.75 m above the floor of the model, expected"),
        ("rosbag", ["depth_unit_m=0.0002"], "5 times too small, likely millimetres read as fifths of a millimetre"),
        (
            "rosbag",
            ["depth_kind=cube"],
            "poses and ranges of 4 reference frames (panoramas of the map) contradict each other",
        ),
    ],
)
def test_a_wrong_unit_or_kind_is_named(import_from, home, format, settings, message):
    notes = [note for note in import_from(format, home[format], *settings).notes if message in note]
    assert len(notes) == 1
    assert "\n" not in notes[0]


def test_a_bag_with_depth_in_another_unit_is_named(import_from, tmp_path):
    """Images of 16UC1 hold millimetres by REP-118; this bag has fifths of a millimetre."""
    source = write_bag(tmp_path / "bag", stands(), depth_unit_m=0.0002)
    assert any(
        "5 times too large, likely fifths of a millimetre" in note for note in import_from("rosbag", source).notes
    )


def test_the_axes_of_a_camera_frame_are_named(import_from, home):
    with pytest.raises(
        salframe.DataError, match=r"are not upright according to their poses.*: try --set camera_axes=optical$"
    ):
        import_from("rosbag", home["rosbag"], "camera_axes=body")


@pytest.mark.parametrize("wrong", [{"order": "wxyz"}, {"inverted": True}], ids=["order", "inverted"])
def test_the_transforms_of_a_bag_that_is_not_upright_are_named(import_from, tmp_path, wrong):
    source = write_bag(tmp_path / "bag", stands(), **wrong)
    expected = r"check the transforms of this frame .* \(not inverted, quaternions"
    with pytest.raises(salframe.DataError, match=expected):
        import_from("rosbag", source)


@pytest.mark.parametrize("offset_s", [0.5, -0.5])
def test_transforms_of_another_time_are_noticed(import_from, tmp_path, offset_s):
    source = write_bag(tmp_path / "bag", stands(), pose_offset_s=offset_s)
    assert any("contradict their ranges" in note for note in import_from("rosbag", source).notes)


def test_swapped_extrinsics_of_a_rig_are_noticed(import_from, tmp_path):
    source = write_colmap(tmp_path / "model", stands(), swap=True)
    notes = import_from("colmap", source, "camera_height=1.5").notes
    assert any("p0 and 3 other panoramas: the depth images of one place contradict" in note for note in notes)


def test_quaternions_of_a_table_in_another_order_are_noticed(import_from, tmp_path):
    """The numbers w, x, y, z under the names qx, qy, qz, qw."""
    root, rows = tmp_path / "pictures", []
    for stand in stands():
        rgb, range_m = stand.panorama(stand.T_world_pano, 128)
        write_rgb(root / f"{stand.name}.jpg", rgb)
        write_steps(root / f"{stand.name}.range.png", range_m, 0.001)
        quaternion = Rotation.from_matrix(stand.T_world_pano[:3, :3]).as_quat()
        rows.append([f"{stand.name}.jpg", *stand.position, *np.roll(quaternion, 1)])
    write_poses(root, rows, ("picture", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"))
    notes = salframe.import_data("pictures", root, tmp_path / "out").notes
    assert any("are not upright according to their poses" in note for note in notes)


@pytest.mark.parametrize(
    ("format", "package", "extra"), [("colmap", "pycolmap", "colmap"), ("rosbag", "rosbags", "ros")]
)
def test_a_missing_package_is_one_line(home, import_from, monkeypatch, format, package, extra):
    monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    with pytest.raises(salframe.RequirementMissing, match=rf"{package}.*pip install 'salframe\[{extra}\]'") as caught:
        import_from(format, home[format])
    assert "\n" not in str(caught.value)
