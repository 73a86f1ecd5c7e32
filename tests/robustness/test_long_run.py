"""A program that asks an open map for a day."""

from __future__ import annotations

import psutil
import pytest

import salframe
from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.localization.describing import describe_frame
from salframe.localization.map import LocalizationMap
from salframe.testing.rooms import query_frames, random_frames

QUESTIONS = 20_000
MAX_GROWTH_MB = 5.0


@pytest.mark.slow
def test_20000_questions_take_no_more_memory(tmp_path):
    """One question in four seconds, for a day."""
    frames, queries = random_frames(1)
    config = configure_default("localizer", "saliency-places", [{"detector": {"kind": "annotations"}}])
    LocalizationMap.build(registry().build("localizer", config), frames).save(tmp_path / "map")
    map = salframe.open_map(tmp_path / "map")
    descriptions = [describe_frame(map.localizer, query)[0] for query in [*queries, *query_frames()]]
    process, places = psutil.Process(), set()

    def ask(count: int) -> float:
        for number in range(count):
            answer = map.answer(descriptions[number % len(descriptions)])
            places.update((number % len(descriptions), ranked.place) for ranked in answer.places[:1])
        return process.memory_info().rss / 1e6

    before_mb = ask(QUESTIONS // 10)
    assert ask(QUESTIONS) - before_mb < MAX_GROWTH_MB
    assert len(places) <= len(descriptions)  # the same question has the same answer
