import json

import numpy as np
import pytest
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.readers import (
    boxes_path,
    connectivity_path,
    find_scans,
    read_boxes,
    read_connectivity,
    read_regions,
    read_room_types,
    regions_path,
)

from salframe.framework.errors import DataError


def test_pose_looks_where_the_camera_looks_and_stands_upright(building):
    poses = read_connectivity(connectivity_path(building.root, "fake"))
    assert list(poses) == ["a", "b", "c"]
    assert poses["b"][:3, 3] == pytest.approx([1.2, 0.3, 1.6])
    azimuth = np.radians(-35)
    assert poses["b"][:3, 0] == pytest.approx([np.cos(azimuth), np.sin(azimuth), 0])
    assert poses["b"][:3, 1] == pytest.approx([-np.sin(azimuth), np.cos(azimuth), 0])
    assert poses["b"][:3, 2] == pytest.approx([0, 0, 1])


def test_labels_are_words_and_unseen_objects_are_skipped(building):
    boxes = read_boxes(boxes_path(building.root, "fake", "a"), "a")
    assert {number: box.label for number, box in boxes.items()} == {1: "arm chair", 2: "lamp", 3: "table"}
    assert all(box.box_px.shape == (len(box.view), 4) for box in boxes.values())


def test_room_types_are_the_words_of_the_file(building):
    path = regions_path(building.root)
    assert read_room_types(path) == {"fake": {0: "b", 1: "b"}}
    content = json.loads(path.read_text())
    content["label_info"]["label_name"] = {"b": "bedroom (to sleep in)", "k": "kitchen"}
    content["pano_info"]["fake"]["c"]["label"] = content["pano_info"]["fake"]["hidden"]["label"] = "-"
    path.write_text(json.dumps(content))
    assert read_room_types(path) == {"fake": {0: "bedroom"}}
    dataset = MatterportAnnotations(MatterportAnnotations.Config(root=building.root))
    assert dataset.room_types() == {"fake/region-0": "bedroom"}


def test_regions(building):
    assert read_regions(regions_path(building.root)) == {"fake": {"a": 0, "b": 0, "c": 1, "hidden": 1}}


def test_missing_and_malformed_files_are_named(building, tmp_path):
    with pytest.raises(DataError, match=r"not a folder, expected a folder with connectivity/\*_connectivity.json"):
        find_scans(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="empty is a folder without connectivity files"):
        find_scans(tmp_path / "empty")
    with pytest.raises(DataError, match=r"cannot read .*fake_z\.json: No such file"):
        read_boxes(boxes_path(building.root, "fake", "z"), "z")
    with pytest.raises(DataError, match=r"fake_a\.json has no key 'b'"):
        read_boxes(boxes_path(building.root, "fake", "a"), "b")
    building.write_json("connectivity/fake_connectivity.json", [{"image_id": "a", "included": True, "pose": [1, 2, 3]}])
    with pytest.raises(
        DataError, match=r"fake_connectivity\.json: key 0\.pose: received \[1, 2, 3\] .*, expected .* 16"
    ):
        read_connectivity(connectivity_path(building.root, "fake"))
    building.write_json("vp2room_label.json", {"pano_info": {"fake": {"a": {"region_index": "-"}}}})
    with pytest.raises(DataError, match=r"vp2room_label\.json: key pano_info\.fake\.a\.region_index: received"):
        read_regions(regions_path(building.root))
