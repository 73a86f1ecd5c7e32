"""methods, plugins, show, doctor, and the commands of plugins."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import yaml
from command_line import run

from salframe.framework.components.registry import registry


@pytest.fixture
def shipped(fakes, monkeypatch, tmp_path):
    """The fakes, noisy_plugin with its command, and a plugin with presets."""
    (tmp_path / "presets" / "methods").mkdir(parents=True)
    (tmp_path / "presets" / "methods" / "shifted.yaml").write_text("kind: reader\noffset: 1\n")
    (tmp_path / "presets" / "methods" / "foreign.yaml").write_text("kind: out-of-map\n")
    (tmp_path / "presets" / "data").mkdir()
    (tmp_path / "presets" / "data" / "large.yaml").write_text("kind: rooms\nrooms: 50\n")
    (tmp_path / "shipped_presets.py").write_text(
        "from pathlib import Path\nimport salframe\nfrom salframe.framework.components.registry import Presets\n"
        "@salframe.hookimpl\ndef salframe_provides():\n    return [Presets(Path(__file__).parent / 'presets')]\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "shipped_presets", raising=False)
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,noisy_plugin,shipped_presets,salframe_engines")
    registry.cache_clear()
    registry()  # noisy_plugin prints when it is imported


def test_methods_are_listed_a_line_each_with_what_they_lack(shipped):
    lines = {line.split()[0]: line.split(maxsplit=2)[1:] for line in run("methods").out.splitlines()}
    assert list(lines) == sorted(lines)
    assert lines["reader"] == ["fake_plugin", "ready"]
    assert lines["shifted"] == ["shipped_presets", "ready"]
    assert lines["weightless"] == ["fake_plugin", "needs: salframe weights fetch weightless"]
    assert lines["foreign"][1] == "cannot run (see -v)"
    full = {line.split()[0]: line.split(maxsplit=2)[2] for line in run("methods", "-v").out.splitlines()}
    assert full["reader"] == "ready, version 1"
    assert full["weightless"] == "weightless.pth is not at hand: salframe weights fetch weightless"
    assert full["foreign"].startswith("unknown localizer 'out-of-map'.")
    assert not {"rooms", "large", "inline"} & set(lines)
    listed = {entry["name"]: entry for entry in run("methods", "--json").json}
    assert (listed["shifted"]["available"], listed["weightless"]["available"]) == (True, False)


def test_a_method_whose_check_breaks_is_listed_with_the_others(fakes, monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,faulty_plugin,salframe_engines")
    registry.cache_clear()
    for command in ("methods", "plugins"):
        done = run(command, "-v")
        assert done.code == 0
        assert "ValueError: the driver is odd" in done.out
        assert "reader" in done.out


def test_plugins_lists_presets_and_commands_by_their_package(shipped):
    listed = run("plugins", "--json").json
    assert listed["presets"] == [
        {"folder": "methods", "name": "foreign", "package": "shipped_presets"},
        {"folder": "methods", "name": "shifted", "package": "shipped_presets"},
        {"folder": "data", "name": "large", "package": "shipped_presets"},
    ]
    assert listed["commands"] == [{"name": "shout", "package": "noisy_plugin"}]
    lines = run("plugins").out.splitlines()
    assert lines[lines.index("presets: methods of shipped_presets") + 1] == "  foreign, shifted"
    assert lines[lines.index("commands of noisy_plugin") + 1] == "  shout"


def test_show_lists_the_components_of_a_role(fakes):
    listed = {line.split()[0]: line.split(maxsplit=2)[2] for line in run("show", "localizer").out.splitlines()}
    assert listed["reader"] == "ready"
    assert {entry["name"] for entry in run("show", "localizer", "--json").json} == set(listed)


def test_listings_fit_80_columns():
    for command in (("--help",), ("methods",), ("plugins",), ("weights", "list"), ("doctor",)):
        assert max(map(len, run(*command).out.splitlines())) <= 80, command


def test_the_verbose_list_of_weights_has_whole_hashes_and_sources(shipped):
    entries = run("weights", "list", "--json").json
    lines = [line.split(maxsplit=1) for line in run("weights", "list", "-v").out.splitlines()]
    assert [text for key, text in lines if key == "source"] == [entry["source"] for entry in entries]
    hashes = [[sha256, file] for entry in entries for file, sha256 in entry["sha256"].items()]
    assert [text.split() for key, text in lines if key == "sha256"] == hashes
    assert all(len(sha256) == 64 for sha256, _ in hashes)


def test_a_command_of_a_plugin_is_one_of_ours(shipped):
    assert "shout" in run("--help").out
    assert "Print a word in capitals." in run("shout", "--help").out
    done = run("shout", "--word", "echo", "--times", 2)
    assert (done.code, done.out) == (0, "ECHO ECHO\n")
    assert run("shuot").code == 2


def test_commands_that_cannot_be_loaded_are_told_once_and_stop_nothing(fakes, monkeypatch, tmp_path):
    (tmp_path / "broken_commands.py").write_text(
        "import salframe\n@salframe.hookimpl\ndef salframe_commands():\n    raise SystemExit('no commands today')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,broken_commands,salframe_engines")
    registry.cache_clear()
    done = run("--help")
    plugin = "the commands of the plugin broken_commands (package broken_commands)"
    message = f"{plugin} failed to load: SystemExit: no commands today\n"
    assert (done.code, done.err) == (0, message)
    assert run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline").code == 0


def test_methods_and_data_may_be_files(fakes):
    Path("mine.yaml").write_text("kind: reader\noffset: 1\n")
    Path("small.yaml").write_text("kind: rooms\nrooms: 2\n")
    asked = ("--data", "small.yaml", "--engine", "inline", "--json")
    done = run("compare", "--methods", "mine.yaml,reader", *asked)
    assert {row["method"]: row["accuracy"] for row in done.json["rows"]} == {"mine": 0.5, "reader": 1.0}
    assert "/small-" in done.json["run"]
    Path("odd.yaml").write_text("offset: 1\n")
    done = run("compare", "--methods", "odd.yaml", *asked)
    assert (done.code, done.err) == (
        2,
        "error: odd.yaml: the key `kind` is missing, expected the name of a localizer\n",
    )


def test_plugins_tells_what_is_missing(fakes):
    components = {entry["name"]: entry for entry in run("plugins", "--json").json["components"]}
    assert components["reader"] == {
        "role": "localizer",
        "name": "reader",
        "version": "1",
        "package": "fake_plugin",
        "missing": None,
        "remedy": None,
        "available": True,
        "summary": "Reads the room's number off the image; `offset` makes it wrong by so many rooms.",
    }
    assert not components["weightless"]["available"]
    assert "needs: salframe weights fetch weightless" in run("plugins").out


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
    assert shown["matcher.min_candidate_ratio"]["type"] == "float, at least 0, at most 1"
    assert shown["matcher.min_candidate_ratio"]["help"]
    assert (shown["detector"]["value"], shown["detector"]["default"]) == ("auto", "auto")
    assert "`annotations`, `segments`, `panoseg`" in shown["detector"]["help"]
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


def test_a_faulty_preset_is_told_and_ends_no_listing(shipped, tmp_path):
    (tmp_path / "presets" / "data" / "odd.yaml").write_text("rooms: 3\n")
    (tmp_path / "presets" / "methods" / "odd.yaml").write_text("kind: reader\notherwise: [x]\n")
    registry.cache_clear()
    for command in (("methods",), ("plugins",), ("data", "list")):
        assert run(*command).code == 0
    listed = [entry["name"] for entry in run("data", "list", "--json").json]
    assert "large" in listed
    assert "odd" not in listed
    assert "the plugin data/odd.yaml (package shipped_presets) failed to load: " in run("plugins").out
    assert run("doctor").code == 1
    done = run("compare", "--methods", "odd", "--data", "rooms")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "the preset methods/odd.yaml of the package shipped_presets is invalid" in done.err


def test_data_that_is_lost_is_listed(shipped, tmp_path):
    registry()
    (tmp_path / "presets" / "data" / "large.yaml").unlink()
    listed = {entry["name"]: entry["summary"] for entry in run("data", "list", "--json").json}
    assert listed["large"].startswith("cannot read ")


def test_a_scorer_that_gives_no_row_is_one_line(fakes):
    from salframe.evaluation.scorer import Scorer

    class Hollow(Scorer):
        """Gives nothing."""

        name, version = "hollow", "1"

        def score(self, answers, root):
            return []

    registry().add(Hollow, "test")
    done = run("score", "hollow", "answers.json", "--data", ".")
    message = (
        "error: the scorer hollow returned no result row for answers.json, "
        "expected one row for each split of the benchmark\n"
    )
    assert (done.code, done.out, done.err) == (2, "", message)
