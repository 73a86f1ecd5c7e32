"""A wrong unit, axis, order of a quaternion, time or extrinsics is named in one line."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import pytest
from drawn_home import stands
from foreign_formats import write_cubemaps, write_pictures, write_tum

import salframe


@pytest.mark.parametrize(
    ("format", "settings", "message"),
    [
        ("pictures", ["range_unit_m=0.00025"], "4 times too small, likely millimetres read as quarter millimetres"),
        ("pictures", ["range_unit_m=0.01"], "ranges may be about 10 times too large"),
        ("pictures", ["position_unit_m=0.01"], "the positions are 100 times too small for the ranges"),
        ("pictures", ["position_unit_m=0.3048"], "the positions are 3.281 times too small for the ranges"),
        ("pictures", ["pose_convention=compass"], 'likely the poses follow the convention "compass"'),
        (
            "pictures",
            ["range_kind=cube"],
            "poses and ranges of 4 reference frames (panoramas of the map) contradict each other",
        ),
        ("perspective", ["depth_unit_m=0.0002"], "5 times too small, likely millimetres read as fifths"),
        ("perspective", ["depth_kind=ray"], "the depth images of one place contradict each other: check"),
        ("perspective", ["position_unit_m=0.01"], "the positions are 100 times too small for the ranges"),
        ("cubemap", ["depth_unit_m=0.004"], "4 times too large"),
        ("cubemap", ["depth_kind=ray"], "contain z-depth of cube faces"),
        ("cubemap", ["pose_convention=compass"], 'likely the poses follow the convention "compass"'),
        ("tum", ["depth_unit_m=0.001"], "5 times too large, likely fifths of a millimetre read as millimetres"),
    ],
)
def test_a_wrong_unit_or_kind_is_named(import_home, tmp_path, format, settings, message):
    source = write_pictures(tmp_path / "home", stands()) if format == "pictures" else None
    result = import_home(format, *settings, source=source)
    (note,) = (note for note in result.notes if message in note)
    assert "\n" not in note


@pytest.mark.parametrize("convention", ["ros", "opencv", "opengl", "unity", "ned", "opencv-world-to-camera"])
def test_the_right_axes_of_posed_images_are_named(import_home, convention):
    expected = "images are tilted by .*: try --set pose_convention=opengl-z-up$"
    with pytest.raises(salframe.DataError, match=expected):
        import_home("perspective", f"pose_convention={convention}")


@pytest.mark.parametrize("convention", ["ros", "opengl", "opencv-world-to-camera"])
def test_the_right_axes_of_a_trajectory_are_named(import_home, convention):
    with pytest.raises(salframe.DataError, match=r"try --set pose_convention=opencv(?!-)"):
        import_home("tum", f"pose_convention={convention}")


def test_the_right_order_of_quaternions_is_named(import_home, tmp_path):
    with pytest.raises(salframe.DataError, match="try --set quaternion=xyzw"):
        import_home("tum", "quaternion=wxyz")
    source = write_tum(tmp_path / "home", stands(), order="wxyz")
    with pytest.raises(salframe.DataError, match="try --set quaternion=wxyz"):
        import_home("tum", source=source)


@pytest.mark.parametrize("both_ways", [True, False], ids=["both-ways", "one-way"])
def test_a_time_offset_of_half_a_second_is_noticed(import_home, tmp_path, both_ways):
    """At 60 deg/s all headings are 30 deg off: to one side, or to the left and to the right in turn."""
    source = write_tum(tmp_path / "home", stands(), offset_s=0.5, both_ways=both_ways)
    notes = import_home("tum", source=source).notes
    expected = "contradict their ranges" if both_ways else r"the centre of the images lies (25|30|35) deg to the left"
    assert any(re.search(expected, note) for note in notes)


def test_clocks_that_have_nothing_in_common_are_named(import_home):
    with pytest.raises(
        salframe.DataError, match=r"within 0.02 s of its time \(the nearest is 70.\d s away\): correct pose_offset_s"
    ):
        import_home("tum", "pose_offset_s=100")


def test_inverted_extrinsics_are_noticed(import_home, tmp_path, written):
    source = shutil.copytree(written["perspective"], tmp_path / "home")
    content = json.loads((source / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["transform_matrix"] = np.linalg.inv(frame["transform_matrix"]).tolist()
    (source / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(salframe.DataError, match="whether the poses map the camera to the world"):
        import_home("perspective", source=source)


def test_swapped_extrinsics_of_a_rig_are_noticed(import_home, tmp_path, written):
    """The poses of the upper ring of cameras are those of the lower ring, and the reverse."""
    source = shutil.copytree(written["perspective"], tmp_path / "home")
    content = json.loads((source / "transforms.json").read_text())
    poses = {frame["file_path"]: frame["transform_matrix"] for frame in content["frames"]}
    for frame in content["frames"]:
        stand, ring, turn = frame["file_path"].removesuffix(".jpg").split("_")
        frame["transform_matrix"] = poses[f"{stand}_{1 - int(ring)}_{turn}.jpg"]
    (source / "transforms.json").write_text(json.dumps(content))
    notes = import_home("perspective", source=source).notes
    assert any("p0 and 3 other panoramas: the depth images of one place contradict" in note for note in notes)


@pytest.mark.parametrize("faces", ["FLBRUD", "FRBLDU", "BRFLUD"], ids=["left-right", "up-down", "front-back"])
def test_swapped_faces_of_a_cube_are_noticed(import_home, tmp_path, faces):
    source = write_cubemaps(tmp_path / "home", stands(), faces)
    assert any(
        "the faces do not join at the edges of the cube" in note for note in import_home("cubemap", source=source).notes
    )
