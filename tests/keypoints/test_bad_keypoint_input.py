"""Checkpoints, views and maps that a keypoint method cannot use. The result is a status or a one-line reason, and other
methods continue."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from conformance import conforms, runnable
from salframe_keypoints.localizer import Keypoints
from tiny_folder import write_tiny_folder

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.components.presets import configure, settings
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_2d, pose_errors
from salframe.panoramas.panorama import Panorama

SMALL = ("view_width_px=240", "view_height_px=176", "features.max_keypoints=200", "hypotheses=100")
QUERY = pose_2d(0.5, -0.3, 1.2)


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return write_tiny_folder(tmp_path / "tiny")


def run(folder, methods, *overrides):
    """Return the rows by method."""
    result = compare(Request(methods, str(folder), settings=(*SMALL, *overrides), engine="inline"))
    return {row.method: row for row in result.rows}


def edit_manifest(folder, change):
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["frames"] = [change(frame) for frame in manifest["frames"] if change(frame)]
    path.write_text(json.dumps(manifest))


def test_a_checkpoint_that_is_missing_or_another_networks_costs_its_own_row(tiny, tmp_path):
    torch = pytest.importorskip("torch")
    pytest.importorskip("kornia")
    other, none = tmp_path / "other.pt", tmp_path / "none.pt"
    torch.save({"conv.weight": torch.zeros(1)}, other)
    rows = run(
        tiny,
        ["xfeat-nn", "aliked-nn", "sift"],
        f"xfeat-nn.features.checkpoint={other}",
        f"aliked-nn.features.checkpoint={none}",
    )
    assert not rows["xfeat-nn"].available
    assert "other.pt does not match the network XFeatModel" in rows["xfeat-nn"].reason
    assert f"{none} does not exist" in rows["aliked-nn"].reason
    assert rows["sift"].accuracy is not None


def test_a_map_without_range_gives_places_and_no_pose(tiny):
    edit_manifest(tiny, lambda frame: {key: value for key, value in frame.items() if key != "range"})
    row = run(tiny, ["sift"])["sift"]
    assert row.status == {"no-pose": 3}
    assert row.accuracy.value == 1
    assert row.median_translation_m is None


def test_a_map_of_one_frame_answers_with_its_place(tiny):
    edit_manifest(tiny, lambda frame: frame if frame["role"] == "query" or frame["id"] == "kitchen-map" else None)
    row = run(tiny, ["sift"])["sift"]
    assert sum(row.status.values()) == 3
    assert row.accuracy.value == pytest.approx(1 / 3)


def test_a_query_without_texture_fails_and_the_others_do_not(tiny):
    cv2.imwrite(str(tiny / "frames" / "lounge-query.rgb.png"), np.full((192, 384, 3), 128, np.uint8))
    row = run(tiny, ["sift"])["sift"]
    assert row.status["no-features"] == 1
    assert row.accuracy.value == pytest.approx(2 / 3)


def test_views_without_texture_leave_the_pose_to_the_others(rooms, configure):
    """Half of the query is one uniform colour, like a near white wall."""
    localizer = Keypoints(configure("sift", view_width_px=240, view_height_px=176))
    built = LocalizationMap.build(
        localizer, [room.reference_frame(f"m{i}", np.eye(4), f"room {i}", height=256) for i, room in enumerate(rooms)]
    )
    rgb = rooms[1].panorama("query", QUERY, 256).rgb.copy()
    rgb[:, :256] = 235
    answer = built.localize(QueryFrame("query", lambda: Panorama("query", rgb)))
    assert (answer.status, answer.places[0].place) == ("ok", "room 1")
    assert pose_errors(answer.T_world_query, QUERY)[0] < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("method", ["xfeat", "aliked-nn", "disk-lightglue"])
def test_networks_of_kornia_keep_the_promises_of_a_localizer(method):
    config = runnable(configure("localizer", method, settings("localizer", method)))
    assert conforms(config.component, config)
