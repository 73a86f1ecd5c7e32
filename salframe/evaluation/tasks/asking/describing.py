"""Descriptions of the objects around a camera in words, as a person may write them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import object_label
from salframe.localization.text_places import OPPOSITE_RAD
from salframe.panoramas.geometry import wrap_angle


def describe_in_words(
    objects: Detections, labels: Sequence[str], count: int, wrong_share: float, rng: np.random.Generator
) -> str | None:
    """Return a description of random objects, such as "2 plant left of a bed, a sofa".

    Each label is named once, with the number of its objects if there are several. Labels are named in pairs, such as
    "a bed left of a sofa". The order in a pair follows the azimuths of two objects: for each of the two labels, the
    object nearest to the camera.

    Args:
        objects: The objects around the camera.
        labels: The labels that wrong words are drawn from.
        count: Number of labels to name.
        wrong_share: Probability that a label is replaced by a random one.
        rng: Generator of the choices.

    Returns:
        The description; None if there are fewer than `count` different labels.
    """
    azimuths: dict[str, list[float]] = {}
    for row in np.argsort(np.linalg.norm(objects.centroid_m, axis=1)):
        azimuth = float(np.arctan2(objects.centroid_m[row, 1], objects.centroid_m[row, 0]))
        azimuths.setdefault(object_label(objects.labels[row]), []).append(azimuth)
    if len(azimuths) < count:
        return None
    chosen = rng.permutation(sorted(azimuths))[:count].tolist()
    named = [str(rng.choice(labels)) if rng.random() < wrong_share else label for label in chosen]
    numbers = [len(azimuths[label]) for label in chosen]
    text = "".join(
        f"{_phrase(number, name)}{_order(azimuths[label][0] - azimuths[after][0]) if place % 2 == 0 else ', '}"
        for place, (number, name, (label, after)) in enumerate(zip(numbers, named, pairwise(chosen), strict=False))
    )
    return text + _phrase(numbers[-1], named[-1])


def _phrase(number: int, label: str) -> str:
    return f"{number if number > 1 else 'a'} {label}"


def _order(left_rad: float) -> str:
    """Return the order of two objects in words, from the azimuth of the first minus the azimuth of the second."""
    wrapped_rad = float(wrap_angle(left_rad))
    if abs(wrapped_rad) >= OPPOSITE_RAD:
        return " opposite "
    return " left of " if wrapped_rad > 0 else " right of "
