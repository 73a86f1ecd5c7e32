"""What a user can get wrong, through the command line: one line that names what was received and what was expected, and
a non-zero exit."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import Result, run
from tiny_folder import write_tiny_folder

from salframe.framework.components.registry import registry


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    return write_tiny_folder(tmp_path_factory.mktemp("sound") / "data")


@pytest.fixture
def data(sound, tmp_path, monkeypatch) -> Path:
    """A sound dataset to spoil, in an empty working directory with an empty cache."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    shutil.copytree(sound, tmp_path / "data")
    return Path("data")


def assert_one_line(done: Result, message: str) -> None:
    assert done.code == 2
    assert done.out == ""
    assert re.fullmatch(f"error: .*{message}.*\n", done.err), done.err


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def change_manifest(change: Callable[[dict], object]) -> Callable[[Path], None]:
    def spoil(data: Path) -> None:
        manifest = json.loads((data / "manifest.json").read_text())
        change(manifest)
        (data / "manifest.json").write_text(json.dumps(manifest))

    return spoil


def with_image(name: str, image: np.ndarray) -> Callable[[Path], None]:
    return lambda data: cv2.imwrite(str(data / "frames" / name), image)


SPOILT_FOLDERS = {
    "cut image": (
        lambda data: cut(data / "frames/kitchen-map.rgb.png"),
        r"kitchen-map\.rgb\.png is not a readable image .*expected a complete JPEG or PNG",
    ),
    "no image": (
        lambda data: (data / "frames/kitchen-map.rgb.png").write_text("hello"),
        r"kitchen-map\.rgb\.png is not a readable image \(file size 5 bytes\)",
    ),
    "image gone": (
        lambda data: (data / "frames/kitchen-map.rgb.png").unlink(),
        r"cannot read .*kitchen-map\.rgb\.png: No such file",
    ),
    "range of another size": (
        with_image("kitchen-map.range.png", np.ones((100, 200), np.uint16)),
        "kitchen-map: the range image is 200 x 100, expected 384 x 192",
    ),
    "range of 8 bits": (
        with_image("kitchen-map.range.png", np.ones((192, 384), np.uint8)),
        r"range\.png has 1 channel of 8 bits, expected 1 channel of 16 bits",
    ),
    "not twice as wide": (
        with_image("kitchen-map.rgb.png", np.ones((192, 500, 3), np.uint8)),
        r"is 500 x 192, expected width = 2 x height",
    ),
    "missing key": (
        change_manifest(lambda manifest: manifest.pop("format")),
        r"manifest\.json: the required key format is missing",
    ),
    "missing id": (
        change_manifest(lambda manifest: manifest["frames"][1].pop("id")),
        r"manifest\.json: the required key frames\.1\.id is missing",
    ),
    "unknown key": (
        change_manifest(lambda manifest: manifest.update(frame=[])),
        r"manifest\.json: unknown key frame, did you mean 'frames' \(known keys: .*frames",
    ),
    "wrong format": (
        change_manifest(lambda manifest: manifest.update(format="coco")),
        "format: received 'coco', expected 'salframe-folder'",
    ),
    "no frame": (
        change_manifest(lambda manifest: manifest["frames"].clear()),
        r"manifest\.json: none of 0 frames in the manifest is a reference frame, expected at least one",
    ),
    "no JSON": (lambda data: cut(data / "manifest.json"), r"manifest\.json is not JSON"),
}


@pytest.mark.parametrize(("spoil", "message"), SPOILT_FOLDERS.values(), ids=SPOILT_FOLDERS.keys())
def test_a_map_is_not_built_from_a_spoilt_folder(data, spoil, message, capfd):
    spoil(data)
    assert_one_line(run("build", data, "-o", "map", "--set", "detector.kind=annotations"), message)
    assert not Path("map").exists()
    assert capfd.readouterr().err == ""  # the libraries that decode images are silent too


def test_a_spoilt_query_is_not_localized(data):
    assert run("build", data, "-o", "map").code == 0
    cut(data / "frames" / "kitchen-query.range.png")
    for query in (["kitchen-query", "--data", "./data"], ["data/frames/kitchen-query.rgb.png"]):
        assert_one_line(run("localize", "map", *query), r"kitchen-query\.range\.png is not a readable image")


def compare(data: object, *more: str) -> Result:
    return run("compare", "--methods", "objects", "--data", data, "--engine", "inline", *more)


def test_a_comparison_says_which_frames_it_could_not_use_and_measures_the_rest(data):
    cut(data / "frames" / "lounge-query.range.png")
    (row,) = compare("./data", "--json").json["rows"]
    assert row["status"] == {"no-pose": 2, "error": 1}
    assert re.fullmatch(
        r"number of query panoramas that cannot be used: 1, the first: .*lounge-query\.range\.png is not a readable .*",
        row["reason"],
    )


def test_a_comparison_refuses_a_map_as_build_does(data):
    cut(data / "frames" / "kitchen-map.range.png")
    reason = r"1 of 3 reference frames .* cannot be used, .*kitchen-map\.range\.png is not a readable image"
    done = compare("./data", "--json")
    assert done.code == 1
    assert re.search(reason, done.json["rows"][0]["reason"])
    assert_one_line(run("build", "./data", "-o", "map", "--set", "detector.kind=annotations"), reason)


def test_a_comparison_without_any_usable_frame_fails(data):
    for path in (data / "frames").glob("*-map.range.png"):
        cut(path)
    done = compare("./data", "--json")
    assert done.code == 1
    assert re.fullmatch(
        r"3 of 3 reference frames .* cannot be used, .*is not a readable image.*", done.json["rows"][0]["reason"]
    )


def test_an_empty_dataset(data):
    Path("nothing").mkdir()
    assert_one_line(
        compare("./nothing"),
        r"\./nothing is not a dataset, expected a folder with a manifest\.json, or one of .*house-12",
    )
    change_manifest(lambda manifest: manifest.update(frames=[f for f in manifest["frames"] if f["role"] == "map"]))(
        data
    )
    assert_one_line(compare("./data"), r"has no query \(panorama to localize\), expected at least one")
    change_manifest(lambda manifest: manifest["frames"].clear())(data)
    assert_one_line(compare("./data"), r"manifest\.json: none of 0 frames in the manifest is a reference frame")


def test_an_unknown_method_tells_the_closest(data):
    done = run("compare", "--methods", "objects,propsed", "--data", "./data")
    assert_one_line(done, r"unknown method 'propsed', did you mean 'proposed'\? Known: .*objects, .*paper, .*proposed")
    assert not Path("runs").exists()


@pytest.mark.skipif(importlib.util.find_spec("kornia") is None, reason="the extra salframe[keypoints] is not installed")
def test_missing_weights_are_told_and_how_to_get_them(data):
    message = (
        r"weights 'loftr': .*\.ckpt is missing \(sha256 [0-9a-f]{64}\); download it with: salframe weights fetch loftr"
    )
    assert_one_line(run("build", data, "-o", "map", "--method", "loftr"), message)
    done = run(
        "compare",
        "--methods",
        "loftr",
        "--data",
        "./data",
        "--engine",
        "inline",
        "--set",
        "features.checkpoint=absent.ckpt",
        "--json",
    )
    (row,) = done.json["rows"]
    assert (done.code, row["method"], row["available"]) == (1, "loftr", False)
    assert re.fullmatch(
        r"weights 'loftr': the file absent\.ckpt does not exist; correct the path in the settings, or download the "
        r"weights with: salframe weights fetch loftr",
        row["reason"],
    )


def test_another_method_in_the_place_of_one_that_cannot_run_is_named(data):
    done = run("compare", "--methods", "loftr", "--data", "./data", "--engine", "inline", "--json")
    assert [row["method"] for row in done.json["rows"]] == ["loftr-compact"]
    (note,) = done.json["notes"]
    assert re.match(
        r"loftr-compact is used instead of loftr: (weights 'loftr': .* is missing|loftr needs .*torch)", note
    )


def test_the_note_on_another_method_is_printed_once_before_the_run(data):
    done = run("compare", "--methods", "loftr", "--data", "./data", "--engine", "inline")
    assert done.err.count("loftr-compact is used instead of loftr: ") == 1
    assert "is used instead of" not in done.out
    assert "loftr-compact (for loftr)" in " ".join(done.out.split())
    assert not re.search(r"[0-9a-f]{64}", done.err + done.out)


BROKEN_PLUGINS = {
    "import": ("import no_such_package", "ModuleNotFoundError: No module named 'no_such_package'"),
    "syntax": ("def salframe_provides(:", "SyntaxError: invalid syntax"),
    "hook": (
        "import salframe\n@salframe.hookimpl\ndef salframe_provides():\n    return [1 / 0]",
        "ZeroDivisionError: division by zero",
    ),
    "class": (
        "import salframe\n@salframe.hookimpl\ndef salframe_provides():\n    return [int]",
        "a plugin registers <class 'int'>, which is not a component",
    ),
    "weights": (
        "import salframe\nfrom salframe.framework.engines.engine import Engine\n"
        "class E(Engine):\n    name, version = 'e', '1'\n    def weights(self): ...\n"
        "@salframe.hookimpl\ndef salframe_provides():\n    return [E]",
        "the class attribute E.weights has the type function, expected a tuple",
    ),
}


@pytest.mark.parametrize(("code", "reason"), BROKEN_PLUGINS.values(), ids=BROKEN_PLUGINS.keys())
def test_a_broken_plugin_is_told_and_stops_nothing(data, monkeypatch, code, reason, request):
    name = f"broken_{request.node.callspec.id}"
    Path(f"{name}.py").write_text(code)
    monkeypatch.syspath_prepend(Path.cwd())
    monkeypatch.setenv("SALFRAME_PLUGINS", f"salframe_annotations,salframe_objects,salframe_engines,{name}")
    registry.cache_clear()
    try:
        assert_one_line(run("show", name), rf"{name}.*{re.escape(reason)}")
        assert_one_line(
            run("compare", "--methods", "objects", "--set", f"detector={name}", "--data", "./data"),
            rf"{name}.*{re.escape(reason)}",
        )
        checked = run("doctor")
        assert checked.code == 1
        assert f"{name}: {reason}" in checked.out
        assert compare("./data").code == 0
    finally:
        registry.cache_clear()


def test_a_yaml_with_an_unknown_key(data):
    for content, message in (
        (
            "method: objects\nvary: {labels: [set]}\nverbose: true",
            r"sweep\.yaml: unknown key verbose \(known keys: .*vary",
        ),
        (
            "method: objects\nvary: {lables: [set]}",
            r"sweep\.yaml: the key `vary` has an unknown setting lables, did you mean 'labels'",
        ),
        (
            "method: objects\nset: {detector.noize: none}\nvary: {labels: [set]}",
            r"unknown setting detector\.noize, did you mean 'noise' \(known settings: noise, seed\)",
        ),
        (
            "method: objects\nvary: {objects.detector.noize: [none]}",
            r"sweep\.yaml: unknown setting objects\.detector\.noize, did you mean 'noise'",
        ),
        ("method: objects\nvary: [labels", r"sweep\.yaml is not valid YAML"),
        ("- objects", r"sweep\.yaml contains a list, expected a mapping"),
    ):
        Path("sweep.yaml").write_text(content)
        assert_one_line(run("ablate", "sweep.yaml", "--data", "./data"), message)


def test_a_wrong_setting(data):
    assert_one_line(
        compare("./data", "--set", "detector.noise=loud"), r"detector\.noise.*received 'loud', expected .*'none'"
    )
    assert_one_line(compare("./data", "--set", "detector=yolo"), r"unknown detector 'yolo'.* Known: annotations")
    assert_one_line(
        compare("house-12", "--set", "data.rooms=many"), r"setting data\.rooms: received 'many', expected .*integer"
    )


def test_a_fault_of_many_frames_is_told_a_few_times_and_counted(data):
    def forget_poses(manifest):
        (entry,) = [frame for frame in manifest["frames"] if frame["id"] == "kitchen-map"]
        poseless = {key: value for key, value in entry.items() if key != "pose"}
        manifest["frames"] = [{**poseless, "id": f"map-{number}"} for number in range(31)]

    change_manifest(forget_poses)(data)
    for done in (run("build", data, "-o", "map"), compare("./data"), run("data", "info", "./data")):
        assert_one_line(done, r"manifest\.json")
        assert len(done.err) < 600
        assert 1 <= done.err.count("no pose") <= 4
        assert re.search(r"\b(28|30|31) ", done.err), done.err


def without_annotations(data: Path) -> None:
    """A data set with colour and range alone."""

    def spoil(manifest):
        manifest["objects"] = None
        for frame in manifest["frames"]:
            frame["instances"] = None

    change_manifest(spoil)(data)


def test_a_detector_that_lacks_something_is_named_and_others_that_could_look(data):
    without_annotations(data)
    done = compare("./data", "--json", "--set", "detector.kind=annotations")
    (row,) = done.json["rows"]
    assert (done.code, row["available"]) == (1, False)
    needs = "the detector 'annotations' of the method needs annotations, which the dataset folder does not have"
    hint = re.fullmatch(rf"{needs}: use another detector \((.*)\)", row["reason"])
    assert hint, row["reason"]
    offered = hint[1].split(" or ")
    assert "--set detector.kind=panoseg" in offered
    assert not any("annotations" in one for one in offered)
    (row,) = compare("./data", "--json", *offered[0].split()).json["rows"]
    assert (row["available"], row["status"].get("crashed")) == (True, None)
    assert set(row["input"]) <= {"rgb", "range"}


def test_where_no_detector_can_look_that_is_said(data, monkeypatch):
    without_annotations(data)
    monkeypatch.setenv("SALFRAME_PLUGINS", "salframe_annotations,salframe_objects,salframe_engines")
    registry.cache_clear()
    (row,) = compare("./data", "--json", "--set", "detector.kind=annotations").json["rows"]
    registry.cache_clear()
    assert row["reason"].endswith(
        "which the dataset folder does not have: no installed detector works without annotations"
    )
