"""Which buildings share rendered frames: where they do, the pixels are the same."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from salframe_engines import Inline
from salframe_house.building import Building, generate_building
from salframe_house.dataset import House

from salframe.framework.components.identity import identity
from salframe.framework.files.hashes import digest

BASE = {"rooms": 4, "height": 64, "queries_per_room": 1}
OTHERS = {
    "style": "office",
    "rooms": 5,
    "storeys": 2,
    "seed": 1,
    "height": 128,
    "rgb": False,
    "models": Path(__file__).parent,  # whatever is in there: it is not built
    "models_part": "training",
    "queries_per_room": 2,
    "frames_per_room": 1,
    "frames_per_position": 2,
    "map_spacing_m": 0.5,
    "map_range": False,
    "query_shift_m": 0.4,
    "query_yaw": "normal",
    "lighting": "dim",
    "changed_fraction": 0.6,
    "changes": "by-class",
    "change_kinds": ("removed",),
    "query_range": False,
    "query_scale_share": 0.3,
    "hide_query_place": True,
    "query_fov_deg": 90.0,
    "query_focal": 2.0,
    "query_noise": {"missed": 0.5},
    "query_image": {"exposure_ev": -2.0},
    "query_views": 2,
    "query_motion": "driven",
    "query_odometry": {"drift_share": 0.1},
    "query_errors": "per-view",
    "query_tilt_deg": 8.0,
    "query_height_m": 1.0,
    "signs": True,
    "signs_unreadable": 0.5,
    "signs_wrong": 0.5,
}
"""Another value of every setting."""
OF_THE_MAP = {"style", "rooms", "storeys", "seed", "height", "rgb", "models", "models_part", "signs"}
"""Settings that other reference frames come of."""
OF_QUERIES = {
    *("changed_fraction", "changes", "change_kinds", "query_range", "query_scale_share"),
    *("signs_unreadable", "signs_wrong"),
}
"""Settings that other pixels of a query come of, wherever it stands."""


def keys(house: House) -> dict[str, str]:
    """What the images of a frame are shared by, by what the frame is."""
    return {digest(asdict(frame)): house._key(frame) for frame in house.list_frames()}


def test_there_is_another_value_of_every_setting() -> None:
    assert OTHERS.keys() == House.Config.model_fields.keys() - {"kind"}


@pytest.mark.parametrize("name", sorted(OTHERS))
def test_frames_are_shared_where_their_pixels_are_the_same(name: str) -> None:
    one, other = House(House.Config(**BASE)), House(House.Config(**{**BASE, name: OTHERS[name]}))
    frames = one.list_frames()
    if name in ("models", "models_part"):  # furniture of another shape
        assert not any(one._key(frame) == other._key(frame) for frame in frames)
        return
    beside = {digest(asdict(frame)) for frame in other.list_frames()}
    shared = [frame for frame in frames if digest(asdict(frame)) in beside and one._key(frame) == other._key(frame)]
    of_map = [frame for frame in frames if not frame.is_query]
    if name == "map_range":  # the reference frames are stored without range, the queries are the same
        assert {frame.id for frame in shared} == {frame.id for frame in frames if frame.is_query}
        return
    if name in OF_THE_MAP:
        assert shared == []
    else:
        assert {frame.id for frame in shared} >= {frame.id for frame in of_map if digest(asdict(frame)) in beside}
        assert any(frame.role == "map" for frame in shared)
    if name in OF_QUERIES:
        assert not any(frame.is_query for frame in shared)
    if name not in OF_THE_MAP | OF_QUERIES | {"frames_per_room"}:
        assert keys(one).items() & keys(other).items() >= {
            item for item in keys(one).items() if item[0] in {digest(asdict(frame)) for frame in of_map}
        }
    for frame in [*[f for f in shared if not f.is_query][:2], *[f for f in shared if f.is_query][:1]]:
        before, after = one.render(frame), other.render(frame)
        np.testing.assert_array_equal(before.rgb, after.rgb)
        np.testing.assert_array_equal(before.range_m, after.range_m)
        np.testing.assert_array_equal(before.annotations.instance_id, after.annotations.instance_id)
        ids = np.unique(before.annotations.instance_id)
        assert all(before.annotations.labels[i] == after.annotations.labels[i] for i in ids if i)


def test_arms_that_change_queries_alone_render_the_map_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    monkeypatch.setattr(House, "engine", Inline())
    base = {**BASE, "rgb": False}
    first = House(House.Config(**base))
    first.prepare(lambda done, total: None)
    count = len(first.list_frames())
    queries = len(first.folds()[0].queries)
    arms = [
        ({"query_fov_deg": 90.0}, 0),
        ({"query_noise": {"missed": 0.5}}, 0),
        ({"query_shift_m": 0.0}, queries),
        ({"changed_fraction": 0.5, "change_kinds": ["moved"]}, queries),
        ({"seed": 1}, count),
    ]
    for settings, rendered in arms:
        arm = House(House.Config(**{**base, **settings}))
        told: list[tuple[int, int]] = []
        arm.prepare(lambda done, total, told=told: told.append((done, total)))
        new = told[-1][1] - told[0][0] if told else 0
        assert new == (len(arm.list_frames()) if "seed" in settings else rendered), settings
        shared = {f.content for f in arm.folds()[0].references} & {f.content for f in first.folds()[0].references}
        assert len(shared) == (0 if "seed" in settings else count - queries), settings
        assert not {f.content for f in arm.folds()[0].queries} & {f.content for f in first.folds()[0].queries}


def test_navigation_looks_through_the_settings_of_queries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    base = {**BASE, "rgb": False}
    pose = House(House.Config(**base)).list_frames()[0].pose
    whole, half = (House(House.Config(**base, **more)).observe(pose) for more in ({}, {"query_fov_deg": 180.0}))
    assert whole.valid is None
    assert half.valid.mean() == 0.5
    np.testing.assert_array_equal(half.range_m[half.valid], whole.range_m[half.valid])
    blind = House(House.Config(**base, query_noise={"missed": 1.0})).observe(pose)
    assert whole.annotations.instance_id.any()
    assert not blind.annotations.instance_id.any()


def test_a_new_version_of_the_masks_replaces_old_ones_and_renders_no_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    monkeypatch.setattr(House, "engine", Inline())
    settings = {**BASE, "rgb": False}
    truth = generate_building("home", BASE["rooms"], 0).floor_masks()
    with monkeypatch.context() as older:
        older.setattr("salframe_house.dataset.MASKS_VERSION", 1)
        older.setattr(Building, "floor_masks", lambda self: replace(truth, free=np.zeros_like(truth.free)))
        old = House(House.Config(**settings))
        old.prepare(lambda done, total: None)
        assert not old.floors()[0].free.any()
    monkeypatch.setattr(House, "render", lambda self, frame: pytest.fail(f"{frame.id} was rendered again"))
    new = House(House.Config(**settings))
    new.prepare(lambda done, total: None)
    np.testing.assert_array_equal(new.floors()[0].free, truth.free)
    assert identity(new.config) == identity(old.config), "the key of stored results"
    assert new.content_key != old.content_key, "the key of the answers of runs"
    references = [dataset.folds()[0].references for dataset in (old, new)]
    assert [frame.content for frame in references[0]] == [frame.content for frame in references[1]]
