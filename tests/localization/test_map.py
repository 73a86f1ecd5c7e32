"""Maps: built, cached, saved, opened again and asked; by a localizer that reads the answer off the panorama."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from fake_plugin import Reader, Rooms
from scipy.spatial.transform import Rotation
from tiny_folder import write_tiny_folder

from salframe.framework.components.identity import UserFile
from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, DataError, InputMissing, UnknownName
from salframe.framework.files.cache import Cache
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap, open_map
from salframe.localization.map_files import METHOD, MapParts, write_map
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.opening import find_dataset, find_frame, reference_frames
from salframe.panoramas.panorama import Annotations, Panorama, visible_instances
from salframe.topology.building_map import build_map


def edit(directory: Path, **changes) -> None:
    """Write the map again with another method.json."""
    (old,) = directory.glob("parts-*")
    with write_map(directory) as parts:
        shutil.copytree(old, parts.folder, dirs_exist_ok=True)
        parts.write_json(METHOD, {**json.loads((old / METHOD).read_text()), **changes})


@pytest.fixture
def saved(fakes, tmp_path) -> Path:
    build_map("rooms", tmp_path / "map", "reader", topology=False, overrides=("data.rooms=3", "offset=1"))
    return tmp_path / "map"


def test_a_map_that_is_opened_again_answers_as_before(saved):
    opened = open_map(saved)
    assert opened.localizer.config.offset == 1
    answer = opened.localize(find_frame(find_dataset("rooms"), "query-1-0"))
    assert [place.place for place in answer.places] == ["room-2", "room-1", "room-0"]
    np.testing.assert_allclose(answer.T_world_query[:3, 3], [8.0, 0.0, 0.0])  # rooms are 4 m apart


def test_frames_of_a_saved_map_have_no_panorama(saved):
    frame = open_map(saved).frames[0]
    assert (frame.id, frame.place, frame.kind) == ("map-0", "room-0", FrameKind.SCENE)
    with pytest.raises(DataError, match="a frame of a saved map has no panorama"):
        frame.load()


ASKEW = {
    "scaled": 1.01 * Rotation.from_euler("z", 0.5).as_matrix(),
    "tilted and scaled": 1.01 * Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix(),
    "mirrored": np.diag([1.0, 1.0, -1.0]),
    "sheared": np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
}


@pytest.mark.parametrize("turn", ASKEW.values(), ids=ASKEW)
def test_frames_that_stand_askew_are_refused(turn, tmp_path):
    tilted, askew = np.eye(4), np.eye(4)
    tilted[:3, :3], askew[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix(), turn
    poses = [pose_2d(1, 2, 0.5), tilted, askew]
    frames = [ReferenceFrame(f"map-{i}", "hall", np.eye(4)) for i in range(len(poses))]
    for frame, pose in zip(frames, poses, strict=True):
        object.__setattr__(frame, "T_world_pano", pose)  # as in an edited map: a frame itself refuses it
    for count in (2, 3):
        (parts := tmp_path / str(count)).mkdir()
        MapParts(parts).write_scenes(({} for _ in range(count)), frames[:count])
    assert len(MapParts(tmp_path / "2").read_scenes()[1]) == 2
    with pytest.raises(DataError, match="the pose of the frame map-2 is not a rigid motion: build the map again"):
        MapParts(tmp_path / "3").read_scenes()


def test_poses_come_back_in_every_bit_level_and_tilted(tmp_path):
    yaw_rad = np.random.default_rng(0).uniform(-np.pi, np.pi, 20)
    level = [pose_2d(3 * yaw, 1e6 + yaw, yaw, 1.5) for yaw in yaw_rad]
    tilted = [np.eye(4) for _ in level]
    for pose, turn in zip(tilted, Rotation.random(len(tilted), np.random.default_rng(1)).as_matrix(), strict=True):
        pose[:3, :3], pose[:3, 3] = turn, turn[0]
    upside_down = np.diag([1.0, -1.0, -1.0, 1.0])
    for name, poses, numbers in (
        ("level", level, 5 * 20),
        ("tilted", [*tilted, upside_down], 12 * 21),
        ("both", [level[0], tilted[0], upside_down, level[1]], 2 * 5 + 2 * 12),
    ):
        frames = [ReferenceFrame(f"map-{i}", "hall", pose) for i, pose in enumerate(poses)]
        (tmp_path / name).mkdir()
        MapParts(tmp_path / name).write_scenes(({} for _ in frames), frames)
        _, saved = MapParts(tmp_path / name).read_scenes()
        np.testing.assert_array_equal([frame.T_world_pano for frame in saved], poses)
        np.testing.assert_array_equal(saved.poses(), np.array(poses)[:, :3])
        assert len(np.load(tmp_path / name / "frames" / "pose.npy")) == numbers


def test_a_pose_of_another_length_is_refused(saved):
    (old,) = saved.glob("parts-*")
    with write_map(saved) as parts:
        shutil.copytree(old, parts.folder, dirs_exist_ok=True)
        table = parts.folder / "frames" / "columns.json"
        table.write_text(table.read_text().replace('"shape":[5]', '"shape":[4]'))
        np.save(parts.folder / "frames" / "pose.npy", np.zeros(4 * len(open_map(saved).frames)))
    with pytest.raises(DataError, match="frames has a pose of 4 numbers, expected 5 or 12"):
        open_map(saved)


def test_a_folder_of_something_else_is_not_overwritten(saved, tmp_path):
    (tmp_path / "photos").mkdir()
    build_map("rooms", tmp_path / "photos", "reader")  # an empty folder may become one
    build_map("rooms", saved, "reader")
    assert open_map(saved).localizer.config.offset == 0
    (tmp_path / "file").write_text("years")
    with pytest.raises(ConfigError, match="file contains files that are not a map"):
        build_map("nowhere", tmp_path / "file", "reader")  # said before anything is opened


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        (
            {"version": "0"},
            DataError,
            "was built with version 0 of the method 'reader', expected version 1 of 'reader': build the map again",
        ),
        ({"localizer": {"kind": "raeder"}}, UnknownName, "unknown localizer 'raeder', did you mean 'reader'"),
        ({"localizer": {"kind": "reader", "ofset": 1}}, ConfigError, "unknown key .*ofset"),
        ({"localizer": None}, DataError, r"method\.json: key localizer: received None, expected a dictionary"),
        (
            {"localizer": {}},
            DataError,
            r"method\.json has no key 'kind' with the name of a method: build the map again",
        ),
        ({"described_by": "0"}, DataError, "was built with other settings, weights or files .*: build the map again"),
    ],
)
def test_a_map_that_is_none_is_one_line(saved, changes, error, message):
    edit(saved, **changes)
    with pytest.raises(error, match=message) as caught:
        open_map(saved)
    assert "\n" not in str(caught.value)


class Noting(Reader):
    """Reads a file of the user's when it describes."""

    name = "noting"
    describe_identity = Localizer.describe_identity

    class Config(Reader.Config):
        note: UserFile = UserFile("note.txt")


def test_a_map_described_with_another_file_is_not_asked(fakes):
    Path("note.txt").write_text("one")
    LocalizationMap.build(Noting(), reference_frames(Rooms())).save("map")
    LocalizationMap.open("map", Noting())
    Path("note.txt").write_text("two")
    with pytest.raises(
        DataError, match=r"was built with other .* files than the method 'noting' has now: build the map again"
    ):
        LocalizationMap.open("map", Noting())


def test_a_map_is_replaced_whole_or_not_at_all(saved, monkeypatch):
    def interrupt(folder, rows):
        raise KeyboardInterrupt

    def files():
        return {path.relative_to(saved): path.read_bytes() for path in saved.rglob("*") if path.is_file()}

    before = files()
    with monkeypatch.context() as patch:
        patch.setattr("salframe.localization.map_files.write_columns", interrupt)
        with pytest.raises(KeyboardInterrupt):
            build_map("rooms", saved, "reader")
    assert files() == before
    build_map("rooms", saved, "reader", topology=False)
    (parts,) = saved.glob("parts-*")
    assert {path.name for path in parts.iterdir()} == {"method.json", "frames", "scenes"}


def test_a_map_is_asked_as_it_is_stored(fakes):
    """Packed to whole tens and unpacked again, when it is taken and when it is loaded."""

    class Rough(Reader):
        def pack(self, description):
            return {"tens": (description["room"] // 10).astype(np.int8)}

        def unpack(self, packed):
            return {"room": packed["tens"] * np.int64(10)}

    rough, frames = Rough(), reference_frames(Rooms())[:3]
    built = LocalizationMap.from_descriptions(rough, [{"room": np.array([n, 0])} for n in (7, 23, 48)], frames)
    assert rough.rooms.tolist() == [0, 20, 40]
    built.save("map")
    assert LocalizationMap.open("map", Rough()).localizer.rooms.tolist() == [0, 20, 40]


def test_a_small_map_that_is_open_does_not_change_with_its_files(saved):
    query = find_frame(find_dataset("rooms"), "query-1-0")
    again = open_map(saved)
    before = again.localize(query)
    for path in saved.rglob("*.npy"):
        path.write_bytes(b"")  # in place, as rsync --inplace or a network disk does
    after = again.localize(query)
    assert [(place.place, place.score) for place in after.places] == [(p.place, p.score) for p in before.places]
    np.testing.assert_array_equal(after.T_world_query, before.T_world_query)


@pytest.mark.parametrize("change", [lambda path: os.utime(path, ns=(0, 0)), lambda path: path.unlink()])
def test_a_large_map_is_refused_after_its_files_changed(saved, monkeypatch, change):
    for module in ("framework.files.array_files", "localization.map_files"):
        monkeypatch.setattr(f"salframe.{module}.MAX_READ_BYTES", 1)  # all files are memory-mapped
    query = find_frame(find_dataset("rooms"), "query-1-0")
    again = open_map(saved)
    assert again.localize(query).places[0].place == "room-2"
    path = max(saved.rglob("*.npy"), key=lambda path: path.stat().st_size)
    change(path)
    with pytest.raises(DataError, match=rf"{path.name} was changed while the map was open: open the map again"):
        again.localize(query)


def test_what_a_map_takes_is_what_is_written(saved):
    assert open_map(saved).num_bytes() == folder_bytes(saved)
    assert folder_bytes(saved) == sum(path.stat().st_size for path in saved.rglob("*") if path.is_file()) > 0


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
    with pytest.raises(DataError, match=r"contains no map: build one with salframe build"):
        open_map(tmp_path)


def test_a_map_needs_a_frame(fakes):
    with pytest.raises(DataError, match="received no reference frame, expected at least one"):
        build_map("rooms", Path("map"), "reader", topology=False, overrides=("data.rooms=0",))
    assert not Path("map").exists()


def test_what_a_method_needs_is_named(fakes):
    localizer = registry().build("localizer", registry().get("localizer", "ranger").Config())
    with pytest.raises(InputMissing, match="the method 'ranger' needs range, which panorama map-0 does not have"):
        LocalizationMap.build(localizer, reference_frames(Rooms()))


def test_descriptions_are_cached_by_data_frame_and_identity(fakes):
    looks = []

    def seen(frame):
        return QueryFrame(frame.id, lambda: looks.append(frame.id) or frame.load())

    (fold,) = Rooms().folds()
    frame, cache = seen(fold.queries[0]), Cache()
    first, seconds = describe_frame(Reader(), frame, cache, "data")
    again, same_seconds = describe_frame(Reader(), frame, cache, "data")
    assert looks == [frame.id]
    assert again["room"].tolist() == first["room"].tolist()
    assert same_seconds == seconds > 0
    describe_frame(Reader(), frame, cache, "other data")
    describe_frame(Reader(), seen(fold.queries[1]), cache, "data")
    describe_frame(Reader(), frame, None, "data")
    assert looks == [frame.id, frame.id, fold.queries[1].id, frame.id]


def test_a_damaged_cache_entry_is_computed_again(fakes):
    frame, cache = reference_frames(Rooms())[2], Cache()
    describe_frame(Reader(), frame, cache, "data")
    (entry,) = cache.directory.rglob("*.npz")
    entry.write_bytes(entry.read_bytes()[:40])
    assert describe_frame(Reader(), frame, cache, "data")[0]["room"].tolist() == [2, 0]


def test_building_tells_how_far_it_is(fakes):
    told = []
    LocalizationMap.build(Reader(), reference_frames(Rooms()), progress=lambda *call: told.append(call))
    assert told == [(done, 5) for done in range(6)]


@pytest.fixture(scope="module")
def annotated(tmp_path_factory):
    """A map of the rooms of the conformance suite, and the panorama of a query."""
    folder = tmp_path_factory.mktemp("annotated")
    build_map(write_tiny_folder(folder / "data"), folder / "map", "objects", topology=False)
    return open_map(folder / "map"), find_frame(find_dataset(folder / "data"), "kitchen-query").load()


def test_arrays_are_localized_as_the_panorama(annotated):
    opened, seen = annotated
    answer = opened.localize(seen)
    ids, labels = seen.annotations.instance_id, seen.annotations.labels
    range_m = np.where(np.isnan(seen.range_m), np.inf, seen.range_m).astype(np.float64)
    text = Annotations(ids.astype(np.uint16), {str(id): label for id, label in labels.items()})
    assert opened.localize(range_m=range_m, annotations=text).places == answer.places
    assert answer.places[0].place == "kitchen"


def test_arrays_in_a_wrong_unit_or_without_labels_are_not_localized_in_silence(annotated):
    opened, seen = annotated
    with pytest.raises(DataError, match="range_m has dtype uint16, expected floating-point metres"):
        opened.localize(range_m=np.nan_to_num(seen.range_m * 1000).astype(np.uint16), annotations=seen.annotations)
    with pytest.warns(UserWarning, match="1000 times too large, likely millimetres read as metres"):
        opened.localize(range_m=seen.range_m * 1000, annotations=seen.annotations)
    notes = []
    visible = visible_instances(seen.annotations.instance_id)
    partly = Annotations(seen.annotations.instance_id, {visible[0]: "bed"})
    opened.localize(range_m=seen.range_m, annotations=partly, warn=notes.append)
    (note,) = notes
    assert f"{len(visible) - 1} of {len(visible)} objects of the instance image are ignored" in note
    opened.localize(QueryFrame("a", lambda: Panorama("a", range_m=seen.range_m, annotations=partly)), warn=notes.append)
    assert len(notes) == 2


@pytest.mark.parametrize("query", ["kitchen.jpg", np.zeros((16, 32, 3), np.uint8), 7])
def test_a_query_of_another_kind_is_refused(annotated, query):
    with pytest.raises(DataError, match=r"the query is .*, expected a frame, a Panorama, or arrays as rgb="):
        annotated[0].localize(query)
