"""A configuration as rows to read."""

from __future__ import annotations

from typing import Literal

import pytest
import yaml
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import Setting, list_settings, spell_value
from salframe.framework.components.slots import slot
from salframe.framework.validation import Settings
from salframe.graphs.saliency import SaliencyModel


class Grid(Settings):
    size_m: float = Field(0.5, gt=0, description="side of a cell")


class Inner(SaliencyModel):
    """Has a setting."""

    name, version = "inner", "1"

    class Config(ComponentConfig):
        share: float = Field(0.5, ge=0, le=1, description="what it keeps")

    def score(self, detections):
        return detections.scores


class Outer(Inner):
    """Has all kinds."""

    name = "outer"

    class Config(ComponentConfig):
        model: slot("saliency", "inner")
        other: slot("saliency", "inner", optional=True, description="another, or none")
        grid: Grid = Grid()
        way: Literal["straight", "round"] = "straight"
        limit: int | None = None
        tables: tuple[str, ...] = ()


@pytest.fixture
def models(fakes):
    for component in (Inner, Outer):
        registry().add(component, "test")


def test_every_setting_is_a_row_with_its_dotted_key(models):
    config = Outer.Config(model={"share": 0.25}, other=None, grid={"size_m": 2}, limit=3)
    assert list(list_settings(config)) == [
        Setting("model", "inner", "inner", "saliency", ""),
        Setting("model.share", 0.25, 0.5, "float, at least 0, at most 1", "what it keeps"),
        Setting("other", None, "inner", "saliency | null", "another, or none"),
        Setting("grid.size_m", 2.0, 0.5, "float, over 0", "side of a cell"),
        Setting("way", "straight", "straight", "straight | round", ""),
        Setting("limit", 3, None, "int | null", ""),
        Setting("tables", [], [], "tuple[str, ...]", ""),
    ]


def test_an_optional_slot_that_is_set_is_a_row_with_its_role(models):
    rows = {row.key: row for row in list_settings(Outer.Config(other={"share": 0.25}))}
    assert rows["other"] == Setting("other", "inner", "inner", "saliency | null", "another, or none")
    assert rows["other.share"].value == 0.25


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (["likelihood", "17DRP5sb8fy"], "[likelihood, 17DRP5sb8fy]"),
        (["true"], '["true"]'),
        (["0x1F"], '["0x1F"]'),
        (["a, b"], '["a, b"]'),
        ([0.5, None], "[0.5, null]"),
        ("true", "true"),
    ],
)
def test_a_list_of_names_is_spelled_without_quotes(value, text):
    assert spell_value(value) == text
    assert isinstance(value, str) or yaml.safe_load(text) == value
