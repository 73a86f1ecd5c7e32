"""data, build and localize."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import run
from scipy.spatial.transform import Rotation
from tiny_folder import write_tiny_folder

from salframe.cli.localize import print_answer
from salframe.framework.components.registry import registry
from salframe.localization.answers import Localization, RankedPlace
from salframe.panoramas.images import write_color, write_ids
from salframe.testing.rooms import query_frames, query_truths


def test_data_list_and_info(fakes):
    assert "rooms" in [entry["name"] for entry in run("data", "list", "--json").json]
    facts = run("data", "info", "rooms", "--set", "data.leave_one_out=true", "--json").json
    assert (facts["folds"], facts["reference_frames"], facts["queries"], facts["mapped_places"]) == (10, 5, 10, 5)
    assert facts["provides"] == ["rgb"]
    assert run("data", "render", "rooms").code == 0


def test_build_then_localize(fakes, tmp_path):
    assert run("build", "rooms", "-o", "map", "--method", "reader", "--set", "offset=1").code == 0
    assert (tmp_path / "map" / "map.json").is_file()
    found = run("localize", "map", "query-2-0", "--data", "rooms", "--json").json
    assert found["status"] == "ok"
    assert found["places"][0] == {
        "place": "room-3",
        "frame": "map-3",
        "score": 0.0,
        "probability": None,
    }  # the map was built with a localizer that is one off
    assert found["pose"] == {"x_m": 12.0, "y_m": 0.0, "z_m": 0.0, "yaw_deg": 0.0}
    printed = run("localize", "map", "query-2-0", "--data", "rooms").out
    assert "room-3" in printed
    assert "pose: x 12.00 m, y 0.00 m, yaw 0.0 deg" in printed
    assert "unknown frame 'query-2-9'" in run("localize", "map", "query-2-9", "--data", "rooms").err


def test_probabilities_are_told(fakes, tmp_path):
    """The Reader's scores are minus the distance in rooms: at temperature 1 the shares of five rooms seen from the
    middle one are softmax(0, -1, -1, -2, -2), and a head without weights gives the map half."""
    head = "{absent_mean: 0, absent_deviation: 1, bias: 0, slope: 0, accuracy: 1, other_score: 0}"
    (tmp_path / "half.yaml").write_text(f"posterior: {{temperature: 1.0, head: {head}}}\n")
    assert run("build", "rooms", "-o", "map", "--method", "reader", "--set", "posterior=half.yaml").code == 0
    (tmp_path / "half.yaml").unlink()  # the map knows the numbers
    found = run("localize", "map", "query-2-0", "--data", "rooms", "--json").json
    weights = np.exp([0, -1, -1, -2, -2])
    assert [place["probability"] for place in found["places"]] == pytest.approx(0.5 * weights / weights.sum())
    assert found["out_of_map_probability"] == pytest.approx(0.5)
    printed = run("localize", "map", "query-2-0", "--data", "rooms").out
    assert f"{50 / weights.sum():.1f}%  room-2" in printed
    assert "50.0%  out-of-map" in printed


def test_a_heading_without_a_pose_is_printed(capsys):
    print_answer(Localization((RankedPlace("map-1", "room-1", 1.0),), None, "no-pose", heading_rad=np.pi / 3))
    assert capsys.readouterr().out.splitlines()[-1] == "heading: 60.0 deg"


def test_an_image_of_a_folder_is_localized_by_its_path(fakes, tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,salframe_engines")
    registry.cache_clear()
    (tmp_path / "mine" / "images").mkdir(parents=True)
    for name, room in (("a", 1), ("b", 3)):
        cv2.imwrite(str(tmp_path / "mine" / "images" / f"{name}.png"), np.full((4, 8, 3), room, np.uint8))
    mapped = {"id": "here", "role": "map", "rgb": "images/a.png", "place": "home", "pose": np.eye(4).ravel().tolist()}
    asked = {"id": "there", "role": "query", "rgb": "images/b.png"}
    manifest = {"format": "salframe-folder", "version": 1, "frames": [mapped, asked]}
    (tmp_path / "mine" / "manifest.json").write_text(json.dumps(manifest))
    run("build", "rooms", "-o", "map", "--method", "reader")
    assert run("localize", "map", "mine/images/b.png", "--json").json["places"][0]["place"] == "room-3"
    assert run("localize", "map", "there", "--data", "mine", "--json").json["places"][0]["place"] == "room-3"
    assert "has no frame with the image images/c.png" in run("localize", "map", "mine/images/c.png").err
    assert "is not in a folder with a manifest.json" in run("localize", "map", "c.png").err


def test_build_does_not_write_into_another_folder(fakes, tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "letter.txt").write_text("dear")
    assert "contains files that are not a map" in run("build", "rooms", "-o", "home", "--method", "reader").err


@pytest.fixture
def loose(tmp_path, monkeypatch):
    """A map of the suite's rooms, and the files of a query that no manifest names; range in quarter millimetres."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    assert run("build", write_tiny_folder(tmp_path / "data"), "-o", "map").code == 0
    seen = query_frames()[0].load()
    write_color(tmp_path / "a.jpg", seen.rgb)
    write_ids(tmp_path / "a.png", np.round(seen.range_m * 4000).astype(np.int32))
    write_ids(tmp_path / "b.png", seen.annotations.instance_id)
    (tmp_path / "b.json").write_text(json.dumps(seen.annotations.labels))
    return ["--rgb", "a.jpg", "--range", "a.png", "--instances", "b.png", "--labels", "b.json"]


def test_loose_images_are_localized(loose):
    truth = query_truths()["bedroom-query"]
    found = run("localize", "map", *loose, "--range-unit", "0.00025", "--json")
    assert found.err == "detector of the map: annotations\n"
    assert found.json["places"][0]["place"] == "bedroom"
    np.testing.assert_allclose(found.json["T_world_query"], truth.T_world_pano, atol=0.05)
    assert "likely quarter millimetres" in run("localize", "map", *loose).err


def test_images_without_what_the_map_needs_are_one_line(loose):
    assert run("localize", "map", *loose[:4]).err.endswith(
        "error: the method 'saliency-places' needs annotations, which panorama a.jpg does not have: "
        "build the map with --set detector.kind=panoseg, or pass annotations too\n"
    )
    assert "received neither FRAME" in run("localize", "map").err
    assert "received both FRAME and image files" in run("localize", "map", "query", *loose).err


def test_no_answer_is_ok_where_out_of_map_is_the_most_probable(capsys):
    places = tuple(RankedPlace(f"f{i}", f"room-{i}", -float(i), p) for i, p in enumerate([0.4, *[0.01] * 7]))
    print_answer(Localization(places, np.eye(4), "ok", out_of_map_probability=0.53))
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == (
        "status: not accepted, because the query is probably out-of-map (probability 53.0%, accepted up to 50%)"
    )
    assert "      3.0%  other places (3)" in printed
    shares = [float(line.split("%")[0]) for line in printed[1:] if "%" in line]
    assert sum(shares) == pytest.approx(100)


def test_whether_an_answer_is_accepted_is_in_the_json(fakes, tmp_path):
    assert run("build", "rooms", "-o", "map", "--method", "reader").code == 0
    assert run("localize", "map", "query-2-0", "--data", "rooms", "--json").json["accepted"] is None
    head = "{absent_mean: 0, absent_deviation: 1, bias: -3, slope: 0, accuracy: 1, other_score: 0}"
    posterior = f"posterior={{temperature: 1.0, max_out_of_map_probability: 1.0, head: {head}}}"
    assert run("build", "rooms", "-o", "sure", "--method", "reader", "--no-calibrate", "--set", posterior).code == 0
    done = run("localize", "sure", "query-2-0", "--data", "rooms", "--json").json
    assert (done["status"], done["accepted"]) == ("ok", False)
    assert done["out_of_map_probability"] == pytest.approx(1 / (1 + np.exp(-3)))
    done = run("map", "query", "sure", "query-2-0", "--data", "rooms", "--to", "room-3", "--json")
    assert (done.code, done.json["accepted"], done.json["node"]) == (1, False, None)
    assert "was not localized (not accepted, because" in done.json["no_route"]


def test_the_pose_is_written_as_a_trajectory(fakes):
    assert run("build", "rooms", "-o", "map", "--method", "reader").code == 0
    done = run("localize", "map", "query-2-0", "--data", "rooms", "--trajectory", "pose.tum", "--json").json
    lines = Path("pose.tum").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# timestamp tx ty tz qx qy qz qw")
    (pose,) = [line for line in lines if not line.startswith("#")]
    numbers = np.array(pose.split(), float)
    true = np.array(done["T_world_query"], float).reshape(4, 4)
    assert numbers[0] == 0
    np.testing.assert_allclose(numbers[1:4], true[:3, 3], atol=1e-6)
    np.testing.assert_allclose(Rotation.from_quat(numbers[4:]).as_matrix(), true[:3, :3], atol=1e-5)
