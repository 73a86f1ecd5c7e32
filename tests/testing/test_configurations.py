from __future__ import annotations

from typing import Literal

import pytest
from salframe_annotations.detector import AnnotationDetector
from salframe_graphs.localizer import SaliencyGraphLocalizer

from salframe.framework.component import match_only
from salframe.framework.components.slots import slot
from salframe.framework.errors import ConfigError
from salframe.framework.validation import Settings
from salframe.testing.configurations import differences, on_rooms, random_config

SEEDS = range(1, 60)


class Nested(Settings):
    share: float = 0.8


class Drawn(SaliencyGraphLocalizer):
    """Settings of each type that the suite draws, and some that it does not."""

    name = "drawn"

    class Config(SaliencyGraphLocalizer.Config):
        eager: bool = match_only(True)
        tries: int = match_only(4, ge=3, le=6)
        share: float = match_only(0.4, gt=0, le=0.5)
        zero: float = match_only(0.0)
        way: Literal["straight", "round"] = match_only("straight")
        limit: int | None = match_only(None)
        edges_m: tuple[float, ...] = match_only((1.0, 2.0, 4.0))
        nested: Nested = match_only(Nested())
        word: str = match_only("any")
        detector: slot("detector", "annotations")

    def __init__(self, config=None):
        super().__init__(config)
        if self.config.tries == 3:
            raise ConfigError("tries: 3 is not possible with these settings")


@pytest.fixture(scope="module")
def drawn() -> list:
    return [random_config(Drawn.Config(), seed) for seed in SEEDS]


def test_draws_are_valid_and_near_the_value(drawn):
    values = {name: {getattr(config, name) for config in drawn} for name in Drawn.Config.model_fields}
    assert values["eager"] == {True, False}
    assert values["tries"] == {4, 5, 6}  # 3 is redrawn: the component cannot be created
    assert min(values["share"]) >= 0.2
    assert max(values["share"]) <= 0.5
    assert 0.0 in values["zero"]
    assert len(values["zero"]) > 5
    assert values["way"] == {"straight", "round"}
    assert {None, 1, 2} <= values["limit"]
    assert {config.nested.share == 0.8 for config in drawn} == {True, False}
    assert values["word"] == {"any"}
    for edges_m in values["edges_m"]:
        assert edges_m[1] / edges_m[0] == pytest.approx(2, rel=0.01)
        assert 0.5 <= edges_m[0] <= 2
    assert len(values["edges_m"]) > 5


def test_components_in_slots_are_drawn_with_their_settings(drawn):
    assert {config.matcher.kind for config in drawn} == {"geometric", "triplet"}
    assert {config.positioner and config.positioner.kind for config in drawn} == {"robust", "least-squares", None}
    detectors = {config.detector.kind for config in drawn}
    assert detectors - {"text"} == {"annotations"}  # text needs an extra, the others have weights
    assert len({config.matcher.structure_weight for config in drawn}) > 5


def test_a_draw_depends_on_the_seed_only(drawn):
    assert [random_config(Drawn.Config(), seed) for seed in SEEDS[:5]] == drawn[:5]
    assert len(set(map(repr, drawn))) == len(drawn)
    assert all(config != Drawn.Config() for config in drawn)


def test_the_differences_restore_the_draw():
    before = Drawn.Config()
    after = Drawn.Config(eager=False, nested={"share": 0.5}, positioner={"kind": "least-squares", "angle": "arccos"})
    expected = "positioner=least-squares, positioner.angle=arccos, eager=false, nested.share=0.5"
    assert differences(before, after) == expected
    assert differences(before, before) == ""


def test_a_component_without_settings_keeps_its_configuration():
    class Plain(AnnotationDetector):
        """Has settings of one possible value."""

        name = "plain"

        class Config(AnnotationDetector.Config):
            noise: Literal["none"] = "none"
            seed: Literal[0] = 0

    config = on_rooms(Plain.Config())
    assert random_config(config, 1) == config
