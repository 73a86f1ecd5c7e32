"""Answers as notebooks show them."""

from __future__ import annotations

import numpy as np
import pytest
from robustness.small_building import write_floors
from shown_html import HOSTILE, SHOWN, ShownHtml
from tracked_folder import poses, write_tracked_folder

from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.map import LocalizationMap
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.geometry import pose_2d
from salframe.testing.rooms import ROOMS, look


def floor() -> FloorMasks:
    """6 m x 4 m from (0, 0)."""
    free = np.ones((80, 120), bool)
    return FloorMasks(free, free.astype(np.int32), np.zeros_like(free), 0.05, (0.0, 4.0), {1: HOSTILE})


def places(count: int) -> tuple[RankedPlace, ...]:
    return tuple(RankedPlace(f"f{i}", HOSTILE if i == 0 else f"room-{i}", 1.0, 0.5 / 2**i) for i in range(count))


def test_an_answer_has_its_places_its_pose_and_a_plan():
    covariance = np.diag([0.04, 0.01, 0.001])
    ranked = places(8)
    rest = 1 - sum(place.probability for place in ranked)
    answer = Localization(
        ranked,
        pose_2d(2.0, 1.0, np.pi / 2, 1.5),
        LocalizationStatus.OK,
        covariance,
        out_of_map_probability=rest,
        notes=(HOSTILE,),
        floors=(floor(),),
    )
    shown = ShownHtml(answer._repr_html_())
    assert shown.texts[:7] == ["status: ok", "place", "frame", "probability", SHOWN, "f0", "50.0%"]
    assert "other places (3)" in shown.texts
    assert f"{sum(place.probability for place in ranked[5:]):.1%}" in shown.texts
    assert shown.texts[shown.texts.index("out-of-map") + 1] == f"{rest:.1%}"
    assert "pose: x 2.00 m, y 1.00 m, z 1.50 m, yaw 90.0 deg" in shown.texts
    assert f"note: {SHOWN}" in shown.texts
    assert shown.texts.count(SHOWN) == 2  # in the table and on the plan
    *_, ellipse, _ = shown.all("path")
    points = np.array([point.split(",") for point in ellipse["d"].strip("MZ").split()], float)
    scale = (420 - 24) / 5.95  # the outline passes through the middle of the outermost pixels
    assert np.ptp(points, axis=0) / scale == pytest.approx(np.array([0.4, 0.2]) * np.sqrt(5.991), abs=0.02)


def test_an_answer_without_probabilities_has_scores_and_one_without_floors_no_plan():
    ranked = (RankedPlace("f", "hall", 0.25),)
    shown = ShownHtml(Localization(ranked, np.eye(4), LocalizationStatus.OK)._repr_html_())
    assert shown.texts[1:7] == ["place", "frame", "score", "hall", "f", "0.25"]
    assert not shown.all("svg")


def test_a_failed_answer_has_its_status():
    assert ShownHtml(Localization((), None, LocalizationStatus.NO_OBJECTS)._repr_html_()).texts == [
        "status: no-objects"
    ]


def test_the_answer_of_a_map_with_floors_has_a_plan(tmp_path):
    write_tracked_folder(tmp_path)
    write_floors(tmp_path)
    dataset = FolderDataset(FolderDataset.Config(root=tmp_path))
    localizer = registry().build("localizer", configure_default("localizer", "proposed", [{"detector": "annotations"}]))
    map = LocalizationMap.build(localizer, dataset.folds()[0].references, floors=dataset.floors())
    answer = map.localize(look(ROOMS[0], "query", poses()[0]))
    assert "bedroom" in ShownHtml(answer._repr_html_()).texts
    assert ShownHtml(answer._repr_html_()).all("svg")
