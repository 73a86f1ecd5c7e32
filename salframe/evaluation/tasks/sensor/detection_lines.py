"""Detection rates of groups of similar objects, beside the rates that a sensor model (model of the errors of a
detector) predicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from salframe.evaluation.tasks.sensor.fitting import Observations
from salframe.graphs.sensor import SensorModel

APPARENT_DEG, RANGES_M, HIDDEN = (2, 4, 8, 16, 32), (2, 4, 6, 10), (0.1, 0.3, 0.6)
"""Limits of the groups of objects: angular diameter in degrees, range in metres, and share of the outline that is
hidden by nearer surfaces."""
COMMONEST = 10
"""Number of labels, the most frequent ones, for which `by_label` yields a line."""


@dataclass(frozen=True)
class DetectionLine:
    """A group of similar objects.

    Attributes:
        by: Name of the group.
        objects: Number of objects.
        detection_rate: Share of the objects that were detected.
        modelled: Mean probability of detection that the sensor model predicts for the objects.
        right: Share of the objects that were detected with the correct label.
    """

    by: str
    objects: int
    detection_rate: float | None
    modelled: float | None
    right: float | None


def by_sight(observations: Observations, sensor: SensorModel) -> Iterator[DetectionLine]:
    """Yield a line for all objects, and a line for each group of objects of similar angular size, range or hidden share
    of the outline."""
    visibility, is_detected, is_right = observations.visibility, observations.is_detected, observations.right
    probability = _modelled(observations, sensor)
    apparent_deg = np.degrees(2 * np.sqrt(visibility.solid_angle_sr / np.pi))
    splits = (
        ("{} deg across", apparent_deg, APPARENT_DEG),
        ("{} m away", visibility.range_m, RANGES_M),
        ("{} of the outline hidden", visibility.hidden_share, HIDDEN),
    )
    yield _line("all", np.ones(len(is_detected), bool), is_detected, probability, is_right)
    for words, values, parts in splits:
        bins = np.digitize(values, parts)
        between = [f"{low} to {high}" for low, high in pairwise(parts)]
        for number, name in enumerate([f"under {parts[0]}", *between, f"{parts[-1]} and more"]):
            yield _line(words.format(name), (bins == number) & np.isfinite(values), is_detected, probability, is_right)


def by_label(observations: Observations, sensor: SensorModel) -> Iterator[DetectionLine]:
    """Yield a line for the objects of each of the COMMONEST most frequent labels."""
    probability = _modelled(observations, sensor)
    for label, _ in Counter(observations.visibility.labels).most_common(COMMONEST):
        chosen = np.array([other == label for other in observations.visibility.labels])
        yield _line(label, chosen, observations.is_detected, probability, observations.right)


def _modelled(observations: Observations, sensor: SensorModel) -> np.ndarray:
    """Return the probability (N,) of detection of each object by the model."""
    visibility = observations.visibility
    return sensor.detection.probability(
        visibility.labels, visibility.solid_angle_sr, visibility.range_m, visibility.hidden_share
    )


def _line(
    by: str, chosen: np.ndarray, is_detected: np.ndarray, probability: np.ndarray, is_right: np.ndarray
) -> DetectionLine:
    count = int(chosen.sum())
    if not count:
        return DetectionLine(by, 0, None, None, None)
    return DetectionLine(by, count, *(float(values[chosen].mean()) for values in (is_detected, probability, is_right)))
