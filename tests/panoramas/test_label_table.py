"""Tables that translate the labels of a folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny_folder import write_tiny_folder

from salframe.framework.errors import DataError
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.label_table import LabelTable


def table(tmp_path: Path, text: str) -> LabelTable:
    path = tmp_path / "labels.yaml"
    path.write_text(text, encoding="utf-8")
    return LabelTable.read(path)


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("Stuhl", "chair"),
        ("STU\u0308HLE_3", "chair"),  # composed, in lower case, without a number
        ("ku\u0308hlschrank", "refrigerator"),
        ("стул", "chair"),
        ("table", "table"),
        ("Unbekanntes Ding", "Unbekanntes Ding"),
    ],
)
def test_a_label_has_the_name_of_the_table(tmp_path, label, name):
    names = table(tmp_path, "chair: [Stuhl, Stühle, стул]\nrefrigerator: [Kühlschrank]\n")
    assert names.name(label) == name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("chair: Stuhl", "received chair: Stuhl, expected a name and a list of labels, such as"),
        ("chair: [1]", "received chair: .1., expected a name and a list of labels"),
        ("chair: [Sessel]\narmchair: [sessel 2]", "the label 'sessel' is listed under 'chair' and 'armchair'"),
        ("[chair]", "contains a list, expected a mapping"),
        ("chair: [", "is not valid YAML"),
    ],
)
def test_a_malformed_table_is_one_line(tmp_path, text, message):
    with pytest.raises(DataError, match=message) as caught:
        table(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert "labels.yaml" in str(caught.value)


def test_the_table_of_a_folder_translates_its_annotations(tmp_path):
    root = write_tiny_folder(tmp_path / "home")
    before = Folder(root)
    (root / "labels.yaml").write_text("Bett: [bed]\n", encoding="utf-8")
    manifest = json.loads((root / "manifest.json").read_text())
    (root / "manifest.json").write_text(json.dumps(manifest | {"labels": "labels.yaml"}))
    after = Folder(root)
    assert sorted(before.labels.values()) == sorted(
        "bed" if label == "Bett" else label for label in after.labels.values()
    )
    assert "Bett" in after.labels.values()
    panorama = after.load(after.manifest.frames[0])
    assert panorama.annotations.labels == after.labels
    translated = after.fingerprint
    (root / "labels.yaml").write_text("lit: [bed]\n", encoding="utf-8")
    assert Folder(root).fingerprint != translated


def test_a_table_without_objects_is_refused(tmp_path):
    root = write_tiny_folder(tmp_path / "home")
    manifest = json.loads((root / "manifest.json").read_text()) | {"labels": "labels.yaml", "objects": None}
    for frame in manifest["frames"]:
        del frame["instances"]
    (root / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="received `labels` without `objects`, expected both"):
        Folder(root)
