from __future__ import annotations

import json
from pathlib import Path

import pytest

from salframe.framework.config import parse_override, validate
from salframe.framework.errors import ConfigError, UnknownName
from salframe.framework.presets import CONFIGS, Overrides, configure, names, preset_names, settings
from salframe.framework.registry import registry
from salframe.panoramas.opening import dataset_settings


def route(*texts: str, methods: tuple[str, ...] = ("reader", "greedy")) -> Overrides:
    return Overrides(map(parse_override, texts), {method: settings("localizer", method) for method in methods})


@pytest.mark.parametrize("role", ["localizer", "dataset"])
def test_every_shipped_preset_is_valid(role):
    assert preset_names("localizer")
    for name in preset_names(role):
        content = settings(role, name)
        validate(registry().get(role, content["kind"]).Config, content, name)


def test_preset_is_the_yaml_file_of_its_name():
    assert settings("localizer", "paper")["matcher"]["keep"] == 0.6
    assert (CONFIGS / "methods" / "paper.yaml").is_file()


def test_a_component_is_a_name_too(fakes):
    assert settings("localizer", "reader") == {"kind": "reader"}
    assert {"reader", "proposed"} <= set(names("localizer"))


def test_unknown_name_tells_the_closest(fakes):
    with pytest.raises(UnknownName, match=r"unknown method 'raeder', did you mean 'reader'\?"):
        settings("localizer", "raeder")


def test_overrides_go_to_whom_they_are_for(fakes):
    given = route("data.rooms=3", "engine.workers=2", "greedy.offset=1", "wrong_from=4")
    assert given.data == [{"rooms": 3}]
    assert given.engine == [{"workers": 2}]
    assert given.methods == {"reader": [{"wrong_from": 4}], "greedy": [{"offset": 1}, {"wrong_from": 4}]}


def test_the_last_override_wins(fakes):
    given = route("offset=1", "reader.offset=2")
    assert configure("localizer", "reader", settings("localizer", "reader"), given.methods["reader"]).offset == 2


@pytest.mark.parametrize("text", ["ofset=1", "data=1", "greedy=1"])
def test_a_key_that_nobody_has_is_an_error(fakes, text):
    with pytest.raises(ConfigError, match="unknown key"):
        route(text)


def test_a_folder_with_a_manifest_is_a_dataset(tmp_path, monkeypatch):
    monkeypatch.setattr("salframe.presets.settings", lambda role, name: {"kind": name})
    folder = tmp_path / "flat"
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps({}))
    assert dataset_settings(str(folder), None) == ("flat", {"kind": "folder", "root": str(folder)})


def test_a_path_without_a_manifest_is_an_error(fakes, tmp_path):
    with pytest.raises(UnknownName, match=r"expected a folder with a manifest\.json"):
        dataset_settings(str(tmp_path), None)


def test_data_dir_becomes_an_absolute_root(fakes, tmp_path):
    assert dataset_settings("rooms", Path("here")) == ("rooms", {"kind": "rooms", "root": str(tmp_path / "here")})
