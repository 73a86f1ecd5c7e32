"""What queries show: how much of the sphere a view takes, what lies outside, and who shares what is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny_folder import write_tiny_folder

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import InputMissing
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.geometry import pixel_solid_angles
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama
from salframe.panoramas.query_view import as_query, is_in_view

HEIGHT = 256


def whole() -> Panorama:
    shape = (HEIGHT, 2 * HEIGHT)
    ids = np.arange(shape[0] * shape[1], dtype=np.int32).reshape(shape) % 9
    return Panorama(
        "p",
        np.full((*shape, 3), 200, np.uint8),
        np.full(shape, 2, np.float32),
        annotations=Annotations(ids, {key: f"thing-{key}" for key in range(1, 9)}),
    )


def config(**settings) -> FolderDataset.Config:
    return FolderDataset.Config(**settings)


def steradians(valid: np.ndarray) -> float:
    return float((valid * pixel_solid_angles(len(valid))[:, None]).sum())


@pytest.mark.parametrize("fov_deg", [60, 120, 180])
def test_a_field_of_view_is_that_lune_around_the_heading(fov_deg: float) -> None:
    """A lune of that angle has 2 x angle steradians, and its middle is the middle of the image."""
    query = as_query(whole(), config(query_fov_deg=fov_deg))
    assert steradians(query.valid) == pytest.approx(2 * np.radians(fov_deg), abs=0.05)
    columns = np.flatnonzero(query.valid.all(0))
    assert columns.mean() == HEIGHT - 0.5
    assert len(columns) == pytest.approx(2 * HEIGHT * fov_deg / 360, abs=2)
    outside = ~query.valid
    assert np.isnan(query.range_m[outside]).all()
    assert not query.rgb[outside].any()
    assert not query.annotations.instance_id[outside].any()
    before = whole()
    np.testing.assert_array_equal(query.rgb[query.valid], before.rgb[query.valid])
    np.testing.assert_array_equal(query.range_m[query.valid], before.range_m[query.valid])
    np.testing.assert_array_equal(
        query.annotations.instance_id[query.valid], before.annotations.instance_id[query.valid]
    )


@pytest.mark.parametrize(("focal", "across_deg", "up_deg"), [(1, 90, 73.74), (2, 53.13, 41.11), (3, 36.87, 28.07)])
def test_a_rectilinear_view_is_as_wide_and_high_as_its_focal_length_says(
    focal: float, across_deg: float, up_deg: float
) -> None:
    """The solid angle of a rectangle before the eye is 4 arcsin(sin(across / 2) sin(up / 2))."""
    query = as_query(whole(), config(query_focal=focal))
    angle = 4 * np.arcsin(np.sin(np.radians(across_deg / 2)) * np.sin(np.radians(up_deg / 2)))
    assert steradians(query.valid) == pytest.approx(angle, abs=0.03)
    middle_row, middle_column = query.valid[HEIGHT // 2], query.valid[:, HEIGHT]
    assert middle_row.sum() == pytest.approx(across_deg / 180 * HEIGHT, abs=2)
    assert middle_column.sum() == pytest.approx(up_deg / 180 * HEIGHT, abs=2)


def test_both_limits_hold_together_and_with_those_of_the_panorama() -> None:
    half = np.zeros((HEIGHT, 2 * HEIGHT), bool)
    half[: HEIGHT // 2] = True
    taken = Panorama("p", rgb=whole().rgb, valid=half)
    query = as_query(taken, config(query_fov_deg=40, query_focal=1))
    assert not query.valid[HEIGHT // 2 :].any()
    assert query.valid[HEIGHT // 2 - 1].sum() == pytest.approx(40 / 180 * HEIGHT, abs=2)


def test_listed_objects_are_seen_where_their_middle_is() -> None:
    """At 0, 29, 31, 180 and -29 deg, and one right above at 40 deg."""
    azimuth, elevation = np.radians([0, 29, 31, 180, -29, 0]), np.radians([0, 0, 0, 0, 0, 40])
    centroid_m = 3 * np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1
    )
    boxes = ObjectBoxes(tuple("abcdef"), tuple("uvwxyz"), centroid_m, np.ones((6, 3)), np.arange(6.0))
    taken = Panorama("p", annotations=Annotations(objects=boxes))
    query = as_query(taken, config(query_fov_deg=60))
    assert query.annotations.objects.labels == ("a", "b", "e", "f")
    assert query.annotations.objects.keys == ("u", "v", "y", "z")
    np.testing.assert_array_equal(query.annotations.objects.yaw_rad, [0, 1, 4, 5])
    assert steradians(query.valid) == pytest.approx(np.radians(120), abs=0.05)
    assert as_query(taken, config(query_focal=1)).annotations.objects.labels == ("a", "b", "c", "e")


def test_nothing_is_seen_in_an_unknown_direction() -> None:
    assert is_in_view(np.array([[np.nan] * 3, [1.0, 0, 0]]), 120, None).tolist() == [False, True]


def test_without_settings_a_query_is_what_was_taken() -> None:
    taken = whole()
    assert as_query(taken, config()) is taken
    assert as_query(taken, ComponentConfig.model_construct()) is taken


def test_errors_take_annotations() -> None:
    with pytest.raises(InputMissing, match="p has no annotations, which the setting query_noise needs"):
        as_query(Panorama("p", whole().rgb), config(query_noise={"missed": 0.5}))


def test_image_changes_take_colour() -> None:
    with pytest.raises(InputMissing, match="p has no colour image, which the setting query_image needs"):
        as_query(Panorama("p", range_m=whole().range_m), config(query_image={"exposure_ev": -2}))


def test_image_changes_affect_only_the_colour_inside_the_view(tmp_path: Path) -> None:
    """Grey of 200 has linear light 0.5776; a quarter of it is 106 in sRGB."""
    before = whole()
    query = as_query(before, config(query_image={"exposure_ev": -2}, query_fov_deg=90))
    assert (query.rgb[query.valid] == 106).all()
    assert not query.rgb[~query.valid].any()
    np.testing.assert_array_equal(query.range_m[query.valid], before.range_m[query.valid])
    root = write_tiny_folder(tmp_path / "folder")
    plain, dark = (FolderDataset(config(root=root, query_image={"exposure_ev": ev})) for ev in (0, -2))
    for frames, is_changed in (("references", False), ("queries", True)):
        pair = [getattr(dataset.view(dataset.folds())[0], frames)[0] for dataset in (plain, dark)]
        assert np.array_equal(*(frame.load().rgb for frame in pair)) != is_changed
        assert np.array_equal(*(frame.load().annotations.instance_id for frame in pair))
    assert plain.fingerprint == dark.fingerprint
    assert plain.content_key != dark.content_key


SETTINGS = [{"query_fov_deg": 90.0}, {"query_focal": 2.0}, {"query_noise": {"missed": 0.5}}]


@pytest.mark.parametrize("settings", SETTINGS)
def test_a_folder_shows_its_queries_so_and_its_map_as_it_is(tmp_path: Path, settings: dict) -> None:
    root = write_tiny_folder(tmp_path / "folder")
    plain, narrowed = FolderDataset(config(root=root)), FolderDataset(config(root=root, **settings))
    for before, after in zip(plain.folds()[0].references, narrowed.folds()[0].references, strict=True):
        np.testing.assert_array_equal(before.load().annotations.instance_id, after.load().annotations.instance_id)
        assert after.load().valid is None
        assert (before.content or plain.content_key) == (after.content or narrowed.content_key)
    for before, after in zip(plain.folds()[0].queries, narrowed.folds()[0].queries, strict=True):
        ids = [frame.load().annotations.instance_id for frame in (before, after)]
        assert not np.array_equal(*ids)
        assert (before.content or plain.content_key) != (after.content or narrowed.content_key)
        assert plain.truth(before.id) == narrowed.truth(after.id) or plain.truth(before.id).place
    assert plain.content_key != narrowed.content_key
    assert plain.query_key != narrowed.query_key
    assert plain.fingerprint == narrowed.fingerprint


def test_every_view_is_kept_apart(tmp_path: Path) -> None:
    root = write_tiny_folder(tmp_path / "folder")
    sets = [
        FolderDataset(config(root=root, **settings)) for settings in ({}, *SETTINGS, {"query_noise": {"missed": 0.6}})
    ]
    assert len({one.content_key for one in sets}) == 5
    assert len({one.folds()[0].queries[0].content for one in sets}) == 5
