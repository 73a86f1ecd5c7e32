"""Changes by class: shares that follow from the table of rates."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from salframe_house.building import change_building, generate_building
from salframe_house.dataset import House
from salframe_house.furniture import CLASSES
from salframe_house.mobility import RATES, appears, mobile_first, rate_of
from salframe_house.placement import PlacedObject

from salframe.framework.components.identity import identity


def objects(**counts):
    labels = [label.replace("_", " ") for label, count in counts.items() for _ in range(count)]
    return [
        PlacedObject(i, label, "r", 0.0, 0.0, 0.0, 0.0, (1.0, 1.0, 1.0), 0) for i, label in enumerate(labels, start=1)
    ]


def test_every_rate_is_of_one_known_class():
    named = [label for labels in RATES.values() for label in labels]
    assert len(named) == len(set(named))
    assert set(named) <= CLASSES.keys()
    assert {"ceiling lamp", "radiator", "toilet", "kitchen counter", "fireplace"} & set(named) == set()
    assert (rate_of("chair"), rate_of("plant"), rate_of("wardrobe"), rate_of("bathtub")) == (10, 3, 1, 0)


def test_the_first_to_move_are_drawn_in_proportion_to_their_rates():
    """3 chairs, 5 plants and 10 wardrobes weigh 30, 15 and 10 of 55; 4,000 first draws, four standard errors."""
    rng, things = np.random.default_rng(0), objects(chair=3, plant=5, wardrobe=10, bathtub=4)
    first = Counter(mobile_first(things, rng)[0].label for _ in range(4000))
    for label, share in (("chair", 30 / 55), ("plant", 15 / 55), ("wardrobe", 10 / 55)):
        assert first[label] / 4000 == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 4000))
    assert sorted(placed.label for placed in mobile_first(things, rng)).count("bathtub") == 0
    assert len(mobile_first(things, rng)) == 18


def test_new_objects_are_taken_by_their_rates():
    rng = np.random.default_rng(0)
    taken = [np.mean([appears(label, rng) for _ in range(2000)]) for label in ("chair", "lamp", "desk", "sink")]
    np.testing.assert_allclose(taken, [1, 0.3, 0.1, 0], atol=0.05)


def test_the_stated_share_changes_and_mostly_what_people_move():
    """Of ten offices: what changes is a third each removed, moved and added; chairs change at least four times as often
    as desks and shelves, which ten times the rate comes to when a good part of the chairs is gone; what is built in
    stays."""
    changed_of, all_of = Counter(), Counter()
    for seed in range(10):
        house = generate_building("office", 8, seed)
        later = change_building(house, 0.3, 3, "by-class")
        before = {placed.instance_id: placed for placed in house.objects}
        after = {placed.instance_id: placed for placed in later.objects}
        removed, new = before.keys() - after.keys(), after.keys() - before.keys()
        moved = {i for i in before.keys() & after.keys() if before[i] != after[i]}
        third = 0.3 * len(before) / 3
        assert all(abs(len(ids) - third) <= 1 for ids in (removed, moved, new))
        assert {rate_of(before[i].label) for i in removed | moved} | {rate_of(after[i].label) for i in new} <= set(
            RATES
        )
        all_of.update(rate_of(placed.label) for placed in house.objects)
        changed_of.update(rate_of(before[i].label) for i in removed | moved)
    shares = {rate: changed_of[rate] / all_of[rate] for rate in (10.0, 1.0)}
    assert shares[10.0] > 4 * shares[1.0] > 0
    again = change_building(house, 0.3, 3, "by-class")
    assert again.objects == later.objects
    assert change_building(house, 0.3, 3).objects != later.objects


def test_the_default_draw_leaves_the_identity_as_it_was():
    """Renderings of before this setting are still known."""
    plain = identity(House.Config())["settings"]
    assert "changes" not in plain
    assert identity(House.Config(changes="uniform"))["settings"] == plain
    assert identity(House.Config(changes="by-class"))["settings"] == {**plain, "changes": "by-class"}
