"""Maps with the index of a localizer: stored, opened instead of computed, and refused if it was edited."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from fake_plugin import Reader, Rooms

from salframe.framework.components.installation import folder_bytes
from salframe.framework.errors import ConfigError, DataError
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import MapParts, read_map
from salframe.panoramas.opening import find_dataset, find_frame, reference_frames


class Indexed(Reader):
    """Keeps an index: the room of each frame, twice."""

    name = "indexed"
    indexings = 0

    def index(self, descriptions, frames):
        super().index(descriptions, frames)
        self.indexings += 1

    def write_index(self, folder):
        folder.mkdir()
        np.save(folder / "rooms.npy", np.tile(self.rooms, 2))

    def open_index(self, folder, packed, frames):
        self.frames, self.rooms = frames, np.load(folder / "rooms.npy")[: len(packed)]


@pytest.fixture
def indexed(fakes, tmp_path) -> Path:
    LocalizationMap.build(Indexed(), reference_frames(Rooms())).save(tmp_path / "map")
    return tmp_path / "map"


def opened(directory: Path, **settings) -> LocalizationMap:
    return LocalizationMap.open(directory, Indexed(Indexed.Config(**settings)))


def test_a_map_with_an_index_is_not_indexed_again(indexed):
    again, query = opened(indexed), find_frame(find_dataset("rooms"), "query-1-0")
    assert again.localizer.indexings == 0
    assert [place.place for place in again.localize(query).places] == [f"room-{n}" for n in (1, 0, 2, 3, 4)]
    assert (again.frames[-1].id, again.frames[-1]) == ("map-4", again.localizer.frames[-1])
    np.testing.assert_array_equal(again.frames[3].T_world_pano, Rooms()._map_frame(3).T_world_pano)


def test_a_localizer_that_writes_an_index_and_cannot_open_it_is_named(indexed, monkeypatch):
    monkeypatch.delattr(Indexed, "open_index")
    with pytest.raises(ConfigError, match="the localizer 'indexed' overrides `write_index` and not `open_index`"):
        opened(indexed)


def test_other_settings_than_those_of_the_index_index_anew(indexed):
    assert opened(indexed, offset=1).localizer.indexings == 1


def test_a_map_that_is_open_is_written_as_it_was_when_its_folder_is_gone(indexed, tmp_path):
    again = opened(indexed)
    before = json.loads((indexed / "map.json").read_text())["sha256"]
    shutil.rmtree(indexed)
    again.save(tmp_path / "copy")
    assert json.loads((tmp_path / "copy" / "map.json").read_text())["sha256"] == before
    assert any(name.startswith("index-") for name in before)


def test_files_that_map_json_does_not_list_are_not_read(indexed):
    (folder,) = indexed.rglob("index-*")
    other = Indexed(Indexed.Config(offset=1))
    (old,) = indexed.glob("parts-*")
    shutil.copytree(folder, MapParts(old).index_folder(other))
    (old / "floors.npz").write_bytes(b"no floors")
    assert opened(indexed, offset=1).localizer.indexings == 1
    assert read_map(indexed, MapParts.read_floors) == ()


def test_an_index_that_was_edited_is_refused(indexed):
    (rooms,) = indexed.rglob("rooms.npy")
    rooms.write_bytes(rooms.read_bytes()[:-1] + b"x")
    with pytest.raises(DataError, match=r"rooms\.npy was changed after the map was built"):
        opened(indexed)


def test_what_a_map_takes_is_told_without_its_index(indexed, tmp_path):
    again = opened(indexed)
    again.save(tmp_path / "bare", with_index=False)
    assert again.num_bytes() == folder_bytes(tmp_path / "bare") < folder_bytes(indexed)
    assert opened(tmp_path / "bare").localizer.indexings == 1
