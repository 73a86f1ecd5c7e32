"""The detector `annotations`."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import InputMissing
from salframe.graphs.annotated import Annotated, as_detections, has_points, seen_objects
from salframe.graphs.boxes import upright_box
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.object_noise import MIN_FACTOR, ObjectNoise, another_label
from salframe.panoramas.panorama import Panorama
from salframe_annotations.sensed import SENSORS, SensedNoise


class Noise(ObjectNoise):
    """How often a detector errs, and by how much."""

    split: float = Field(0.0, ge=0, le=1, description="share of the objects found as two halves")
    merged: float = Field(0.0, ge=0, le=1, description="share of the objects joined to the nearest of the same label")


LEVELS = {
    "none": Noise(),
    "uniform": Noise(missed=0.10, mislabelled=0.05, range_share=0.05),
    "uniform-heavy": Noise(missed=0.20, mislabelled=0.10, range_share=0.10),
}
"""Errors that every object is as likely to suffer."""
MEASURED = ("panoseg", "segments")
"""Detectors whose sensor model comes with salframe."""


class AnnotationDetector(Detector):
    """Objects from an instance image, with range or without, or from a data set's object list, with a detector's
    errors."""

    name = "annotations"
    version = "3"  # of the sensor models that come with it too
    needs: ClassVar[frozenset[str]] = frozenset({"annotations"})

    class Config(ComponentConfig):
        noise: Literal["auto", "none", "uniform", "uniform-heavy", "panoseg", "segments"] | Noise | UserFile = Field(
            "auto",
            union_mode="left_to_right",
            description="errors added: as measured of a detector (panoseg, segments, or a file of `salframe sensor`), "
            "a level that every object suffers alike (uniform, uniform-heavy) or its own shares; auto: panoseg on "
            "rendered panoramas, whose annotations are perfect, and none on those of real ones, which hold errors of "
            "their own",
        )
        seed: int = Field(0, ge=0, description="seed of the errors")

        @field_validator("noise", mode="before")
        @classmethod
        def _known(cls, value: Any) -> Any:
            """What is neither a level nor a file of the user's is told here: a union would tell all that it is not."""
            words = ("auto", *LEVELS, *MEASURED)
            if isinstance(value, str) and value not in words and not Path(value).is_file():
                known = ", ".join(map(repr, words))
                raise ValueError(f"received {value!r}, expected {known}, shares, or a file of `salframe sensor`")
            return value

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Raises DataError where the noise is a file that is no sensor model."""
        super().__init__(config)
        noise = MEASURED[0] if self.config.noise == "auto" else self.config.noise
        path = SENSORS / f"{noise}.json" if noise in MEASURED else noise
        self._sensed = SensedNoise.read(path) if isinstance(path, Path) else None

    @classmethod
    def noise_in(cls, config: Any, rendered: bool) -> str | None:
        noise = config.noise
        if noise == "auto":
            noise = MEASURED[0] if rendered else "none"
        if isinstance(noise, Path):
            return noise.stem
        if isinstance(noise, Noise):
            shares = {name: value for name, value in noise.model_dump().items() if value}
            return " ".join(f"{name} {value:g}" for name, value in shares.items()) or None
        return None if noise == "none" else noise

    def detect(self, panorama: Panorama) -> Detections:
        annotations = panorama.annotations
        if annotations is None:
            raise InputMissing(f"{panorama.id} has no annotations, which the detector {self.name!r} reads")
        objects, seed = seen_objects(panorama), (self.config.seed, zlib.crc32(panorama.id.encode()))
        noise = self.config.noise
        if noise == "auto" and not annotations.rendered:
            found = objects
        elif self._sensed is not None:
            found = self._sensed.spoil(panorama, objects, seed)
        else:
            found = spoil(objects, annotations.vocabulary, LEVELS[noise] if isinstance(noise, str) else noise, seed)
        return as_detections(found, ranged=has_points(panorama))


def spoil(objects: list[Annotated], vocabulary: Sequence[str], noise: Noise, seed: tuple[int, int]) -> list[Annotated]:
    """The objects with a detector's errors. The draws of an object depend on the seed and its key alone, not on the
    other objects."""
    found: list[Annotated] = []
    for whole in objects:
        rng = np.random.default_rng((*seed, whole.key))
        missed, mislabelled, split, merged = rng.random(4) < (
            noise.missed,
            noise.mislabelled,
            noise.split,
            noise.merged,
        )
        factor = max(1 + noise.range_share * rng.standard_normal(), MIN_FACTOR)
        if missed:
            continue
        label = another_label(whole.label, vocabulary, rng) if mislabelled else whole.label
        points_m = (whole.points_m * factor).astype(np.float32)
        spoilt = replace(whole, label=label, points_m=points_m)
        if merged and (near := _nearest_alike(whole, objects)) is not None:
            spoilt = replace(
                spoilt,
                points_m=np.concatenate([points_m, near.points_m]),
                solid_angle_sr=np.concatenate([whole.solid_angle_sr, near.solid_angle_sr]),
            )
        found.extend(_halves(spoilt) if split else [spoilt])
    return found


def _nearest_alike(one: Annotated, objects: list[Annotated]) -> Annotated | None:
    alike = [o for o in objects if o is not one and o.label == one.label]
    centre = one.points_m.mean(0)
    return min(alike, key=lambda o: float(np.linalg.norm(o.points_m.mean(0) - centre)), default=None)


def _halves(whole: Annotated) -> list[Annotated]:
    """The object cut across the length of its box, as an occluder would."""
    _, yaw = upright_box(whole.points_m)
    along = whole.points_m[:, :2] @ np.array([np.cos(yaw), np.sin(yaw)])
    left = along < np.median(along)
    if left.all() or not left.any():
        return [whole]
    return [
        replace(whole, points_m=whole.points_m[part], solid_angle_sr=whole.solid_angle_sr[part])
        for part in (left, ~left)
    ]
