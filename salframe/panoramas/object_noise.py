"""Errors in what is told of a panorama's objects: missed, mislabelled, made up, and at another range."""

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
"""An object is at no less than this share of its range, however unlucky the draw."""


class ObjectNoise(Settings):
    """How often objects are told wrongly, and by how much. Every draw is keyed by seed, frame and object."""

    missed: float = Field(0.0, ge=0, le=1, description="share of the objects not found")
    mislabelled: float = Field(0.0, ge=0, le=1, description="share of the objects given another label of the data set")
    range_share: float = Field(
        0.0, ge=0, description="standard deviation of an object's range, a share of the range, one factor an object"
    )


class AnnotationNoise(ObjectNoise):
    """Errors in the annotations of a panorama, whatever its pixels show."""

    made_up: float = Field(
        0.0,
        ge=0,
        le=1,
        description="objects that are not there, a share of those that are: the outline of one elsewhere at its "
        "height, under another label",
    )


@dataclass(frozen=True)
class _Draw:
    """What befalls one object; its double, where it has one, stands `turn_rad` further."""

    missed: bool
    label: str
    factor: float
    double: str | None
    turn_rad: float


def another_label(label: str, vocabulary: Sequence[str], rng: np.random.Generator) -> str:
    """One of the other labels of a vocabulary; the label itself where there is no other."""
    others = [name for name in vocabulary if name != label]
    return others[rng.integers(len(others))] if others else label


def spoil_annotations(panorama: Panorama, noise: AnnotationNoise, seed: int) -> Panorama:
    """A panorama whose objects are told with errors; its pixels stay, but for the ranges of objects that are told at
    another. What befalls an object depends on the seed, the panorama's id and the object alone, and objects that are
    missed at a share are missed at every larger one."""
    annotations = panorama.annotations
    if annotations is None:
        return panorama
    frame, vocabulary = zlib.crc32(panorama.id.encode()), annotations.vocabulary

    def draw(key: int, label: str) -> _Draw:
        rng = np.random.default_rng((seed, frame, key))
        missed, mislabelled, doubled = rng.random(3) < (noise.missed, noise.mislabelled, noise.made_up)
        factor = max(1 + noise.range_share * rng.standard_normal(), MIN_FACTOR)
        turn_rad = rng.uniform(0, 2 * np.pi)
        wrong = [another_label(label, vocabulary, rng) for _ in range(2)]
        return _Draw(missed, wrong[0] if mislabelled else label, factor, wrong[1] if doubled else None, turn_rad)

    if annotations.objects is not None:
        listed = annotations.objects
        keys = [zlib.crc32(key.encode()) for key in listed.keys]
        draws = [draw(*one) for one in zip(keys, listed.labels, strict=True)]
        return replace(panorama, annotations=replace(annotations, objects=_spoil_list(listed, draws)))
    assert annotations.instance_id is not None  # one of both is there
    seen = np.unique(annotations.instance_id)
    named = {int(key): draw(int(key), annotations.labels[key]) for key in seen if key and key in annotations.labels}
    return _spoil_image(panorama, annotations.instance_id, annotations, named)


def _spoil_image(
    panorama: Panorama, instance_id: np.ndarray, annotations: Annotations, draws: dict[int, _Draw]
) -> Panorama:
    """As told in an instance image. What is made up lies on what is no object, as far away as that is."""
    most, width = max(int(instance_id.max()), *annotations.labels, 0), instance_id.shape[1]
    told, factors = np.arange(most + 1, dtype=np.int32), np.ones(most + 1, np.float32)
    labels = dict(annotations.labels)
    for key, one in draws.items():
        labels[key] = one.label
        if one.missed:
            told[key] = 0
        else:
            factors[key] = one.factor
    told_at = told[instance_id]
    for key, one in draws.items():
        if one.double is not None:
            most += 1
            labels[most] = one.double
            outline = np.roll(instance_id == key, -round(one.turn_rad / (2 * np.pi) * width), axis=1)
            told_at[outline & (told_at == 0) & (instance_id == 0)] = most
    range_m = None if panorama.range_m is None else panorama.range_m * factors[instance_id]
    return replace(panorama, range_m=range_m, annotations=replace(annotations, instance_id=told_at, labels=labels))


def _spoil_list(objects: ObjectBoxes, draws: Sequence[_Draw]) -> ObjectBoxes:
    """As told in a list; an object at another range spans the angle that it did."""
    rows: list[tuple[str, str, np.ndarray, np.ndarray, float]] = []
    for i, one in enumerate(draws):
        key, centroid_m, size_m, yaw_rad = objects.keys[i], objects.centroid_m[i], objects.size_m[i], objects.yaw_rad[i]
        if not one.missed:
            rows.append((one.label, key, centroid_m * one.factor, size_m * one.factor, yaw_rad))
        if one.double is not None:
            turned_m = transform_points(pose_2d(0, 0, one.turn_rad), centroid_m)
            rows.append((one.double, f"{key} made up", turned_m, size_m, (yaw_rad + one.turn_rad) % np.pi))
    if not rows:
        return ObjectBoxes.empty()
    labels, keys, centroid_m, size_m, yaw_rad = zip(*rows, strict=True)
    return ObjectBoxes(labels, keys, np.array(centroid_m), np.array(size_m), np.array(yaw_rad))
