"""`pictures`: the images are copied, the poses are those of the table, and options choose places and queries."""

from __future__ import annotations

import json
import shutil

import cv2
import numpy as np
import pytest
from command_line import run
from conformance import conforms
from conftest import references
from drawn_home import HEADINGS_DEG, STANDS
from foreign_formats import upright_pose, write_poses

import salframe
from salframe.framework.components.registry import registry
from salframe.panoramas.importing import find_importer
from salframe.testing import check_recording

HEADER = ("picture", "x_m", "y_m", "z_m", "yaw_deg")


def test_poses_places_and_images_are_those_of_the_recording(import_home, written):
    result = import_home("pictures")
    assert (result.num_references, result.num_queries, result.num_places) == (3, 1, 2)
    assert (result.place_from, result.failures, result.notes) == ("column", {}, ())
    for frame, position, heading in zip(references(result), STANDS, HEADINGS_DEG, strict=False):
        assert frame.T_world_pano == pytest.approx(upright_pose(position, heading), abs=1e-9)
        assert frame.place == ("west" if position[0] < 1 else "east")
        source = written["pictures"] / f"{frame.id}.jpg"
        assert (result.folder / "frames" / source.name).read_bytes() == source.read_bytes()
        steps = cv2.imread(str(source.with_suffix(".range.png")), cv2.IMREAD_UNCHANGED)
        assert frame.load().range_m == pytest.approx(steps * 0.001)


def test_a_picture_without_a_row_is_a_query_without_truth(import_home):
    result = import_home("pictures")
    manifest = json.loads((result.folder / "manifest.json").read_text())
    assert [frame["id"] for frame in manifest["frames"] if frame["role"] == "query"] == ["p3"]
    assert "truth" not in manifest


def test_queries_with_a_pose_have_a_truth(import_home, tmp_path):
    (tmp_path / "ids.txt").write_text("p1.jpg\n\n")
    result = import_home("pictures", queries=tmp_path / "ids.txt")
    assert (result.num_references, result.num_queries) == (2, 2)
    dataset = salframe.find_dataset(str(result.folder))
    assert dataset.truth("p1").place == "east"
    assert dataset.truth("p1").T_world_pano == pytest.approx(upright_pose(STANDS[1], HEADINGS_DEG[1]), abs=1e-9)


def test_angles_and_quaternions_give_the_same_pose(tmp_path, written):
    """Yaw 90, pitch 20 and roll 10 degrees, and the quaternion of this rotation by the half-angle formulas."""
    c, s = np.cos(np.radians([45, 10, 5])), np.sin(np.radians([45, 10, 5]))
    quaternion = (
        c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
        c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
        s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
    )
    tables = [
        (("picture", "x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg"), ["p0.jpg", 1, 2, 3, 90, 20, 10]),
        (("picture", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"), ["p0.jpg", 1, 2, 3, *quaternion]),
    ]
    poses = []
    for number, (header, row) in enumerate(tables):
        root = tmp_path / str(number)
        root.mkdir()
        shutil.copy(written["pictures"] / "p0.jpg", root)
        write_poses(root, [row], header)
        (record,) = find_importer("pictures").read(root).records
        poses.append(record.T_world_pano)
    assert poses[0] == pytest.approx(poses[1], abs=1e-9)
    # The forward axis has azimuth 90 and, as a positive pitch lowers it, elevation -20 degrees.
    assert poses[0][:3, 0] == pytest.approx([0, np.cos(np.radians(20)), -np.sin(np.radians(20))], abs=1e-9)


def test_compass_headings_are_converted(tmp_path, written):
    shutil.copy(written["pictures"] / "p0.jpg", tmp_path)
    write_poses(tmp_path, [["p0.jpg", 0, 0, 1.5, 90]], HEADER)
    (record,) = find_importer("pictures", ["pose_convention=compass"]).read(tmp_path).records
    assert record.T_world_pano[:3, 0] == pytest.approx([1, 0, 0], abs=1e-9)  # 90 is east, +x


def test_places_from_folders_and_from_none(tmp_path, written):
    for name, folder in (("p0", "kitchen"), ("p1", "hall")):
        (tmp_path / "home" / folder).mkdir(parents=True)
        shutil.copy(written["pictures"] / f"{name}.jpg", tmp_path / "home" / folder)
    write_poses(tmp_path / "home", [["kitchen/p0.jpg", 0, 0, 1.5, 0], ["hall/p1.jpg", 2, 0, 1.5, 0]], HEADER)
    by_folder = salframe.import_data("pictures", tmp_path / "home", tmp_path / "a")
    assert {frame.id: frame.place for frame in references(by_folder)} == {"hall/p1": "hall", "kitchen/p0": "kitchen"}
    by_none = salframe.import_data("pictures", tmp_path / "home", tmp_path / "b", place_from="none")
    assert {frame.id: frame.place for frame in references(by_none)} == {
        "hall/p1": "hall/p1",
        "kitchen/p0": "kitchen/p0",
    }
    with pytest.raises(salframe.DataError, match=r"--place-from column gives no place for .*choose folder or none"):
        salframe.import_data("pictures", tmp_path / "home", tmp_path / "c", place_from="column")


def test_an_unreadable_picture_costs_its_own_line(written, tmp_path):
    root = shutil.copytree(written["pictures"], tmp_path / "home")
    (root / "p1.jpg").write_bytes((root / "p1.jpg").read_bytes()[:2000])
    result = run("data", "import", "pictures", root, "-o", tmp_path / "out")
    assert result.code == 1
    assert result.out.startswith(f"{tmp_path / 'out'}: 2 reference frames in 1 places (--place-from column), 1 queries")
    assert result.err.count("\n") == 1
    assert "error: p1: " in result.err
    assert "is not a readable image" in result.err
    assert run("data", "info", tmp_path / "out").code == 0


def test_the_same_call_resumes_and_writes_changed_files_again(written, tmp_path):
    root = shutil.copytree(written["pictures"], tmp_path / "home")
    folder = salframe.import_data("pictures", root, tmp_path / "out").folder
    (folder / "manifest.json").unlink()
    (folder / "frames" / "p1.jpg").unlink()
    before = (folder / "frames" / "p0.jpg").stat().st_mtime_ns
    shutil.copyfile(root / "p0.jpg", root / "p2.jpg")
    assert salframe.import_data("pictures", root, folder).num_references == 3
    assert (folder / "frames" / "p0.jpg").stat().st_mtime_ns == before
    assert (folder / "frames" / "p1.jpg").exists()
    assert (folder / "frames" / "p2.jpg").read_bytes() == (root / "p0.jpg").read_bytes()


def test_a_folder_with_other_content_is_not_overwritten(written, tmp_path):
    salframe.import_data("pictures", written["pictures"], tmp_path / "out")
    with pytest.raises(
        salframe.ConfigError, match="was imported earlier with other importer settings: remove this folder"
    ):
        salframe.import_data("pictures", written["pictures"], tmp_path / "out", settings=["range_unit_m=0.002"])
    with pytest.raises(salframe.ConfigError, match="contains files that `salframe data import` did not write"):
        salframe.import_data("pictures", written["pictures"], written["pictures"])


def test_rows_without_a_picture_are_counted(written, tmp_path):
    root = shutil.copytree(written["pictures"], tmp_path / "home")
    write_poses(root, [["p0.jpg", *STANDS[0], 20], ["P1.JPG", *STANDS[1], 130]], HEADER)
    (note,) = salframe.import_data("pictures", root, tmp_path / "out").notes
    assert note.startswith("1 of 2 rows of poses.csv name a picture that does not exist (such as P1.JPG)")


@pytest.mark.parametrize(
    ("header", "row", "message"),
    [
        (("picture", "x_m", "y_m", "yaw_deg"), ["p0.jpg", 0, 0, 0], "has no column z_m"),
        (
            ("picture", "x_m", "y_m", "z_m"),
            ["p0.jpg", 0, 0, 0],
            "has neither the column yaw_deg nor the columns qx,qy,qz,qw",
        ),
        (HEADER, ["p0.jpg", 0, 0, 0, "north"], "yaw_deg is 'north' in row 1, expected a finite number"),
        ((*HEADER[:4], "qx", "qy", "qz", "qw"), ["p0.jpg", 0, 0, 0, 0, 0, 1, 1], "has the length 1.41, expected 1"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path, written, header, row, message):
    shutil.copy(written["pictures"] / "p0.jpg", tmp_path)
    write_poses(tmp_path, [row], header)
    result = run("data", "import", "pictures", tmp_path, "-o", tmp_path / "out")
    assert result.code == 2
    assert message in result.err
    assert result.err.count("\n") == 1


def test_unknown_names_are_one_line(written, tmp_path):
    result = run("data", "import", "picturs", written["pictures"], "-o", tmp_path / "out")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "unknown importer 'picturs', did you mean 'pictures'?" in result.err
    result = run("data", "import", "pictures", written["pictures"], "-o", tmp_path / "out", "--set", "unit=1")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "unknown setting unit" in result.err


@pytest.mark.parametrize("format", ["pictures", "perspective", "cubemap", "tum"])
def test_importers_conform(format, written):
    component = registry().get("importer", format)
    assert conforms(component)
    settings = [] if format == "pictures" else ["height=64"]
    assert [str(rule) for rule in check_recording(find_importer(format, settings), written[format]).failed] == []
