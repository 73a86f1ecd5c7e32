"""Maps with added and removed places and merged maps, compared with maps that were built in one step."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from doored_maps import build
from fake_plugin import Reader

from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, DataError, UnknownName
from salframe.framework.files.cache import Cache
from salframe.localization.map import open_map
from salframe.localization.map_files import write_map
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.opening import find_dataset
from salframe.topology.building_map import build_map
from salframe.topology.map_changes import MapChange, add_to_map, merge_maps, remove_from_map
from salframe.topology.store import open_topology, write_topology

HOUSE = "house-6", ("data.height=128", "data.queries_per_room=1")


def content(directory: Path) -> dict[str, str]:
    """The sha256 of each file of a map."""
    return json.loads((directory / "map.json").read_text())["sha256"]


def answers(directory: Path, queries: Sequence[QueryFrame]) -> list[str]:
    """The answers of a map, with all digits."""
    opened = open_map(directory)
    return [str(opened.localize(query)) for query in queries]


@pytest.fixture(scope="module")
def house(tmp_path_factory) -> Callable[[str, Sequence[str]], Path]:
    """A function that writes the folder of a small home with some of its places: their frames, doorways and floor."""
    dataset = find_dataset(*HOUSE[:1], overrides=HOUSE[1])
    manifest = json.loads((dataset.root / "manifest.json").read_text())

    def cut(name: str, places: Sequence[str]) -> Path:
        root = tmp_path_factory.mktemp(name)
        shutil.copytree(dataset.root, root, dirs_exist_ok=True)
        here = [frame for place in places for frame in manifest["frames"] if frame.get("place") == place]
        queries = [frame for frame in manifest["frames"] if frame["role"] == "query"]
        (floor,) = manifest["floors"]
        region = cv2.imread(str(root / floor["region"]), cv2.IMREAD_UNCHANGED)
        labels = {int(label): place for label, place in floor["regions"].items() if place in places}
        elsewhere = (region > 0) & ~np.isin(region, list(labels))
        for mask in ("free", "region", "obstacle"):
            pixels = cv2.imread(str(root / floor[mask]), cv2.IMREAD_UNCHANGED)
            pixels[elsewhere] = 0
            cv2.imwrite(str(root / floor[mask]), pixels)
        cropped = {**manifest, "frames": here + queries, "floors": [{**floor, "regions": labels}]}
        (root / "manifest.json").write_text(json.dumps(cropped))
        return root

    return cut


@pytest.fixture(scope="module")
def halves() -> tuple[list[str], list[str]]:
    """The places of the home's first rooms, and the other places; both include doorways."""
    (fold,) = find_dataset(*HOUSE[:1], overrides=HOUSE[1]).folds()
    places = list(dict.fromkeys(frame.place for frame in fold.references))
    return places[::2], places[1::2]


@pytest.mark.parametrize(
    ("method", "overrides"),
    [("proposed", ()), ("saliency-graph", ("matcher.max_candidates=3",)), ("sift", ("min_inliers=6",))],
)
def test_a_map_that_grew_is_the_one_that_was_built_at_once(house, halves, method, overrides, tmp_path):
    first, second = halves
    build = partial(build_map, method=method, overrides=overrides)
    one, other, both = (house(name, places) for name, places in (("a", first), ("b", second), ("ab", first + second)))
    build(one, tmp_path / "a")
    build(other, tmp_path / "b")
    build(both, tmp_path / "ab")
    queries = find_dataset(str(both)).folds()[0].queries
    expected = answers(tmp_path / "ab", queries)
    assert sum("status=<LocalizationStatus.OK" in answer for answer in expected) >= len(queries) / 3

    shutil.copytree(tmp_path / "a", tmp_path / "grown")
    change = add_to_map(tmp_path / "grown", other)
    assert (change.added, change.replaced, change.removed) == (tuple(sorted(second)), (), ())
    assert content(tmp_path / "grown") == content(tmp_path / "ab")
    assert answers(tmp_path / "grown", queries) == expected

    shutil.copytree(tmp_path / "a", tmp_path / "merged")
    assert merge_maps(tmp_path / "merged", [tmp_path / "b"]) == change
    assert content(tmp_path / "merged") == content(tmp_path / "ab")

    change = remove_from_map(tmp_path / "grown", second)
    assert (change.added, change.replaced, change.removed) == ((), (), tuple(sorted(second)))
    assert content(tmp_path / "grown") == content(tmp_path / "a")
    assert answers(tmp_path / "grown", queries) == answers(tmp_path / "a", queries) != expected


def places(directory: Path) -> list[str]:
    """The place of each reference frame of a map."""
    return [frame.place for frame in open_map(directory).frames]


def test_places_of_the_same_name_are_replaced(doored):
    map = build("map", "doored", "data.rooms=3")
    change = add_to_map(map, "doored", overrides=("data.rooms=4", "data.seed=1"))
    assert change == MapChange(("room-3",), ("room-0", "room-1", "room-2"), (), 4, 4, ())
    assert content(map) == content(build("whole", "doored", "data.rooms=4"))


def test_panoramas_of_the_map_are_not_seen_again(doored, monkeypatch):
    """The map stores all that is needed of them."""
    map, described = build("map"), []
    Cache().clear()
    describe = Reader.describe
    monkeypatch.setattr(
        Reader, "describe", lambda self, panorama: described.append(panorama.id) or describe(self, panorama)
    )
    assert add_to_map(map, "upstairs").added == tuple(f"upper-room-{room}" for room in range(5))
    assert len(described) == 5


def test_an_engine_describes_what_is_added(doored, monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,doored_plugin,salframe_engines")
    registry.cache_clear()
    build("map", "doored", "data.rooms=3")
    shutil.copytree("map", "alone")
    add_to_map("alone", "upstairs")
    Cache().clear()
    monkeypatch.setattr(Reader, "describe", None)  # of this process
    change = add_to_map("map", "upstairs", engine="processes", overrides=("engine.workers=2",))
    assert change.added == tuple(f"upper-room-{room}" for room in range(5))
    assert content(Path("map")) == content(Path("alone"))


def test_two_floors_make_a_building(doored):
    map, upstairs = build("map"), build("above", "upstairs")
    before = content(upstairs)
    change = merge_maps(map, [upstairs])
    assert (change.places, change.frames) == (10, 10)
    assert change.notes == (
        "the 2 floors at z = 0.00, 3.00 m are not connected: add stairs or lifts with `salframe map connect`",
    )
    topology = open_topology(map)
    assert [floor.z_m for floor in topology.floors] == [0.0, 3.0]
    below, above = open_topology(build("below")), open_topology(upstairs)
    assert topology.nodes == below.nodes + above.nodes
    assert topology.edges == below.edges + above.edges
    assert content(upstairs) == before


def test_a_place_that_is_removed_is_off_the_way(doored):
    map = build("map")
    change = remove_from_map(map, ["room-2"])
    assert (change.removed, change.places) == (("room-2",), 4)
    assert "room-2" not in places(map)
    assert not any("room-2" in node.regions for node in open_topology(map).nodes)
    assert "the region room-3 cannot be reached from the other regions" in "".join(change.notes)
    add_to_map(map, "doored", overrides=("data.rooms=5",))
    assert content(map) == content(build("whole"))


def test_a_region_without_panoramas_is_removed_too(doored):
    map = build("map", "doored", "data.rooms=3")
    add_to_map(map, "upstairs")
    assert remove_from_map(map, ["upper-room-4"]).places == 7


def test_a_map_whose_last_floor_is_removed_has_no_topology_any_more(doored):
    map = build("map", "half-masked")
    assert [node.id for node in open_topology(map).nodes] == ["map-0"]
    change = remove_from_map(map, ["room-0"])
    assert change.places == 4
    assert change.notes == ("the topology (graph for routes) was removed: none of the remaining places has a floor",)
    assert content(map).keys() == content(build("plain", "maskless")).keys()


def test_how_the_topology_was_made_stays(doored):
    build_map("doored", "map", "reader", central_nodes=True, overrides=("data.rooms=3",))
    add_to_map("map", "doored", overrides=("data.rooms=5",))
    topology = open_topology("map")
    assert topology.parameters.choose
    assert [node.id for node in topology.nodes if node.kind == "scene"] == [f"room-{room}" for room in range(5)]


def test_a_map_without_a_topology_stays_one(doored):
    build_map("doored", "plain", "reader", topology=False, overrides=("data.rooms=3",))
    assert add_to_map("plain", "maskless").notes == ()
    assert places(Path("plain")) == [f"room-{room}" for room in range(5)]
    merge_maps("plain", [build("above", "upstairs")])
    remove_from_map("plain", ["room-0", "upper-room-1"])
    assert len(places(Path("plain"))) == 8
    assert content(Path("plain")).keys() == {
        name for name in content(Path("above")) if name.partition("/")[0] in ("method.json", "frames", "scenes")
    }


def test_what_a_change_tells_of_progress_and_panoramas(doored):
    calls, map = [], build("map", "doored", "data.rooms=1")
    add_to_map(map, "doored", progress=lambda *call: calls.append(call))
    assert calls == [("doored", 5, 5), *(("reader", done, 5) for done in range(6))]


def test_what_does_not_fit_is_one_line_and_changes_nothing(doored):
    build("map")
    build("bare", "frameless")
    build("same")
    build("upstairs")
    build("above", "upstairs")
    for sharpness in (1, 2):
        overrides = (f"sharpness={sharpness}",)
        build_map("upstairs", f"sharp-{sharpness}", "sharp", overrides=overrides)
    unchanged = {
        folder: content(folder) for folder in map(Path, ("map", "bare", "same", "above", "sharp-1", "sharp-2"))
    }
    at_zero, same_ids = "data.z_m=0", "data.rename_frames=false"
    for change, error, message in (
        (lambda: add_to_map("absent", "nothing"), DataError, "absent contains no map: build one with salframe"),
        (lambda: add_to_map("bare", "doored"), DataError, "bare cannot localize: no reference frame"),
        (lambda: add_to_map("map", "frameless"), DataError, "received no reference frame, expected at least one"),
        (lambda: add_to_map("map", "doored", overrides=("offset=1",)), ConfigError, r"expected data\.KEY"),
        (
            lambda: add_to_map("map", "upstairs", overrides=(same_ids,)),
            DataError,
            "two frames have the id map-0 .room-0 in map, upper-room-0 in upstairs., expected different ids",
        ),
        (
            lambda: add_to_map("upstairs", "upstairs", overrides=(same_ids,)),  # of the same name as the data
            DataError,
            "two frames have the id map-0 .room-0 in upstairs, upper-room-0 in upstairs., expected",
        ),
        (
            lambda: add_to_map("map", "upstairs", overrides=(at_zero,)),
            DataError,
            "the floor at z = 0 m assign most of the area of room-0, a place of the map, to other places: use",
        ),
        (lambda: remove_from_map("map", ["rom-1"]), UnknownName, "unknown place 'rom-1', did you mean 'room-1'"),
        (
            lambda: remove_from_map("map", [f"room-{room}" for room in range(5)]),
            ConfigError,
            "cannot remove all places of map, expected at least one place to remain",
        ),
        (
            lambda: merge_maps("map", ["same"]),
            DataError,
            "the maps map and same both contain the places room-0, room-1, .*, expected different places: remove these",
        ),
        (
            lambda: merge_maps("map", ["above", "above"]),
            DataError,
            "the maps above and above both contain the places upper-room-0",
        ),
        (
            lambda: merge_maps("map", ["sharp-1"]),
            DataError,
            "sharp-1 was built with the method 'sharp', expected 'reader', the method of map",
        ),
        (
            lambda: merge_maps("sharp-1", ["sharp-2"]),
            DataError,
            "sharp-2 and sharp-1 were built with different values of the setting sharpness, expected the same settings "
            "and weights of the method 'sharp' in all maps "
            "to merge",
        ),
    ):
        with pytest.raises(error, match=message) as caught:
            change()
        assert "\n" not in str(caught.value)
    assert {folder: content(folder) for folder in unchanged} == unchanged
    assert not Path("absent").exists()


def test_a_map_that_holds_something_else_is_one_line(doored):
    map = build("map")
    (old,) = map.glob("parts-*")
    with write_map(map) as parts:
        shutil.copytree(old, parts.folder, dirs_exist_ok=True)
        shutil.rmtree(parts.folder / "scenes")
        parts.write_table("scenes", [{"hall": np.array(number)} for number in range(5)])
    with pytest.raises(DataError, match="is damaged: the method 'reader' cannot read the arrays; build the map again"):
        remove_from_map(map, ["room-1"])


def test_a_map_that_is_open_goes_on(doored):
    map = build("map")
    build("before")
    opened, topology = open_map(map), open_topology(map)
    add_to_map(map, "upstairs")
    opened.save(Path("copy"))
    with write_map(Path("again")) as parts:
        write_topology(parts, topology)
    assert {**content(Path("copy")), **content(Path("again"))} == content(Path("before"))
