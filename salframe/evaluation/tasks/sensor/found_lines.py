"""How much of what is alike a detector finds, beside what a sensor model says of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from salframe.evaluation.tasks.sensor.fitting import Observations
from salframe.graphs.sensor import SensorModel

APPARENT_DEG, RANGES_M, HIDDEN = (2, 4, 8, 16, 32), (2, 4, 6, 10), (0.1, 0.3, 0.6)
"""Where the lines part: diameter of the disc of an object's solid angle, range, hidden share."""
COMMONEST = 10
"""So many labels have a line of their own."""


@dataclass(frozen=True)
class FoundLine:
    """Objects that are alike: how many, and the shares of them that were found, that the model says, and that were
    found by a right label; None of none."""

    by: str
    objects: int
    found: float | None
    modelled: float | None
    right: float | None


def by_sight(seen: Observations, sensor: SensorModel) -> Iterator[FoundLine]:
    """How often objects of a size, a range, a hidden share were found, and how often the model says."""
    shown, found, right = seen.shown, seen.found, seen.right
    modelled = _modelled(seen, sensor)
    apparent_deg = np.degrees(2 * np.sqrt(shown.solid_angle_sr / np.pi))
    splits = (
        ("{} deg across", apparent_deg, APPARENT_DEG),
        ("{} m away", shown.range_m, RANGES_M),
        ("{} of the outline hidden", shown.hidden_share, HIDDEN),
    )
    yield _line("all", np.ones(len(found), bool), found, modelled, right)
    for words, values, parts in splits:
        bins = np.digitize(values, parts)
        between = [f"{low} to {high}" for low, high in pairwise(parts)]
        for number, name in enumerate([f"under {parts[0]}", *between, f"{parts[-1]} and more"]):
            yield _line(words.format(name), (bins == number) & np.isfinite(values), found, modelled, right)


def by_label(seen: Observations, sensor: SensorModel) -> Iterator[FoundLine]:
    """The same of the commonest labels."""
    modelled = _modelled(seen, sensor)
    for label, _ in Counter(seen.shown.labels).most_common(COMMONEST):
        chosen = np.array([own == label for own in seen.shown.labels])
        yield _line(label, chosen, seen.found, modelled, seen.right)


def _modelled(seen: Observations, sensor: SensorModel) -> np.ndarray:
    """(N,) how likely each object is found, as the model says."""
    shown = seen.shown
    return sensor.found.probability(shown.labels, shown.solid_angle_sr, shown.range_m, shown.hidden_share)


def _line(by: str, chosen: np.ndarray, found: np.ndarray, modelled: np.ndarray, right: np.ndarray) -> FoundLine:
    count = int(chosen.sum())
    if not count:
        return FoundLine(by, 0, None, None, None)
    return FoundLine(by, count, *(float(values[chosen].mean()) for values in (found, modelled, right)))
