"""Slots: which values they take, and the error messages of wrong ones."""

from __future__ import annotations

import pytest
from pydantic import Field

from salframe.framework.component import ComponentConfig, components_in
from salframe.framework.components.defaults import defaults
from salframe.framework.components.identity import identity
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.errors import ConfigError, UnknownName
from salframe.framework.files.bounded import parse_yaml
from salframe.framework.overrides import override_of
from salframe.framework.validation import Settings, validate
from salframe.graphs.saliency import SaliencyModel


class Grid(Settings):
    size_m: float = Field(0.5, gt=0)


class Inner(SaliencyModel):
    """Has a setting."""

    name, version = "inner", "1"

    class Config(ComponentConfig):
        share: float = Field(0.5, ge=0, le=1)

    def score(self, detections):
        return detections.scores


class Plain(Inner):
    """Has no setting."""

    name = "plain"

    class Config(ComponentConfig):
        pass


class Other(Inner):
    """Has the same setting."""

    name = "other"


class Outer(Inner):
    """Has slots."""

    name = "outer"

    class Config(ComponentConfig):
        model: slot("saliency", "inner")
        judge: slot("saliency")
        grid: Grid = Grid()


class Optional(Inner):
    """Has a slot that may be empty."""

    name = "optional"

    class Config(ComponentConfig):
        model: slot("saliency", "inner")
        second: slot("saliency", optional=True)
        third: slot("saliency", "inner", optional=True)


@pytest.fixture
def models(fakes, monkeypatch):
    monkeypatch.setitem(defaults(), "saliency", "other")
    for component in (Inner, Other, Outer, Plain):
        registry().add(component, "test")


def test_a_slot_takes_a_name_a_mapping_or_a_configuration(models):
    assert Outer.Config().model == Inner.Config()
    assert Outer.Config(model="other").model == Other.Config()
    assert Outer.Config(model={"kind": "other", "share": 0.25}).model == Other.Config(share=0.25)
    assert Outer.Config(model={"share": 0.25}).model == Inner.Config(share=0.25)
    assert Outer.Config(model=Other.Config(share=0.25)).model == Other.Config(share=0.25)


def test_an_optional_slot_is_empty_unless_it_is_set(models):
    empty, filled = Optional.Config(), Optional.Config(second={"share": 0.25})
    assert empty.second is None
    assert filled.second == Other.Config(share=0.25)
    assert Optional.Config(second="inner").second == Inner.Config()
    assert (empty.third, Optional.Config(third=None).third) == (Inner.Config(), None)
    assert [name for name, _ in components_in(empty)] == ["model", "third"]
    assert [name for name, _ in components_in(filled)] == ["model", "second", "third"]
    for config in (empty, filled):
        assert Optional.Config.model_validate(config.model_dump(mode="json")) == config
    assert identity(empty)["settings"]["second"] is None
    assert identity(filled)["settings"]["second"]["name"] == "other"
    with pytest.raises(UnknownName, match="unknown saliency 'nobody'"):
        Optional.Config(second="nobody")


def test_a_slot_without_a_default_takes_that_of_the_defaults_file(models):
    assert Outer.Config().judge == Other.Config()
    assert [name for name, _ in components_in(Outer.Config())] == ["model", "judge"]


def test_a_slot_whose_role_has_no_default_is_refused(fakes, monkeypatch):
    monkeypatch.delitem(defaults(), "saliency")
    with pytest.raises(ConfigError, match="received the key 'saliency', expected a key of "):
        registry().add(Outer, "test")


def test_a_configuration_survives_json(models):
    config = Outer.Config(model={"kind": "other", "share": 0.25}, grid={"size_m": 2})
    assert config.model_dump(mode="json") == {
        "kind": "outer",
        "model": {"kind": "other", "share": 0.25},
        "judge": {"kind": "other", "share": 0.5},
        "grid": {"size_m": 2.0},
    }
    assert Outer.Config.model_validate_json(config.model_dump_json()) == config


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"modle": 1}, r"unknown setting mine\.modle, did you mean 'model' \(known settings: model, judge, grid\)"),
        ({"grid": {"size": 1}}, r"unknown setting mine\.grid\.size"),
        ({"grid": {"size_m": 0}}, r"mine\.grid\.size_m: received 0, expected a number greater than 0"),
        ({"grid": {"size_m": "wide"}}, r"mine\.grid\.size_m: received 'wide', expected a number"),
        ({"model": {"share": 2}}, r"mine\.model\.share: received 2, expected a number less than or equal to 1"),
        ({"model": {"shar": 2}}, r"unknown setting mine\.model\.shar, did you mean 'share' \(known settings: share\)"),
        ({"model": {"kind": "plain", "a": 2}}, r"^unknown setting mine\.model\.a: plain has no settings$"),
        (
            {"model": {"shar": 2, "share": 2}, "grid": {"size": 1}},
            r"mine\.model\.share: received 2, .*; unknown setting mine\.model\.shar, .*; unknown setting mine\.grid",
        ),
        ({"model": 3}, r"mine\.model: received 3, expected the name of a saliency, or a mapping of settings"),
        ({"kind": "inner"}, r"mine: the key `kind` \(name of the component\) is 'inner', expected 'outer'"),
        (
            {"a": 1, "b": 2, "c": 3, "d": 4, "e": 5},
            r"unknown setting mine\.a .*; unknown setting mine\.c .*; and 2 more errors",
        ),
    ],
)
def test_wrong_settings_are_told_in_one_line(models, settings, message):
    with pytest.raises(ConfigError, match=message) as caught:
        validate(Outer.Config, settings, "mine")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("model.shar=1", r"^unknown setting model\.shar, did you mean 'share'"),
        ("model.shar.x=1", r"^unknown setting model\.shar, did you mean 'share'"),
        ("model={kind: plain, a: 1}", r"^unknown setting model\.a: plain has no settings$"),
        ("outer.model.share=2", r"^setting outer\.model\.share: received 2"),
    ],
)
def test_errors_have_the_whole_key_that_the_user_wrote(models, text, message):
    key, _, value = text.partition("=")
    override = override_of(key, parse_yaml(value), "outer")
    with pytest.raises(ConfigError, match=message):
        validate(Outer.Config, override, "mine", None, [override])


@pytest.mark.parametrize("kind", ["iner", None, 3, ["inner"], {}])
def test_a_slot_that_names_nothing_is_an_unknown_name(models, kind):
    with pytest.raises(UnknownName, match="inner"):
        validate(Outer.Config, {"model": {"kind": kind}}, "mine")


def test_settings_are_frozen(models):
    with pytest.raises(ValueError, match="frozen"):
        Inner.Config().share = 0.1
