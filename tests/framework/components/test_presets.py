"""Names and settings from outside: presets, YAML files, components, and overrides by dotted key."""

from __future__ import annotations

from pathlib import Path

import pytest

from salframe.framework.components.defaults import auto_order, default_of, defaults
from salframe.framework.components.presets import (
    Overrides,
    configure,
    configure_default,
    names,
    nest_for,
    otherwise,
    preset_names,
    settings,
    short_name,
)
from salframe.framework.components.registry import Failure, registry
from salframe.framework.config import parse_override
from salframe.framework.errors import ConfigError, PluginFailed, UnknownName
from salframe.framework.hookspecs import Presets
from salframe.framework.overrides import Override
from salframe.framework.validation import validate

CONFIGS = Path(__file__).parents[3] / "configs"


def route(*texts: str, methods: tuple[str, ...] = ("reader", "greedy")) -> Overrides:
    content = {method: settings("localizer", method) for method in methods}
    return Overrides(map(parse_override, texts), content, role="localizer", scopes=("data", "engine"))


@pytest.fixture
def presets(fakes, tmp_path) -> Path:
    """A collection of presets beside the fakes: methods/lost, which is a reader two rooms off, and data/three-rooms."""
    for name, content in {
        "methods/lost.yaml": "kind: reader\noffset: 2\notherwise: reader\n",
        "data/three-rooms.yaml": "kind: rooms\nrooms: 3\n",
    }.items():
        path = tmp_path / "presets" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    registry().add(Presets(tmp_path / "presets"), "fake-presets")
    return tmp_path


@pytest.mark.parametrize(
    ("role", "name"),
    [
        (role, path.stem)
        for role in ("localizer", "dataset")
        for path in (CONFIGS / {"localizer": "methods", "dataset": "data"}[role]).glob("*.yaml")
    ],
)
def test_every_shipped_preset_is_found_and_valid(role, name):
    assert preset_names(role)[name] == "salframe"
    content = settings(role, name)
    assert validate(registry().get(role, content["kind"]).Config, content, name).kind == content["kind"]


def test_every_default_is_a_name_that_there_is():
    known = {
        "methods": "localizer",
        "matching_methods": "localizer",
        "map_method": "localizer",
        "detectors": "detector",
        "data": "dataset",
        "engine": "engine",
        "planner": "planner",
        "navigation_planner": "planner",
        "range-model": "range-model",
        "detector": "detector",
        "saliency": "saliency",
        "image-network": "image-network",
        "tracker": "tracker",
        "recording": "importer",
    }
    assert set(defaults()) == {*known, "auto"}
    assert set(auto_order("detector")) <= {*names("detector"), "segments"}
    for key, role in known.items():
        listed = default_of(key)
        assert set([listed] if isinstance(listed, str) else listed) <= {*names(role), "auto"}, key


def test_a_preset_is_the_yaml_file_of_its_name(presets):
    assert settings("localizer", "lost") == {"kind": "reader", "offset": 2}
    assert otherwise("localizer", "lost") == "reader"
    assert otherwise("localizer", "reader") is None
    assert configure_default("localizer", "lost").offset == 2
    assert preset_names("localizer") == {"lost": "fake-presets"}
    assert preset_names("dataset") == {"three-rooms": "fake-presets"}
    assert preset_names("engine") == {}


def test_a_component_is_a_name_too(presets):
    assert settings("localizer", "reader") == {"kind": "reader"}
    assert names("dataset") == ["folder", "rooms", "three-rooms"]


@pytest.mark.parametrize("suffix", ["yaml", "yml"])
def test_a_yaml_file_is_a_method_and_a_data_set(fakes, tmp_path, suffix):
    folder = tmp_path / "mine.d"
    folder.mkdir()
    (folder / f"method.{suffix}").write_text("base: ../shared.yaml\nwrong_from: 4\n")
    (tmp_path / "shared.yaml").write_text("kind: reader\noffset: 1\n")
    (folder / f"data.{suffix}").write_text("kind: rooms\nrooms: 2\n")
    path = f"mine.d/method.{suffix}"
    config = configure("localizer", path, settings("localizer", path))
    assert (config.kind, config.offset, config.wrong_from) == ("reader", 1, 4)
    assert short_name(path) == "method"
    assert settings("dataset", str(folder / f"data.{suffix}")) == {"kind": "rooms", "rooms": 2}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("offset: 2\n", r"mine\.yaml: the key `kind` is missing, expected the name of a localizer"),
        ("kind: 3\n", r"mine\.yaml: the key `kind` is 3"),
        (
            "kind: reader\notherwise: [x]\n",
            r"mine\.yaml: the key `otherwise` is \['x'\], expected the name of another localizer",
        ),
        ("- kind\n", r"mine\.yaml contains a list, expected a mapping"),
        ("kind: [\n", r"mine\.yaml is not valid YAML: "),
        (None, r"cannot read .*mine\.yaml: No such file"),
        ("kind: reader\nbase: absent.yaml\n", r"cannot read .*absent\.yaml: No such file"),
    ],
)
def test_a_bad_yaml_file_is_one_line(fakes, tmp_path, content, message):
    if content is not None:
        (tmp_path / "mine.yaml").write_text(content)
    with pytest.raises(ConfigError, match=message) as caught:
        settings("localizer", "mine.yaml")
    assert "\n" not in str(caught.value)


def test_a_yaml_file_of_an_unknown_component_tells_the_closest(fakes, tmp_path):
    (tmp_path / "mine.yaml").write_text("kind: raeder\n")
    with pytest.raises(UnknownName, match=r"unknown localizer 'raeder', did you mean 'reader'\?"):
        configure_default("localizer", "mine.yaml")


def test_unknown_names_tell_the_closest(presets):
    with pytest.raises(UnknownName, match=r"unknown method 'lots', did you mean 'lost'\?"):
        settings("localizer", "lots")
    with pytest.raises(UnknownName, match=r"unknown dataset 'three-room', did you mean 'three-rooms'\?"):
        settings("dataset", "three-room")


def test_an_unknown_name_may_be_a_broken_plugins(fakes):
    registry().failures.append(Failure("oracle", "salframe-oracle", "ImportError: no crystal"))
    with pytest.raises(PluginFailed, match=r"localizer 'oracle': .* \(ImportError: no crystal\)"):
        settings("localizer", "oracle")


def test_overrides_go_to_whom_they_are_for(fakes):
    given = route("data.rooms=3", "engine.workers=2", "greedy.offset=1", "wrong_from=4")
    assert given.scopes == {"data": [{"rooms": 3}], "engine": [{"workers": 2}]}
    assert given.methods == {"reader": [{"wrong_from": 4}], "greedy": [{"offset": 1}, {"wrong_from": 4}]}


def test_the_last_override_wins(fakes):
    given = route("offset=1", "reader.offset=2")
    assert configure_default("localizer", "reader", given.methods["reader"]).offset == 2


@pytest.mark.parametrize("text", ["ofset=1", "data=1", "greedy=1"])
def test_a_key_that_nobody_has_is_an_error(fakes, text):
    with pytest.raises(ConfigError, match="unknown setting"):
        route(text)


@pytest.mark.parametrize("text", ["offst=1", "reader.offst=1"])
def test_an_error_has_the_key_that_the_user_wrote(fakes, text):
    overrides = [Override(["offst"], 1)] if text == "offst=1" else route(text).methods["reader"]
    with pytest.raises(ConfigError, match=rf"^unknown setting {text[:-2]}, did you mean 'offset'"):
        configure_default("localizer", "reader", overrides)


def test_an_error_in_a_yaml_file_names_the_file_unless_the_user_overrides_the_key(fakes, tmp_path):
    (tmp_path / "mine.yaml").write_text("kind: reader\noffst: 2\n")
    with pytest.raises(ConfigError, match=r"^mine\.yaml: unknown key offst, did you mean 'offset'"):
        configure_default("localizer", "mine.yaml")
    (tmp_path / "mine.yaml").write_text("kind: reader\noffset: wide\n")
    with pytest.raises(ConfigError, match=r"^mine\.yaml: key offset: received 'wide'"):
        configure_default("localizer", "mine.yaml", [Override(["wrong_from"], 2)])
    with pytest.raises(ConfigError, match=r"^setting mine\.offset: received 'long'"):
        configure_default("localizer", "mine.yaml", [Override(["offset"], "long", "mine")])


def test_settings_are_nested_by_their_scope():
    given = [(("data", "a", "b"), 1), (("data", "c"), 2)]
    assert nest_for(given, ("data", "engine")) == {"data": [{"a": {"b": 1}}, {"c": 2}], "engine": []}
    for path in (("rooms",), ("data",), ("localizer", "a")):
        with pytest.raises(ConfigError, match=r"received the setting .*, expected data\.KEY or engine\.KEY, where KEY"):
            nest_for([(path, 1)], ("data", "engine"))
