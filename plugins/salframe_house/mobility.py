"""How often people move what stands in a building: the draw of changes `by-class`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe_house.placement import PlacedObject

RATES: dict[float, tuple[str, ...]] = {
    # Moved with one hand, in daily use or by whoever cleans.
    10.0: (
        "chair", "office chair", "stool", "ottoman", "trash can", "recycling bin", "box", "laundry basket", "laptop",
        "kettle", "flowers", "drying rack", "ironing board", "housekeeping cart", "flip chart", "umbrella stand",
        "towel", "toilet paper", "luggage rack",
    ),
    # Moved with two hands, now and then.
    3.0: (
        "plant", "lamp", "floor lamp", "armchair", "side table", "coffee table", "nightstand", "coat rack", "monitor",
        "printer", "telephone", "coffee machine", "microwave", "rug", "brochure stand", "bench", "shoe rack",
    ),
    # Moved by two people, when a room is furnished anew.
    1.0: (
        "sofa", "bed", "baby bed", "dining table", "breakfast table", "conference table", "bar table", "desk",
        "bookshelf", "storage shelf", "cabinet", "file cabinet", "dresser", "tv stand", "tv", "wardrobe", "locker",
        "piano", "treadmill", "copier", "water cooler", "vending machine", "picture", "mirror", "clock", "curtain",
    ),
}  # fmt: skip
"""Relative rates, and the classes that have them. They are a judgement of what it takes to move a thing, not a survey.
What is not named here is built in or screwed on, and stays."""

_RATE_OF = {label: rate for rate, labels in RATES.items() for label in labels}


def rate_of(label: str) -> float:
    """How often objects of a class are moved beside those of others; 0 where they never are."""
    return _RATE_OF.get(label, 0.0)


def mobile_first(objects: Sequence[PlacedObject], rng: np.random.Generator) -> list[PlacedObject]:
    """The objects that can move, in a random order: at each position stands one of those left with a chance in
    proportion to its rate (exponential clocks, of which the fastest rings first)."""
    rates = np.array([rate_of(placed.label) for placed in objects])
    rings = rng.exponential(size=len(objects)) / np.maximum(rates, 1e-12)
    return [objects[i] for i in np.argsort(rings, kind="stable") if rates[i] > 0]


def appears(label: str, rng: np.random.Generator) -> bool:
    """Whether a new object of a class is one that somebody brought: the share of those drawn that its rate is of the
    highest."""
    return bool(rng.random() < rate_of(label) / max(RATES))
