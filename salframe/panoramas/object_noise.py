"""Simulated errors in the objects of a panorama: missed and mislabelled objects, false positives, errors of range."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from salframe.framework.validation import Settings
from salframe.panoramas.geometry import pose_2d, transform_points
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama

MIN_FACTOR = 0.1
"""Minimum factor of the range of an object."""


class ObjectNoise(Settings):
    """Rates and sizes of simulated errors of objects. The errors of an object are random, and depend only on the seed,
    the frame and the object."""

    missed: float = Field(
        0.0,
        ge=0,
        le=1,
        description="probability (0 to 1) that an annotated object is removed, as if a detector had missed it",
    )
    mislabelled: float = Field(
        0.0,
        ge=0,
        le=1,
        description="probability (0 to 1) that an annotated object has a wrong label, which is another label of "
        "the dataset",
    )
    range_share: float = Field(
        0.0,
        ge=0,
        description="standard deviation of the error of the range of an annotated object, divided by the range (0.1: "
        "10 %); 0: no error",
    )


class AnnotationNoise(ObjectNoise):
    """Rates and sizes of simulated errors in the annotations of a panorama. The errors do not depend on the pixels."""

    false_positives: float = Field(
        0.0,
        ge=0,
        le=1,
        description="probability (0 to 1) that an annotated object causes a false positive: a copy of the object at a "
        "random azimuth, with another label",
    )


@dataclass(frozen=True)
class _Draw:
    """The random errors of one object.

    Attributes:
        missed: Whether the object is missed.
        label: Label of the object, or another label if the object is mislabelled.
        factor: Factor of the range of the object.
        false_label: Label of a false positive with the outline of this object; None if there is no false positive.
        turn_rad: Azimuth of the false positive, relative to the object.
    """

    missed: bool
    label: str
    factor: float
    false_label: str | None
    turn_rad: float


def another_label(label: str, vocabulary: Sequence[str], rng: np.random.Generator) -> str:
    """Return a random other label of a vocabulary; the label itself if there is no other."""
    others = [name for name in vocabulary if name != label]
    return others[rng.integers(len(others))] if others else label


def spoil_annotations(panorama: Panorama, noise: AnnotationNoise, seed: int) -> Panorama:
    """Return a panorama with simulated errors in its annotations.

    The pixels do not change, except for the range of objects whose range has an error. The errors of an object depend
    only on the seed, the `error_id` of the panorama and the object. Objects that are missed at some rate are missed at
    every higher rate.
    """
    annotations = panorama.annotations
    if annotations is None:
        return panorama
    frame, vocabulary = zlib.crc32(panorama.error_id.encode()), annotations.vocabulary

    def draw(key: int, label: str) -> _Draw:
        rng = np.random.default_rng((seed, frame, key))
        missed, mislabelled, doubled = rng.random(3) < (noise.missed, noise.mislabelled, noise.false_positives)
        factor = max(1 + noise.range_share * rng.standard_normal(), MIN_FACTOR)
        turn_rad = rng.uniform(0, 2 * np.pi)
        wrong = [another_label(label, vocabulary, rng) for _ in range(2)]
        return _Draw(missed, wrong[0] if mislabelled else label, factor, wrong[1] if doubled else None, turn_rad)

    if annotations.objects is not None:
        listed = annotations.objects
        keys = [zlib.crc32(key.encode()) for key in listed.keys]
        draws = [draw(key, label) for key, label in zip(keys, listed.labels, strict=True)]
        return replace(panorama, annotations=replace(annotations, objects=_spoil_list(listed, draws)))
    assert annotations.instance_id is not None  # Annotations have either a list or an image
    ids = np.unique(annotations.instance_id)
    labelled = {int(key): draw(int(key), annotations.labels[key]) for key in ids if key and key in annotations.labels}
    return _spoil_image(panorama, annotations.instance_id, annotations, labelled)


def _spoil_image(
    panorama: Panorama, instance_id: np.ndarray, annotations: Annotations, draws: dict[int, _Draw]
) -> Panorama:
    """Apply errors to an instance image. False positives cover only pixels without an object, at the range there."""
    max_id, width = max(int(instance_id.max()), *annotations.labels, 0), instance_id.shape[1]
    new_ids, factors = np.arange(max_id + 1, dtype=np.int32), np.ones(max_id + 1, np.float32)
    labels = dict(annotations.labels)
    for key, errors in draws.items():
        labels[key] = errors.label
        if errors.missed:
            new_ids[key] = 0
        else:
            factors[key] = errors.factor
    new_image = new_ids[instance_id]
    for key, errors in draws.items():
        if errors.false_label is not None:
            max_id += 1
            labels[max_id] = errors.false_label
            outline = np.roll(instance_id == key, -round(errors.turn_rad / (2 * np.pi) * width), axis=1)
            new_image[outline & (new_image == 0) & (instance_id == 0)] = max_id
    range_m = None if panorama.range_m is None else panorama.range_m * factors[instance_id]
    return replace(panorama, range_m=range_m, annotations=replace(annotations, instance_id=new_image, labels=labels))


def _spoil_list(objects: ObjectBoxes, draws: Sequence[_Draw]) -> ObjectBoxes:
    """Apply errors to a list of objects. If the range of an object changes, its angular size stays the same."""
    rows: list[tuple[str, str, np.ndarray, np.ndarray, float]] = []
    for i, errors in enumerate(draws):
        key, centroid_m, size_m, yaw_rad = objects.keys[i], objects.centroid_m[i], objects.size_m[i], objects.yaw_rad[i]
        if not errors.missed:
            rows.append((errors.label, key, centroid_m * errors.factor, size_m * errors.factor, yaw_rad))
        if errors.false_label is not None:
            turned_m = transform_points(pose_2d(0, 0, errors.turn_rad), centroid_m)
            new_yaw_rad = (yaw_rad + errors.turn_rad) % np.pi
            rows.append((errors.false_label, f"{key} made up", turned_m, size_m, new_yaw_rad))
    if not rows:
        return ObjectBoxes.empty()
    labels, keys, centroid_m, size_m, yaw_rad = zip(*rows, strict=True)
    return ObjectBoxes(labels, keys, np.array(centroid_m), np.array(size_m), np.array(yaw_rad), objects.ranged)
