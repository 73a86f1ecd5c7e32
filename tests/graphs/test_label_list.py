"""The labels of a dataset: numbers against a drawn folder, and what the command prints."""

from __future__ import annotations

import json
from collections import defaultdict

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import run
from PIL import Image
from tiny_folder import write_tiny_folder

import salframe
from salframe.framework.errors import DataError
from salframe.graphs.label_list import LabelStatus, ListedLabel
from salframe.panoramas.folder_format import write_objects
from salframe.testing.rooms import ROOMS


@pytest.fixture
def folder(tmp_path):
    return write_tiny_folder(tmp_path / "home")


def rename(root, names: dict[str, str]) -> None:
    """Rename labels in the table of objects."""
    rows = pq.read_table(root / "objects.parquet").to_pydict()
    rows["label"] = [names.get(label, label) for label in rows["label"]]
    write_objects(root / "objects.parquet", rows)


def test_objects_are_counted_by_their_ids(folder):
    """Ids in the instance images, read by Pillow, with at least 50 pixels."""
    rows = pq.read_table(folder / "objects.parquet").to_pydict()
    label = dict(zip(rows["instance_id"], rows["label"], strict=True))
    expected = defaultdict(set)
    for path in (folder / "frames").glob("*.instances.png"):
        ids, counts = np.unique(np.array(Image.open(path)), return_counts=True)
        for id in ids[(counts >= 50) & (ids > 0)].tolist():
            expected[label[id]].add(id)
    listed = salframe.list_labels(salframe.find_dataset(str(folder))).labels
    assert {row.label: row.objects for row in listed} == {name: len(ids) for name, ids in expected.items()}
    assert {row.label for row in listed} <= {box.label for room in ROOMS for box in room.boxes}
    assert [row.objects for row in listed] == sorted((row.objects for row in listed), reverse=True)


def test_the_command_names_what_is_unknown(folder):
    before = {row.label for row in salframe.list_labels(salframe.find_dataset(str(folder))).labels}
    first, second, third = sorted(before)[:3]
    rename(folder, {first: "refrigirator", second: "Wall", third: "dining_tables"})
    rows = {row["label"]: row for row in run("data", "labels", folder, "--json").json["labels"]}
    assert rows["refrigirator"]["status"] == "unknown"
    assert rows["refrigirator"]["near"][0] == "refrigerator"
    assert rows["Wall"]["status"] == "not an object"
    assert rows["dining_tables"] | {"objects": 0} == {
        **{"label": "dining_tables", "name": "dining table", "common": "table", "objects": 0},
        **{"status": "known", "near": []},
    }
    printed = run("data", "labels", folder).out
    assert "not in the vocabulary; similar: refrigerator" in printed
    assert f"{len(before)} labels (not in the vocabulary: 1; no class of objects: 1)" in printed


def test_a_damaged_panorama_is_left_out(folder):
    path = next((folder / "frames").glob("*.instances.png"))
    path.write_bytes(b"no image")
    result = run("data", "labels", folder, "--json")
    assert result.code == 1
    assert list(result.json["failures"]) == [path.name.removesuffix(".instances.png")]
    assert result.json["labels"]


def test_a_dataset_without_annotations_is_refused(folder):
    manifest = json.loads((folder / "manifest.json").read_text()) | {"objects": None}
    for frame in manifest["frames"]:
        del frame["instances"]
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="has annotations, expected instance images or lists of objects"):
        salframe.list_labels(salframe.find_dataset(str(folder)))


def test_a_synonym_has_its_name():
    assert ListedLabel.of("Couch", 2) == ListedLabel("Couch", "sofa", "sofa", 2, LabelStatus.KNOWN)
