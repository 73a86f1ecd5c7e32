from __future__ import annotations

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
import yaml
from command_line import run
from rich.console import Console

from salframe.cli import tables
from salframe.framework.registry import registry


def modules_after(*arguments: str) -> set[str]:
    """The modules a fresh interpreter has loaded after `salframe` ran with these arguments."""
    code = (
        "import sys; from salframe.cli import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print('\\n' + ' '.join(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_help_loads_nothing_heavy():
    loaded = modules_after("--help")
    assert "typer" in loaded
    assert not loaded & {"numpy", "scipy", "networkx", "torch", "cv2", "pydantic", "plotly"}


def test_plugins_does_not_load_torch():
    loaded = modules_after("plugins")
    assert "salframe_keypoints" in loaded
    assert not loaded & {"torch", "kornia"}


def test_every_command_has_help():
    listed = run("--help").out
    for command in (
        "compare",
        "ablate",
        "evaluate",
        "build",
        "localize",
        "plugins",
        "show",
        "doctor",
        "data",
        "weights",
    ):
        assert command in listed
        assert run(command, "--help").code == 0


def test_compare_prints_a_table(fakes):
    done = run(
        "compare",
        "--methods",
        "reader,greedy,weightless",
        "--data",
        "rooms",
        "--set",
        "greedy.offset=1",
        "--engine",
        "inline",
    )
    assert done.code == 0
    lines = done.out.splitlines()
    assert max(map(len, lines[:8])) <= 100
    assert any(line.strip().startswith("reader") and "100.0 (100-100)" in line for line in lines)
    assert any(line.strip().startswith("greedy") and "20.0 (0-50)" in line for line in lines)
    assert "weightless: weightless.pth is not at hand: salframe weights fetch weightless" in done.out
    assert lines[-1].startswith("report: runs/rooms-")


def test_a_narrow_terminal_cuts_no_column(fakes, monkeypatch):
    monkeypatch.setattr(tables, "_console", lambda: Console(width=80))
    lines = run("compare", "--methods", "reader,greedy", "--data", "rooms", "--engine", "inline").out.splitlines()
    assert max(map(len, lines[:-1])) <= 80
    assert not any("…" in line for line in lines)
    headings = " ".join(lines).split()
    assert all(word in headings for heading in tables.HEADINGS for word in heading.split())
    assert sum(line.strip().startswith("reader") for line in lines) == 2  # what it reached, and what it costs


def test_compare_prints_json_and_nothing_else(fakes):
    done = run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--json")
    assert done.err == ""
    parts = {"format", "task", "run", "report", "request", "data_fingerprint", "versions", "rows", "notes"}
    assert set(done.json) == parts
    assert [row["method"] for row in done.json["rows"]] == ["reader"]


@pytest.mark.parametrize(
    ("methods", "code"), [("reader", 0), ("weightless", 1), ("weightless,reader", 0), ("reader,unbuildable", 1)]
)
def test_exit_status_says_whether_something_was_measured_and_nothing_crashed(fakes, methods, code):
    assert run("compare", "--methods", methods, "--data", "rooms", "--engine", "inline").code == code


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["compare", "--methods", "raeder", "--data", "rooms"], "unknown method 'raeder', did you mean 'reader'?"),
        (["compare", "--methods", "reader", "--data", "roms"], "unknown dataset 'roms', did you mean 'rooms'?"),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--engine", "inlin"],
            "unknown engine 'inlin', did you mean 'inline'?",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "offset"],
            "received --set 'offset', expected key.path=value",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "offset=far"],
            "reader.offset: received 'far', expected",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "data.size=1"],
            "unknown key rooms.size (known: rooms,",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "data.rooms=0"],
            "rooms has no query, expected at least one",
        ),
        (["ablate", "absent.yaml"], "cannot read absent.yaml"),
        (["evaluate", "."], "is no run folder"),
        (["show", "raeder"], "unknown preset or component 'raeder', did you mean 'reader'?"),
        (["localize", ".", "query-0-0", "--data", "rooms"], "cannot read map.json"),
        (["build", "rooms", "-o", "map", "--method", "weightless"], "weightless.pth is not at hand"),
        (["weights", "where", "nothing"], "unknown weights 'nothing'"),
    ],
)
def test_what_a_user_gets_wrong_is_one_line(fakes, arguments, message):
    done = run(*arguments)
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert message in done.err


def test_debug_shows_the_traceback(fakes):
    from salframe.framework.errors import UnknownName

    with pytest.raises(UnknownName):
        run("--debug", "show", "raeder")


def test_a_plugin_that_fails_to_import_is_told_and_stops_nothing(fakes, monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,salframe_engines,no_such_plugin")
    registry.cache_clear()
    listed = run("plugins")
    assert listed.code == 0
    assert "no_such_plugin failed to load: ModuleNotFoundError" in listed.out
    assert run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline").code == 0
    done = run("compare", "--methods", "no_such_plugin", "--data", "rooms")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "failed to load (ModuleNotFoundError: No module named 'no_such_plugin')" in done.err
    checked = run("doctor")
    assert checked.code == 1
    assert "no_such_plugin: ModuleNotFoundError" in checked.out


def test_plugins_tells_what_is_missing(fakes):
    components = {entry["name"]: entry for entry in run("plugins", "--json").json["components"]}
    assert components["reader"] == {
        "role": "localizer",
        "name": "reader",
        "version": "1",
        "package": "fake_plugin",
        "missing": None,
        "available": True,
        "summary": "Reads the room's number off the image; `offset` makes it wrong by so many rooms.",
    }
    assert not components["weightless"]["available"]
    assert "weightless.pth is not at hand" in run("plugins").out


def test_doctor_is_content_with_a_working_installation(fakes, tmp_path):
    run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline")
    done = run("doctor", "--json")
    assert done.code == 0
    assert done.json["cache"] == str(tmp_path / "cache")
    assert done.json["cache_bytes"] == sum(path.stat().st_size for path in (tmp_path / "cache").rglob("*.npz"))
    assert done.json["failures"] == []


def flatten(content: dict, prefix: str = "") -> dict:
    """Dotted keys and values of a preset, a slot's kind under the slot's own key."""
    flat = {}
    for key, value in content.items():
        if isinstance(value, dict):
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[prefix.removesuffix(".") if key == "kind" else prefix + key] = value
    return flat


def test_show_lists_settings_with_values_types_and_help():
    (found,) = run("show", "paper", "--json").json
    shown = {setting["key"]: setting for setting in found["settings"]}
    written = flatten(yaml.safe_load(registry().find_preset("methods", "paper").read_text()))
    assert (found["role"], found["kind"]) == ("localizer", written.pop(""))
    assert {key: shown[key]["value"] for key in written} == written
    assert shown["detector.seed"]["type"] == "int, at least 0"
    assert shown["detector.seed"]["help"]
    assert [shown[slot]["type"] for slot in ("detector", "matcher")] == ["detector", "matcher"]
    printed = run("show", "paper").out
    assert "a preset of saliency-graph" in printed
    assert all(key in printed for key in written)


def test_show_tells_default_type_and_help(fakes):
    reader = {setting["key"]: setting for setting in run("show", "reader", "--json").json[0]["settings"]}
    assert reader["sleep_s"] == {
        "key": "sleep_s",
        "value": 0.0,
        "default": 0.0,
        "type": "float, at least 0",
        "help": "seconds a query takes",
    }


def test_data_list_and_info(fakes):
    assert "rooms" in [entry["name"] for entry in run("data", "list", "--json").json]
    facts = run("data", "info", "rooms", "--set", "data.leave_one_out=true", "--json").json
    assert (facts["folds"], facts["mapping_frames"], facts["queries"], facts["mapped_places"]) == (10, 5, 10, 5)
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
    }  # the map was built with a localizer that is one off
    assert found["pose"] == {"x_m": 12.0, "y_m": 0.0, "yaw_deg": 0.0}
    printed = run("localize", "map", "query-2-0", "--data", "rooms").out
    assert "room-3" in printed
    assert "pose: x 12.00 m, y 0.00 m, yaw 0.0 deg" in printed
    assert "unknown frame 'query-2-9'" in run("localize", "map", "query-2-9", "--data", "rooms").err


def test_an_image_of_a_folder_is_localized_by_its_path(fakes, tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin")
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
    assert "lies in no folder with a manifest.json" in run("localize", "map", "c.png").err


def test_build_does_not_write_into_another_folder(fakes, tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "letter.txt").write_text("dear")
    assert "holds something else than a map" in run("build", "rooms", "-o", "home", "--method", "reader").err


def test_ablate_runs_every_combination(fakes, tmp_path):
    (tmp_path / "offsets.yaml").write_text(
        "method: reader\ndata: rooms\nset: {data.rooms: 4}\nvary:\n  offset: [0, -1]\n  refuse_in: [-1, 2]\n"
    )
    done = run("ablate", "offsets.yaml", "--engine", "inline", "--json")
    assert done.code == 0
    assert "/offsets-" in done.json["run"]
    accuracy = {row["method"]: row["accuracy"] for row in done.json["rows"]}
    assert accuracy == {
        "reader[offset=0,refuse_in=-1]": 1.0,
        "reader[offset=0,refuse_in=2]": 0.75,
        "reader[offset=-1,refuse_in=-1]": 0.25,
        "reader[offset=-1,refuse_in=2]": 0.25,  # only room 0 is the nearest to one too few
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"method": "reader"}, "vary is missing"),
        ({"method": "reader", "vary": {"offset": [1]}, "varry": {}}, "unknown key"),
        ({"method": "reader", "methods": ["greedy"], "vary": {"offset": [1]}}, "expected either method or methods"),
        ({"method": "reader", "vary": {"offset": []}}, "vary.offset holds no value"),
        ({"method": "reader", "vary": {"offset": 1}}, "vary.offset"),
        ({"method": "reader", "vary": {"data.rooms": [1, 2]}}, "a run has one dataset"),
        ({"method": "reader", "vary": {"ofset": [1]}}, "unknown key 'ofset', did you mean 'offset'?"),
    ],
)
def test_a_wrong_ablation_file_is_one_line(fakes, tmp_path, content, message):
    (tmp_path / "wrong.yaml").write_text(json.dumps(content))
    done = run("ablate", "wrong.yaml", "--data", "rooms")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert message in done.err
