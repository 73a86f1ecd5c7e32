"""Floor masks of an import: places by the regions of the sample recording, and errors of a wrong file."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import salframe

SAMPLE = Path(__file__).parents[2] / "docs" / "tutorials" / "apartment"


@pytest.fixture
def recording(tmp_path):
    """The sample without the column of the places, and these places by picture."""
    root = shutil.copytree(SAMPLE, tmp_path / "sample")
    with (root / "pictures/poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    places = {Path(row["picture"]).stem: row.pop("place") for row in rows}
    with (root / "pictures/poses.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    return root, places


def import_pictures(root: Path, **options):
    return salframe.import_data("pictures", root / "pictures", root / "imported", **options)


def test_a_panorama_has_the_place_of_its_region(recording):
    """The renderer's places of the six rooms."""
    root, places = recording
    result = import_pictures(root, floors=root / "floors.yaml")
    assert (result.place_from, result.num_places, result.notes) == ("region", 6, ())
    dataset = salframe.find_dataset(str(result.folder))
    assert {frame.id: frame.place for frame in dataset.folds()[0].references} == places
    (floor,) = dataset.floors()
    assert np.array_equal(floor.region, np.asarray(Image.open(root / "floor-region.png")))
    assert np.array_equal(floor.free, np.asarray(Image.open(root / "floor-free.png")) > 0)


def test_places_of_the_column_come_first(recording):
    root, _ = recording
    result = salframe.import_data(
        "pictures", SAMPLE / "pictures", root / "imported", floors=root / "floors.yaml", queries="every:3"
    )
    assert result.place_from == "column"
    assert result.num_queries == 4


def test_a_preview_counts_the_regions(recording):
    root, _ = recording
    preview = salframe.preview_import("pictures", root / "pictures", root / "imported", floors=root / "floors.yaml")
    assert (preview.place_from, preview.num_places) == ("region", 6)
    assert not (root / "imported").exists()


def test_masks_in_another_world_are_named(recording):
    root, _ = recording
    content = json.loads((root / "floors.yaml").read_text())
    content["floors"][0]["origin_m"] = [3.0, 2.0]
    (root / "floors.yaml").write_text(json.dumps(content))
    result = salframe.import_data("pictures", SAMPLE / "pictures", root / "imported", floors=root / "floors.yaml")
    assert any("outside" in note and "region" in note for note in result.notes), result.notes


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"free": "nowhere.png"}, "nowhere.png"),
        ({"region": "pictures/study-01-0.range.png"}, "expected equal sizes"),
        ({"resolution_m": -1}, "resolution_m: received -1, expected a number greater than 0$"),
        ({"unit": 1}, "unknown key .*unit"),
    ],
)
def test_a_malformed_file_is_one_line(recording, change, message):
    root, _ = recording
    content = json.loads((root / "floors.yaml").read_text())
    content["floors"][0] |= change
    (root / "floors.yaml").write_text(json.dumps(content))
    with pytest.raises(salframe.DataError, match=message) as caught:
        import_pictures(root, floors=root / "floors.yaml")
    assert "\n" not in str(caught.value)
    assert not (root / "imported").exists()
