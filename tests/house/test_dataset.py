"""The `house` dataset: rendered once, resumed, read by the folder's reader, and nothing of the truth in its queries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from salframe_house.dataset import House
from salframe_house.rendering import buildings

from salframe.framework.components.presets import configure, settings
from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import VISIBLE_PIXELS


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def house(cache: Path, monkeypatch: pytest.MonkeyPatch) -> House:
    """Six small rooms without colour, rendered by the first test that asks."""
    monkeypatch.setenv("SALFRAME_CACHE", str(cache))
    data = House(House.Config(rooms=6, rgb=False, height=128, queries_per_room=1))
    data.prepare(lambda done, total: None)
    return data


def test_frames_have_what_they_should(house: House) -> None:
    (fold,) = house.folds()
    assert house.provides == {"range", "annotations"} == fold.references[0].load().provides
    assert len(fold.queries) == 6
    rooms = {frame.place for frame in fold.references if not frame.place.startswith("transition")}
    assert len(rooms) == 6
    assert {house.truth(query.id).place for query in fold.queries} == rooms
    assert not any(room in query.id for query in fold.queries for room in rooms)
    (floor,) = house.floors()
    assert set(floor.regions.values()) == rooms


def test_a_hidden_place_is_gone_with_its_doorways_and_nothing_is_rendered_again(house: House) -> None:
    hidden = House(house.config.model_copy(update={"hide_query_place": True}))
    assert hidden.root == house.root
    assert hidden.content_key == house.content_key
    assert hidden.query_key != house.query_key
    whole, *without = hidden.folds()
    assert len(without) == 6
    for fold in without:
        (query,) = fold.queries
        place = hidden.truth(query.id).place
        gone = {frame.id: frame for frame in whole.references if frame.id not in {kept.id for kept in fold.references}}
        rooms = [frame for frame in gone.values() if frame.place == place]
        doors = [frame for frame in gone.values() if frame.place != place]
        assert rooms
        assert not any(frame.place == place for frame in fold.references)
        # a room has a door at least, and a door is at its edge: its floor is on one side within a step
        assert doors
        assert all(door.place.startswith("transition") for door in doors)
        (floor,) = house.floors()
        label = next(number for number, name in floor.regions.items() if name == place)
        for door in doors:
            x_m, y_m = door.T_world_pano[:2, 3]
            column = round((x_m - floor.origin_m[0]) / floor.resolution_m)
            row = round((floor.origin_m[1] - y_m) / floor.resolution_m)
            step = int(1.0 / floor.resolution_m)
            assert (floor.region[row - step : row + step + 1, column - step : column + step + 1] == label).any()


def test_range_and_truth_agree(house: House) -> None:
    """Straight down, the range is the camera's height; the visible instances are those of at least 50 pixels."""
    for query in house.folds()[0].queries:
        panorama, truth = query.load(), house.truth(query.id)
        down = panorama.range_m[-1]
        floor = panorama.annotations.instance_id[-1] == 0
        np.testing.assert_allclose(down[floor], truth.T_world_pano[2, 3], rtol=2e-3)
        ids, pixels = np.unique(panorama.annotations.instance_id, return_counts=True)
        assert set(truth.instances) == set(ids[(pixels >= VISIBLE_PIXELS) & (ids > 0)].tolist())
        assert set(truth.instances) <= set(panorama.annotations.labels)


def test_objects_lie_where_the_table_says(house: House) -> None:
    """Points of the map's instance images fall into the boxes of objects.parquet."""
    rows = {row["instance_id"]: row for row in pq.read_table(house.root / "objects.parquet").to_pylist()}
    checked = 0
    for frame in house.folds()[0].references:
        panorama = frame.load()
        points = (
            equirectangular_rays(128) * panorama.range_m[..., None] @ frame.T_world_pano[:3, :3].T
            + frame.T_world_pano[:3, 3]
        )
        for instance in np.unique(panorama.annotations.instance_id[panorama.annotations.instance_id > 0]):
            row = rows[int(instance)]
            assert row["label"] == panorama.annotations.labels[int(instance)]
            off = points[panorama.annotations.instance_id == instance] - (row["x_m"], row["y_m"], row["z_m"])
            c, s = np.cos(row["yaw_rad"]), np.sin(row["yaw_rad"])
            own = np.abs(np.column_stack([off[:, 0] * c + off[:, 1] * s, off[:, 1] * c - off[:, 0] * s, off[:, 2]]))
            assert (own <= np.array([row["length_m"], row["width_m"], row["height_m"]]) / 2 + 0.02).all(), row
            checked += 1
    assert checked > 20


def test_rendering_resumes(house: House, monkeypatch: pytest.MonkeyPatch) -> None:
    """With one frame and the manifest lost, that frame alone is rendered again, to the same bytes."""
    lost = sorted(house.root.glob("frames/*.range.png"))[3]
    content, kept = (
        lost.read_bytes(),
        {path: path.stat().st_mtime_ns for path in house.root.glob("frames/*") if path != lost},
    )
    manifest = (house.root / "manifest.json").read_bytes()
    (shared,) = [path for path in house.root.parent.glob("frames/*/*.range.png") if path.samefile(lost)]
    shared.unlink()
    lost.unlink()
    (house.root / "manifest.json").unlink()
    told = []
    again = House(house.config)
    again.prepare(lambda done, total: told.append((done, total)))
    total = len(again.folds()[0].references) + len(again.folds()[0].queries)
    assert told == [(total - 1, total), (total, total)]
    assert lost.read_bytes() == content
    assert (house.root / "manifest.json").read_bytes() == manifest
    assert sum(path.stat().st_mtime_ns != time for path, time in kept.items()) == 1  # the lost frame's other image
    again.prepare(lambda done, total: pytest.fail("rendered what was there"))


def test_fingerprint_is_that_of_the_settings(house: House) -> None:
    assert house.fingerprint == House(house.config).fingerprint
    assert house.fingerprint != House(house.config.model_copy(update={"seed": 1})).fingerprint


def test_room_types_are_told_of_every_room(house: House) -> None:
    types = house.room_types()
    assert {house.truth(query.id).place for query in house.folds()[0].queries} <= set(types)
    assert all(place.rpartition("-")[0] == kind for place, kind in types.items())


@pytest.mark.parametrize(
    ("name", "rooms", "style"),
    [("house-6", 6, "home"), ("house-12", 12, "home"), ("house-42", 42, "office"), ("house-106", 106, "office")],
)
def test_presets(name: str, rooms: int, style: str) -> None:
    config = configure("dataset", name, settings("dataset", name), [{"seed": 5}])
    assert (config.rooms, config.style, config.seed, config.height, config.rgb) == (rooms, style, 5, 512, True)
    assert (config.queries_per_room, config.changed_fraction) == (3, 0.1)
    with pytest.raises(ConfigError, match=r"unknown setting house-6\.colour"):
        configure("dataset", "house-6", settings("dataset", "house-6"), [{"colour": True}])


def test_a_building_of_too_many_rooms_is_refused_at_once() -> None:
    with pytest.raises(
        ConfigError, match=r"house-6\.rooms: received 100000000, expected a number less than or equal to 500"
    ):
        configure("dataset", "house-6", settings("dataset", "house-6"), [{"rooms": 100_000_000}])


def test_furniture_is_known_by_its_content_not_by_its_folder(tmp_path: Path) -> None:
    def known(folder: str, content: bytes) -> str:
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "library.sh3f").write_bytes(content)
        return House(House.Config(models=tmp_path / folder)).fingerprint

    assert known("here", b"sofa") == known("there", b"sofa") != known("there", b"chair")
    assert House().fingerprint not in (known("here", b"sofa"), known("there", b"chair"))


def test_queries_without_range_and_with_range_off_by_a_factor(
    house: House, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The map is the same, and the queries but for their range."""
    plain = house.folds()[0]
    made = {}
    for name, options in {"none": {"query_range": False}, "off": {"query_scale_share": 0.2}}.items():
        data = House(House.Config(rooms=6, rgb=False, height=128, queries_per_room=1, **options))
        data.prepare(lambda done, total: None)
        (made[name],) = data.folds()
        np.testing.assert_array_equal(made[name].references[0].load().range_m, plain.references[0].load().range_m)
        assert data.provides == ({"annotations"} if name == "none" else {"range", "annotations"})
    factors = []
    for query, none, off in zip(plain.queries, made["none"].queries, made["off"].queries, strict=True):
        panorama = query.load()
        assert none.load().provides == {"annotations"}
        np.testing.assert_array_equal(none.load().annotations.instance_id, panorama.annotations.instance_id)
        ratio = off.load().range_m / panorama.range_m
        factors.append(np.nanmedian(ratio))
        np.testing.assert_allclose(ratio, factors[-1], atol=3e-3)  # both are kept to the millimetre
    assert np.std(factors) == pytest.approx(0.2, rel=0.6)
    assert len(set(factors)) == 6


@pytest.mark.slow
def test_colour_is_rendered_under_other_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    data = House(House.Config(rooms=4, height=128, queries_per_room=1, lighting="dim"))
    data.prepare(lambda done, total: None)
    (fold,) = data.folds()
    day = np.mean([frame.load().rgb.mean() for frame in fold.references])
    dim = np.mean([frame.load().rgb.mean() for frame in fold.queries])
    assert day > dim + 25


def test_it_renders_where_the_agent_stands(house: House) -> None:
    """A panorama observed where a query stands is that query's; its name tells the pose, so that detector noise differs
    by pose."""
    for query in house.folds()[0].queries[:2]:
        pose = house.truth(query.id).T_world_pano
        seen, stored = house.observe(pose), query.load()
        np.testing.assert_array_equal(seen.annotations.instance_id, stored.annotations.instance_id)
        np.testing.assert_allclose(np.nan_to_num(seen.range_m), np.nan_to_num(stored.range_m), atol=1e-3)
        assert seen.annotations.labels == stored.annotations.labels
        assert seen.provides == house.provides
        assert seen.id == house.observe(pose).id
    assert len({house.observe(house.truth(query.id).T_world_pano).id for query in house.folds()[0].queries}) == 6


def test_what_was_moved_stops_the_agent_and_is_not_on_its_map(house: House) -> None:
    (world,) = house.worlds()
    (floor,) = house.floors()
    building, changed = buildings("home", 6, 0, 0.1)
    assert not np.array_equal(building.floor_masks().obstacle, changed.floor_masks().obstacle)
    np.testing.assert_array_equal(floor.obstacle, building.floor_masks().obstacle)
    new = changed.floor_masks().obstacle & floor.free & ~floor.obstacle
    row, column = np.argwhere(new)[new.sum() // 2]
    x, y = floor.origin_m[0] + (column + 0.5) * floor.resolution_m, floor.origin_m[1] - (row + 0.5) * floor.resolution_m
    with pytest.raises(DataError, match="is in a wall or obstacle"):
        world.stand(x, y, 0.0)


def test_storeys_are_buildings_of_successive_seeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    settings = {"style": "home", "rooms": 4, "queries_per_room": 1, "height": 64, "rgb": False}
    both = House(House.Config(**settings, seed=5, storeys=2))
    upper = House(House.Config(**settings, seed=6))
    for dataset in (both, upper):
        dataset.prepare(lambda done, total: None)
    of_upper = {frame.id: frame for frame in reference_frames(upper)}
    frames = {frame.id: frame for frame in reference_frames(both)}
    assert {id for id in frames if id.startswith("2-")} == {f"2-{id}" for id in of_upper}
    for id, frame in of_upper.items():
        raised = frames[f"2-{id}"]
        assert raised.place == f"2-{frame.place}"
        np.testing.assert_allclose(raised.T_world_pano[:3, 3] - frame.T_world_pano[:3, 3], (0, 0, 3.0), atol=1e-9)
        np.testing.assert_array_equal(raised.load().range_m, frame.load().range_m)
    queries = [query.id for query in both.folds()[0].queries]
    assert len(set(queries)) == 8
    assert [both.truth(id).place[:2] for id in queries] == ["1-"] * 4 + ["2-"] * 4
    assert [floor.z_m for floor in both.floors()] == [0.0, 3.0]
    (stairs,) = both.connections()
    assert (stairs.start[:2], stairs.end[:2]) == ("1-", "2-")
    lower_ids, upper_ids = (
        {id for frame in frames.values() if frame.id.startswith(name) for id in np.unique(ids(frame)) if id}
        for name in ("1-", "2-")
    )
    assert not lower_ids & upper_ids
    first = of_upper[next(iter(of_upper))]
    raised = first.T_world_pano.copy()
    raised[2, 3] += 3.0
    np.testing.assert_array_equal(both.observe(raised).range_m, upper.observe(first.T_world_pano).range_m)


def test_signs_on_several_storeys_are_refused() -> None:
    with pytest.raises(ValueError, match="received signs=true with storeys=2, expected storeys=1 or signs=false"):
        House.Config(rooms=4, signs=True, storeys=2)


def ids(frame) -> np.ndarray:
    return frame.load().annotations.instance_id
