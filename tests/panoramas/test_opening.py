"""Data sets and frames by name: presets, folders, YAML files, image files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny_folder import write_tiny_folder

from salframe.framework.errors import ConfigError, DataError, UnknownName
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.opening import (
    configure_dataset,
    find_dataset,
    find_frame,
    find_image,
    open_frame,
    reference_frames,
)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    return write_tiny_folder(tmp_path_factory.mktemp("tiny"))


def test_a_folder_with_a_manifest_is_a_dataset(fakes, tmp_path):
    (tmp_path / "flat").mkdir()
    (tmp_path / "flat" / "manifest.json").write_text(json.dumps({}))
    for data in ("flat", str(tmp_path / "flat")):
        name, config = configure_dataset(data, None)
        assert (name, config.kind, config.root) == ("flat", "folder", tmp_path / "flat")


def test_a_path_without_a_manifest_is_an_error(fakes, tmp_path):
    with pytest.raises(
        UnknownName, match=r"is not a dataset, expected a folder with a manifest\.json, or one of the names folder, r"
    ):
        configure_dataset(str(tmp_path), None)


def test_a_name_that_nobody_has_tells_the_closest(fakes):
    with pytest.raises(UnknownName, match="unknown dataset 'roms', did you mean 'rooms'"):
        configure_dataset("roms", None)


def test_data_dir_becomes_an_absolute_root(fakes, tmp_path):
    name, config = configure_dataset("rooms", Path("here"))
    assert (name, config.root) == ("rooms", str(tmp_path / "here"))


def test_overrides_are_laid_on_top(fakes):
    assert len(reference_frames(find_dataset("rooms", overrides=("data.rooms=2", "data.queries=1")))) == 2
    with pytest.raises(
        ConfigError, match=r"received the setting 'rooms', expected data\.KEY or engine\.KEY, where KEY"
    ):
        find_dataset("rooms", overrides=("rooms=2",))


def test_a_yaml_file_is_a_dataset(fakes, tmp_path):
    (tmp_path / "mine.yaml").write_text("kind: rooms\nrooms: 3\n")
    name, config = configure_dataset("mine.yaml", None)
    assert (name, config.kind, config.rooms) == ("mine", "rooms", 3)


def test_preparing_is_told_by_the_datasets_name(fakes):
    told = []
    find_dataset("rooms", progress=lambda *call: told.append(call))
    assert told == [("rooms", 5, 5)]


def test_mapping_frames_of_all_folds_come_once(fakes):
    dataset = find_dataset("rooms", overrides=("data.leave_one_out=true",))
    assert len(dataset.folds()) == 10
    assert [frame.id for frame in reference_frames(dataset)] == [f"map-{room}" for room in range(5)]


def test_frames_are_found_by_their_ids(fakes):
    dataset = find_dataset("rooms")
    assert isinstance(find_frame(dataset, "map-3"), ReferenceFrame)
    assert isinstance(find_frame(dataset, "query-3-1"), QueryFrame)
    with pytest.raises(UnknownName, match="unknown frame 'query-3-7', did you mean 'query-3-"):
        find_frame(dataset, "query-3-7")


def test_an_image_leads_to_its_frame(fakes, tiny):
    image = tiny / "frames" / "kitchen-query.rgb.png"
    assert find_image(image) == (tiny.resolve(), "kitchen-query")
    assert open_frame(str(image)).id == "kitchen-query"
    assert open_frame("kitchen-query", str(tiny)).load().rgb.shape == (192, 384, 3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{}", r"manifest\.json: .*frames is missing"),
        ('{"frames": [{}]}', r"frames\.0\.id is missing"),
        ("[]", "contains a list"),
    ],
)
def test_an_image_beside_a_wrong_manifest_is_one_line(tmp_path, content, message):
    (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(DataError, match=message) as caught:
        find_image(tmp_path / "a.png")
    assert "\n" not in str(caught.value)


def test_the_id_and_the_place_of_a_frame_are_no_images(fakes, tiny):
    for name in ("kitchen-map", "kitchen"):
        with pytest.raises(DataError, match=f"has no frame with the image {name}"):
            find_image(tiny / name)


def test_an_image_of_no_frame_is_one_line(fakes, tiny, tmp_path):
    with pytest.raises(DataError, match=r"manifest\.json has no frame with the image frames/absent\.png"):
        find_image(tiny / "frames" / "absent.png")
    with pytest.raises(DataError, match=r"is not in a folder with a manifest\.json"):
        find_image(tmp_path / "photo.jpg")
