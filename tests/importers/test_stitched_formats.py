"""`perspective`, `cubemap` and `tum`: a known point falls on its pixel of the panorama, at its range."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from conftest import differences, references
from drawn_home import HEADINGS_DEG, STANDS, stands
from foreign_formats import CALIBRATION, FISHEYE, PLUMB_BOB, upright_pose, write_transforms

import salframe
from salframe.panoramas.geometry import pose_errors
from salframe.panoramas.importing import find_importer


def check_frames(result, max_color):
    """Check ranges, colours and the red disk of the frames of an imported home, which have a range in every direction
    that some image shows. The disk is seen from at least two stands."""
    distances = []
    for frame in references(result):
        errors, colors, distance = differences(frame)
        assert len(errors) > 0.25 * 128 * 256
        assert np.median(errors) < 0.005
        assert np.quantile(errors, 0.95) < 0.02
        assert np.median(colors) <= max_color
        distances += [] if distance is None else [distance]
    assert len(distances) >= 2
    assert max(distances) < 1.5


@pytest.mark.parametrize("distortion", [{}, PLUMB_BOB, FISHEYE], ids=["pinhole", "plumb_bob", "fisheye"])
def test_posed_images_are_stitched_to_panoramas(import_home, tmp_path, distortion):
    source = write_transforms(tmp_path / "home", stands(), {**CALIBRATION, **distortion})
    result = import_home("perspective", source=source)
    assert (result.num_references, result.num_places, result.place_from, result.notes) == (4, 2, "column", ())
    for frame, position, heading in zip(references(result), STANDS, HEADINGS_DEG, strict=True):
        position_m, angle_rad = pose_errors(frame.T_world_pano, upright_pose(position, heading))
        assert position_m < 1e-6
        assert angle_rad < 1e-6
    check_frames(result, max_color=4)


def test_images_at_half_their_size_are_the_same(import_home, tmp_path, written):
    import cv2

    source = shutil.copytree(written["perspective"], tmp_path / "home")
    for path in (*source.glob("images/*"), *source.glob("depth/*")):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if path.parent.name == "images":
            cv2.imwrite(str(path), cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        else:
            cv2.imwrite(str(path), image[::2, ::2])
    check_frames(import_home("perspective", source=source), max_color=6)


def test_images_are_grouped_by_time_and_by_motion(import_home, tmp_path, written):
    source = shutil.copytree(written["perspective"], tmp_path / "home")
    content = json.loads((source / "transforms.json").read_text())
    for number, frame in enumerate(content["frames"]):
        del frame["station"]
        frame["time"] = number * 0.1 + 10 * (number // 12)
    (source / "transforms.json").write_text(json.dumps(content))
    for group_by in ("time", "motion"):
        recording = find_importer("perspective", [f"group_by={group_by}"]).read(source)
        assert [record.id for record in recording.records] == [f"station-00{number}" for number in (1, 2, 3, 4)]
        for record, position in zip(recording.records, STANDS, strict=True):
            assert record.T_world_pano[:3, 3] == pytest.approx(position, abs=0.04)
    with pytest.raises(salframe.DataError, match="has no key `station`"):
        find_importer("perspective", ["group_by=station"]).read(source)


def test_an_unreadable_image_costs_its_own_part_of_the_panorama(import_home, tmp_path, written):
    source = shutil.copytree(written["perspective"], tmp_path / "home")
    (source / "images" / "p0_0_3.jpg").unlink()
    result = import_home("perspective", source=source)
    assert (result.num_references, result.failures) == (4, {})
    (note,) = result.notes
    assert note.startswith("p0: an image is left out: cannot read")
    known = [np.isfinite(frame.load().range_m).mean() for frame in references(result)]
    assert 0.01 < known[1] - known[0] < 0.1  # one of twelve images, most of which others show too


def test_images_without_depth_become_colour_alone(tmp_path, written):
    source = shutil.copytree(written["perspective"], tmp_path / "home")
    content = json.loads((source / "transforms.json").read_text())
    for frame in content["frames"]:
        del frame["depth_file_path"]
    (source / "transforms.json").write_text(json.dumps(content))
    result = salframe.import_data("perspective", source, tmp_path / "out", settings=["height=64"])
    (panorama, *_) = (frame.load() for frame in references(result))
    assert panorama.provides == {"rgb"}
    assert 0.6 < panorama.valid.mean() < 0.9


def test_cubemaps_are_resampled(import_home):
    result = import_home("cubemap")
    assert (result.num_references, result.notes) == (4, ())
    for frame, position, heading in zip(references(result), STANDS, HEADINGS_DEG, strict=True):
        assert frame.T_world_pano == pytest.approx(upright_pose(position, heading), abs=1e-9)
    check_frames(result, max_color=4)


def test_a_cubemap_without_a_row_is_a_query(import_home, tmp_path, written):
    source = shutil.copytree(written["cubemap"], tmp_path / "home")
    rows = (source / "poses.csv").read_text().splitlines()
    (source / "poses.csv").write_text("\n".join(rows[:-1]))
    result = import_home("cubemap", source=source)
    assert (result.num_references, result.num_queries) == (3, 1)


def test_a_turning_camera_becomes_panoramas(import_home):
    result = import_home("tum")
    assert (result.num_references, result.failures) == (4, {})
    (note,) = result.notes  # the images on the way from one stand to the next
    assert "images are left out: within " in note
    for frame, position in zip(references(result), STANDS, strict=True):
        assert frame.T_world_pano[:3, 3] == pytest.approx(position, abs=0.03)
    check_frames(result, max_color=5)


PUBLISHED = """# ground truth trajectory
# file: 'rgbd_dataset_freiburg1_xyz.bag'
# timestamp tx ty tz qx qy qz qw
1305031098.6659 1.3563 0.6305 1.6380 0.6132 0.5962 -0.3311 -0.3986
1305031098.6758 1.3543 0.6306 1.6360 0.6129 0.5966 -0.3316 -0.3980
"""
"""The first lines of groundtruth.txt in raulmur/ORB_SLAM2, Examples/RGB-D/TestSet/rgbd_dataset_freiburg1_xyz, commit
c91a463cdf0aea42b3898530cbbbff62ffc493f0."""


def test_the_published_layout_is_read(tmp_path, written):
    """The camera of freiburg1_xyz looks down at a desk. Its axis is the third column of the matrix of a quaternion."""
    root = tmp_path / "rgbd_dataset_freiburg1_xyz"
    root.mkdir()
    picture = next((written["tum"] / "rgb").iterdir())
    (root / "rgb").mkdir()
    shutil.copy(picture, root / "rgb" / "1305031098.670000.png")
    (root / "rgb.txt").write_text("# color images\n1305031098.670000 rgb/1305031098.670000.png\n")
    (root / "groundtruth.txt").write_text(PUBLISHED)
    (record,) = find_importer("tum", ["min_view_deg=0"]).read(root).records
    assert record.T_world_pano[:3, 3] == pytest.approx([1.3563, 0.6305, 1.6380])
    qx, qy, qz, qw = 0.6132, 0.5962, -0.3311, -0.3986
    ahead = 2 * (qx * qz + qy * qw), 2 * (qy * qz - qx * qw)
    assert np.arctan2(record.T_world_pano[1, 0], record.T_world_pano[0, 0]) == pytest.approx(
        np.arctan2(ahead[1], ahead[0]), abs=1e-3
    )


def test_the_nearest_time_is_taken(tmp_path, written):
    """Two images, 3 ms after a pose each; the pose 7 ms later is nearer to neither."""
    source = written["tum"]
    recording = find_importer("tum", ["camera=default", "max_time_s=0.0031", "height=64"])
    with pytest.raises(salframe.DataError, match=r"within 0.0031 s of its time \(the nearest is 0.007 s away\)"):
        recording.read(source)  # depth is 7 ms earlier than colour
    assert len(find_importer("tum", ["camera=default", "max_time_s=0.0071"]).read(source).records) == 4


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("rgb.txt", "# nothing\n", "has no row"),
        ("rgb.txt", "soon rgb/1.png\n", "line 1 is 'soon rgb/1.png', expected a time in seconds and a file name"),
        ("groundtruth.txt", "1 2 3\n", "line 1 is '1 2 3', expected a time in seconds and tx ty tz qx qy qz qw"),
        ("groundtruth.txt", "1 0 0 0 0 0 0 2\n", "has the length 2, expected 1"),
    ],
)
def test_a_malformed_list_is_one_line(tmp_path, written, name, content, message):
    source = shutil.copytree(written["tum"], tmp_path / "home", ignore=shutil.ignore_patterns("*.png"))
    (source / name).write_text(content)
    with pytest.raises(salframe.DataError, match=message) as raised:
        find_importer("tum").read(source)
    assert "\n" not in str(raised.value)
