"""Maps: built, cached, saved, opened again and asked; by a localizer that reads the answer off the panorama."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fake_plugin import Reader, Rooms

from salframe.framework.cache import Cache
from salframe.framework.errors import ConfigError, DataError, InputMissing, UnknownName
from salframe.framework.identity import UserFile
from salframe.framework.registry import registry
from salframe.localization.localizer import MAP, Localizer
from salframe.localization.saved_map import build_map, open_map
from salframe.panoramas.frames import FrameKind, QueryFrame
from salframe.panoramas.opening import find_dataset, find_frame, mapping_frames

FRAME = {"id": "a", "place": "b", "kind": "scene", "T_world_pano": np.eye(4).tolist()}


def edit(directory: Path, **changes) -> None:
    path = directory / MAP
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.fixture
def saved(fakes, tmp_path) -> Path:
    build_map("rooms", tmp_path / "map", "reader", overrides=("data.rooms=3", "offset=1"))
    return tmp_path / "map"


def test_a_map_that_is_opened_again_answers_as_before(saved):
    localizer = open_map(saved)
    assert localizer.config.offset == 1
    answer = localizer.localize(find_frame(find_dataset("rooms"), "query-1-0"))
    assert [place.place for place in answer.places] == ["room-2", "room-1", "room-0"]
    np.testing.assert_allclose(answer.T_world_query[:3, 3], [8.0, 0.0, 0.0])  # rooms are 4 m apart


def test_frames_of_a_saved_map_have_no_panorama(saved):
    frame = open_map(saved).frames[0]
    assert (frame.id, frame.place, frame.kind) == ("map-0", "room-0", FrameKind.SCENE)
    with pytest.raises(DataError, match="a frame of a saved map holds no panorama"):
        frame.load()


def test_a_folder_of_something_else_is_not_overwritten(saved, tmp_path):
    (tmp_path / "photos").mkdir()
    build_map("rooms", tmp_path / "photos", "reader")  # an empty folder may become one
    build_map("rooms", saved, "reader")
    assert open_map(saved).config.offset == 0
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "thesis.tex").write_text("years")
    (tmp_path / "file").write_text("years")
    for name in ("work", "file"):
        with pytest.raises(ConfigError, match=f"{name} holds something else than a map"):
            build_map("rooms", tmp_path / name, "reader")


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"format": 99}, DataError, "has map format 99, expected 2: build it again"),
        ({"version": "0"}, DataError, "was made by reader 0, expected reader 1: build it again"),
        ({"localizer": {"kind": "raeder"}}, UnknownName, "unknown localizer 'raeder', did you mean 'reader'"),
        ({"localizer": {"kind": "reader", "ofset": 1}}, ConfigError, "unknown key .*ofset"),
        ({"localizer": None}, DataError, r"map\.json: localizer: received None, expected a valid dictionary"),
        ({"localizer": {}}, DataError, r"map\.json names no localizer: build the map again"),
        ({"frames": [{"id": "a"}]}, DataError, r"map\.json: frames\.0\.place is missing"),
        ({"frames": []}, DataError, "has 3 descriptions and 0 frames, expected one each: build it again"),
        ({"frames": [FRAME] * 4}, DataError, "has 3 descriptions and 4 frames, expected one each: build it again"),
        ({"described_by": "0"}, DataError, "was described with other settings, weights or files .*: build it again"),
        (
            {"frames": [{**FRAME, "kind": "attic"}]},
            DataError,
            r"map\.json: frames\.0\.kind: received 'attic', expected 'scene' or 'transition'",
        ),
        (
            {"frames": [{**FRAME, "T_world_pano": [1, 2]}]},
            DataError,
            r"map\.json: frames\.0\.T_world_pano\.0: received 1, expected a valid tuple",
        ),
    ],
)
def test_a_map_that_is_none_is_one_line(saved, changes, error, message):
    edit(saved, **changes)
    with pytest.raises(error, match=message) as caught:
        open_map(saved)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["[]", '{"format": 2}', "null"])
def test_a_map_file_without_its_keys_is_one_line(saved, content):
    (saved / MAP).write_text(content)
    for load in (open_map, Reader().load):
        with pytest.raises(DataError, match=r"map\.json(: version is missing| holds .*, expected an object)") as caught:
            load(saved)
        assert "\n" not in str(caught.value)


class Noting(Reader):
    """Reads a file of the user's when it describes."""

    name = "noting"
    describe_identity = Localizer.describe_identity

    class Config(Reader.Config):
        note: UserFile = UserFile("note.txt")


def test_a_map_described_with_another_file_is_not_asked(fakes):
    Path("note.txt").write_text("one")
    noting = Noting()
    noting.build(mapping_frames(Rooms()))
    noting.save(Path("map"))
    Noting().load(Path("map"))
    Path("note.txt").write_text("two")
    with pytest.raises(DataError, match=r"was described with other .* files than noting has now: build it again"):
        Noting().load(Path("map"))


def test_a_map_is_replaced_whole_or_not_at_all(saved, monkeypatch):
    def interrupt(path, content):
        raise KeyboardInterrupt

    (saved / "topology.json").write_text("{}")
    before = {path.name: path.read_bytes() for path in saved.iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr("salframe.localization.localizer.write_json", interrupt)
        with pytest.raises(KeyboardInterrupt):
            build_map("rooms", saved, "reader")
    assert {path.name: path.read_bytes() for path in saved.iterdir()} == before
    build_map("rooms", saved, "reader")
    assert {path.name for path in saved.iterdir()} == {"map.json", "descriptions.npz"}


def test_another_version_of_a_dataset_is_described_anew(fakes, monkeypatch):
    first = Rooms().content_key
    monkeypatch.setattr(Rooms, "version", "2")
    assert Rooms().content_key != first
    for folder in ("first", "second"):
        build_map("rooms", Path(folder), "reader")
        assert len(list(Cache().directory.rglob("*.npz"))) == 5
    monkeypatch.setattr(Rooms, "version", "3")
    build_map("rooms", Path("third"), "reader")
    assert len(list(Cache().directory.rglob("*.npz"))) == 10


def test_a_folder_without_a_map_is_one_line(fakes, tmp_path):
    with pytest.raises(DataError, match=r"cannot read .*map\.json: No such file"):
        open_map(tmp_path)


def test_a_map_needs_a_frame(fakes):
    with pytest.raises(DataError, match="a map needs at least one mapping frame, received none"):
        build_map("rooms", Path("map"), "reader", overrides=("data.rooms=0",))
    assert not Path("map").exists()


def test_what_a_method_needs_is_named(fakes):
    localizer = registry().build("localizer", registry().get("localizer", "ranger").Config())
    with pytest.raises(InputMissing, match="ranger needs range, which map-0 does not have"):
        localizer.build(mapping_frames(Rooms()))


def test_descriptions_are_cached_by_data_frame_and_identity(fakes):
    looks = []

    def seen(frame):
        return QueryFrame(frame.id, lambda: looks.append(frame.id) or frame.load())

    (fold,) = Rooms().folds()
    frame, cache = seen(fold.queries[0]), Cache()
    first, seconds = Reader().describe_frame(frame, cache, "data")
    again, same_seconds = Reader().describe_frame(frame, cache, "data")
    assert looks == [frame.id]
    assert again["room"].tolist() == first["room"].tolist()
    assert same_seconds == seconds > 0
    Reader().describe_frame(frame, cache, "other data")
    Reader().describe_frame(seen(fold.queries[1]), cache, "data")
    Reader().describe_frame(frame, None, "data")
    assert looks == [frame.id, frame.id, fold.queries[1].id, frame.id]


def test_a_damaged_cache_entry_is_computed_again(fakes):
    frame, cache = mapping_frames(Rooms())[2], Cache()
    Reader().describe_frame(frame, cache, "data")
    (entry,) = cache.directory.rglob("*.npz")
    entry.write_bytes(entry.read_bytes()[:40])
    assert Reader().describe_frame(frame, cache, "data")[0]["room"].tolist() == [2, 0]


def test_building_tells_how_far_it_is(fakes):
    told = []
    Reader().build(mapping_frames(Rooms()), progress=lambda *call: told.append(call))
    assert told == [(done, 5) for done in range(6)]
