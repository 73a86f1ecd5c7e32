"""Range images in other encodings: those declared in a manifest or by options change nothing, others are reported."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run
from tiny_folder import write_tiny_folder

from salframe.panoramas.images import read_range, write_ids
from salframe.panoramas.range_encoding import RangeEncoding
from salframe.testing.rooms import query_frames

CUBE = RangeEncoding(1 / 512, (65535,), "cube")
OPTIONS = "--range-unit", "0.001953125", "--range-missing", "65535", "--range-kind", "cube"


def window(range_m, encoding):
    """Return the values of the file, with a window of 65535."""
    steps = encoding.panorama_steps(range_m).astype(np.int32)
    steps[40:60, 100:140] = 65535
    return steps


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """Two folders of the same rooms: in millimetres along the ray, and in 1/512 m of cube faces with missing pixels."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    write_tiny_folder(tmp_path / "plain")
    write_tiny_folder(tmp_path / "cubes")
    for path in (tmp_path / "cubes" / "frames").glob("*.range.png"):
        write_ids(path, window(read_range(path), CUBE))
    manifest = tmp_path / "cubes" / "manifest.json"
    content = json.loads(manifest.read_text())
    declared = {"range_unit_m": 1 / 512, "range_missing": [65535], "range_kind": "cube"}
    manifest.write_text(json.dumps({**content, **declared}))
    return tmp_path


def pose(answer):
    assert answer.json["places"][0]["place"] == "bedroom"
    return answer.json["T_world_query"]


def test_a_query_is_decoded_as_its_own_folder_declares(folders):
    for name in ("plain", "cubes"):
        built = run("build", name, "-o", f"map-{name}")
        assert (built.code, built.err) == (0, "proposed: 'auto' selected the detector 'annotations'\n")
    expected = pose(run("localize", "map-plain", "bedroom-query", "--data", "plain", "--json"))
    for saved, queries in (("plain", "cubes"), ("cubes", "plain"), ("cubes", "cubes")):
        found = run("localize", f"map-{saved}", "bedroom-query", "--data", queries, "--json")
        assert found.err == "detector of the map: annotations\n"
        np.testing.assert_allclose(pose(found), expected, atol=0.02)


def test_loose_images_have_the_encoding_of_the_options(folders):
    assert run("build", "plain", "-o", "map").code == 0
    seen = query_frames()[0].load()
    write_ids(folders / "a.png", window(seen.range_m, CUBE))
    write_ids(folders / "b.png", seen.annotations.instance_id)
    (folders / "b.json").write_text(json.dumps(seen.annotations.labels))
    loose = "localize", "map", "--range", "a.png", "--instances", "b.png", "--labels", "b.json"
    found = run(*loose, *OPTIONS, "--json")
    assert found.err == "detector of the map: annotations\n"
    expected = pose(run("localize", "map", "bedroom-query", "--data", "plain", "--json"))
    np.testing.assert_allclose(pose(found), expected, atol=0.02)
    undeclared = run(*loose, *OPTIONS[:2], "--range-kind", "cube", "--json").err
    assert "65535 fills" in undeclared
    assert "(for single images: --range-missing 65535)" in undeclared
    error = run("localize", "map", "bedroom-query", "--data", "plain", "--range-missing", "65535").err
    assert error.startswith("error: received --range-missing without --range: add --range FILE, the range")
    assert error.count("\n") == 1


def test_an_undeclared_value_is_reported_wherever_data_are_opened(folders):
    manifest = folders / "cubes" / "manifest.json"
    content = json.loads(manifest.read_text())
    del content["range_missing"]
    manifest.write_text(json.dumps(content))
    told = 'set "range_missing": [65535] in manifest.json'
    assert told in run("data", "info", "cubes").err
    assert told in run("build", "cubes", "-o", "map").err
    assert told in run("map", "add", "map", "cubes").err
    assert told in run("localize", "map", "bedroom-query", "--data", "cubes").err
    compared = run("compare", "--methods", "objects", "--data", "cubes", "--engine", "inline", "--json")
    assert any(told in note for note in compared.json["notes"])
