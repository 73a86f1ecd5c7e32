"""How often people move objects: the model behind `changes: by-class`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe_house.placement import PlacedObject

RATES: dict[float, tuple[str, ...]] = {
    # Moved with one hand, in daily use or when cleaning.
    10.0: (
        "chair", "office chair", "stool", "ottoman", "trash can", "recycling bin", "box", "laundry basket", "laptop",
        "kettle", "flowers", "drying rack", "ironing board", "housekeeping cart", "flip chart", "umbrella stand",
        "towel", "toilet paper", "luggage rack",
    ),
    # Moved with two hands, occasionally.
    3.0: (
        "plant", "lamp", "floor lamp", "armchair", "side table", "coffee table", "nightstand", "coat rack", "monitor",
        "printer", "telephone", "coffee machine", "microwave", "rug", "brochure stand", "bench", "shoe rack",
    ),
    # Moved by two people, when a room is refurnished.
    1.0: (
        "sofa", "bed", "baby bed", "dining table", "breakfast table", "conference table", "bar table", "desk",
        "bookshelf", "storage shelf", "cabinet", "file cabinet", "dresser", "tv stand", "tv", "wardrobe", "locker",
        "piano", "treadmill", "copier", "water cooler", "vending machine", "picture", "mirror", "clock", "curtain",
    ),
}  # fmt: skip
"""Mapping from a relative rate to the classes with this rate. The rates are an estimate of the effort of moving an
object, not the result of a survey. Classes that are not listed are built in or screwed on and do not move."""

_RATE_OF = {label: rate for rate, labels in RATES.items() for label in labels}


def rate_of(label: str) -> float:
    """Return the relative rate at which objects of a class move; 0 if they never move."""
    return _RATE_OF.get(label, 0.0)


def mobile_first(objects: Sequence[PlacedObject], rng: np.random.Generator) -> list[PlacedObject]:
    """Return the objects that can move, in a random order in which objects with high rates tend to come first.

    At each position, the probability of each remaining object is proportional to its rate (sorting by exponential
    clocks).
    """
    rates = np.array([rate_of(obj.label) for obj in objects])
    times = rng.exponential(size=len(objects)) / np.maximum(rates, 1e-12)
    return [objects[i] for i in np.argsort(times, kind="stable") if rates[i] > 0]


def appears(label: str, rng: np.random.Generator) -> bool:
    """Decide randomly whether a new object of a class is accepted.

    The probability is the rate of the class relative to the highest rate.
    """
    return bool(rng.random() < rate_of(label) / max(RATES))
