"""Recordings for the rerun viewer, read back with its SDK."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from command_line import run
from robustness.small_building import write_floors
from tracked_folder import poses, write_tracked_folder

import salframe
from salframe.drawing import rerun_recording
from salframe.drawing.rerun_recording import TIME
from salframe.framework.errors import ConfigError, RequirementMissing
from salframe.localization.matched_objects import find_matched_objects

pytest.importorskip("rerun")


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """A folder whose third view cannot be read, with the truth of the last view; the map, the track and the views."""
    import json

    root = tmp_path_factory.mktemp("rerun")
    write_tracked_folder(root)
    write_floors(root)
    truth = json.loads((root / "truth.json").read_text()) if (root / "truth.json").exists() else {"queries": {}}
    truth["queries"]["step-5"] = {"place": "kitchen", "pose": poses()[5].ravel().tolist()}
    (root / "truth.json").write_text(json.dumps(truth))
    manifest = json.loads((root / "manifest.json").read_text())
    (root / "manifest.json").write_text(json.dumps({**manifest, "truth": "truth.json"}))
    salframe.build_map(root, root / "map")
    (root / "frames" / "step-2.rgb.png").unlink()
    opened = salframe.open_map(root / "map")
    views = salframe.read_sequence(root)
    return root, opened, views, salframe.track(opened, views)


@pytest.fixture(scope="module")
def rows(tracked, tmp_path_factory):
    """The rows of each entity: (step, values by component)."""
    from rerun.chunk import RrdReader

    path = tmp_path_factory.mktemp("rrd") / "walk.rrd"
    _, opened, views, track = tracked
    salframe.write_rerun(track, views, opened, path)
    found: dict[str, list[tuple[int | None, dict]]] = {}
    for chunk in RrdReader(path).stream():
        for row in chunk.to_record_batch().drop_columns([TIME] if TIME in chunk.timeline_names else []).to_pylist():
            values = {name.rpartition(":")[2]: value for name, value in row.items()}
            found.setdefault(str(chunk.entity_path).strip("/"), []).append((row.get("step"), values))
    return {
        entity: sorted(values, key=lambda row: -1 if row[0] is None else row[0]) for entity, values in found.items()
    }


def test_all_entities_are_there(rows):
    entities = {
        "camera/panorama",
        "camera/panorama/objects",
        "world/floors/0",
        "world/belief",
        "world/belief/ellipse",
        "world/belief/trail",
        "world/objects",
        "world/truth",
        "world/truth/trail",
        "status",
        "support",
    }
    assert entities <= rows.keys()


def test_beliefs_are_arrows_at_their_poses(rows, tracked):
    track = tracked[3]
    assert [step for step, _ in rows["world/belief"]] == list(range(6))
    for (_, values), step in zip(rows["world/belief"], track.steps, strict=True):
        np.testing.assert_allclose(values["origins"][0], step.pose.T_world_pano[:3, 3], atol=1e-5)
        vector = np.array(values["vectors"][0])
        np.testing.assert_allclose(vector / np.linalg.norm(vector), step.pose.T_world_pano[:3, 0], atol=1e-5)
    assert len(rows["world/belief/trail"][-1][1]["strips"][0]) == 6
    for (_, values), step in zip(rows["support"], track.steps, strict=True):
        assert values["scalars"][0] == pytest.approx(step.pose.support)


def test_ellipses_have_the_size_of_the_covariance(rows, tracked):
    for (_, values), step in zip(rows["world/belief/ellipse"], tracked[3].steps, strict=True):
        points = np.array(values["strips"][0])[:, :2] - step.pose.T_world_pano[:2, 3]
        distances = np.einsum("ki,ij,kj->k", points, np.linalg.inv(step.pose.covariance[:2, :2]), points)
        np.testing.assert_allclose(distances, 5.991, rtol=1e-2)


def test_only_known_truth_is_logged(rows):
    ((step, values),) = rows["world/truth"]
    assert step == 5
    np.testing.assert_allclose(values["origins"][0], poses()[5][:3, 3], atol=1e-5)


def test_panoramas_have_their_objects_and_a_broken_one_is_cleared(rows, tracked):
    _, _, views, track = tracked
    images = {step: values["blob"][0] for step, values in rows["camera/panorama"] if values.get("blob")}
    assert sorted(images) == [0, 1, 3, 4, 5]
    image = cv2.imdecode(np.frombuffer(bytes(images[0]), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    rgb = views.frames[0].load().rgb.astype(int)
    assert np.abs(image - rgb).mean() < min(8, np.abs(image[..., ::-1] - rgb).mean() / 2)  # a JPEG of noisy colours
    for step, values in rows["camera/panorama/objects"]:
        labels = set(values["labels"])
        assert labels == set(track.steps[step].description["labels"].tolist())
    assert "step-2" in next(values for step, values in rows["status"] if step == 2)["text"][0]


def test_matched_objects_are_those_of_the_map(rows, tracked):
    _, opened, _, track = tracked
    for step, values in rows["world/objects"]:
        expected = []
        if track.steps[step].answer is not None:
            expected = list(
                find_matched_objects(opened, track.steps[step].description, track.steps[step].answer).values()
            )
            assert expected
        assert values["labels"] == [thing.label for thing in expected] or not expected
        positions = np.array([thing.xyz_m for thing in expected]).reshape(-1, 3)
        np.testing.assert_allclose(np.reshape(values["positions"], (-1, 3)), positions, atol=1e-5)


def test_places_are_outlined_with_their_names(rows, tracked):
    ((_, values),) = rows["world/floors/0"]
    names = set(tracked[1].floors[0].regions.values())
    assert set(values["labels"]) == names


def test_the_command_writes_a_recording(tracked, tmp_path):
    root = tracked[0]
    printed = run("track", root / "map", root, "--rerun", tmp_path / "out.rrd")
    assert printed.code == 0, printed.err
    assert printed.out.splitlines()[-1] == f"written to {tmp_path / 'out.rrd'}"
    assert (tmp_path / "out.rrd").stat().st_size > 10_000
    error = run("track", root / "map", root, "--rerun", tmp_path / "out.png")
    assert error.code == 2
    assert "expected a file name that ends in .rrd" in error.err


def test_a_missing_package_is_named_before_the_work(monkeypatch, tmp_path):
    monkeypatch.setattr(rerun_recording, "find_spec", lambda name: None)
    with pytest.raises(RequirementMissing, match=r"pip install 'salframe\[rerun\]'"):
        rerun_recording.check_rerun_output(tmp_path / "a.rrd")
    with pytest.raises(ConfigError, match=r"a\.bin, expected a file name that ends in \.rrd"):
        rerun_recording.check_rerun_output(tmp_path / "a.bin")
