"""The detector `annotations`: annotated objects with simulated detector errors."""

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
from salframe.graphs.annotated import Annotated, as_detections, has_points, visible_objects
from salframe.graphs.boxes import upright_box
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.object_noise import MIN_FACTOR, ObjectNoise, another_label
from salframe.panoramas.panorama import Panorama
from salframe_annotations.sensed import SENSORS, SensedNoise


class Noise(ObjectNoise):
    """Rates and sizes of the simulated errors of a detector. They are equal for all objects."""

    split: float = Field(
        0.0, ge=0, le=1, description="probability (0 to 1) that an object is detected as two objects, its two halves"
    )
    merged: float = Field(
        0.0,
        ge=0,
        le=1,
        description="probability (0 to 1) that an object is merged with the nearest object of the same label",
    )


LEVELS = {
    "none": Noise(),
    "uniform": Noise(missed=0.10, mislabelled=0.05, range_share=0.05),
    "uniform-heavy": Noise(missed=0.20, mislabelled=0.10, range_share=0.10),
}
"""Named levels of noise, with the same error rates for all objects."""
MEASURED = ("panoseg", "segments")
"""Detectors whose sensor models are distributed with salframe."""


class AnnotationDetector(Detector):
    """Returns the annotated objects of a panorama, with simulated errors of a detector.

    The annotations are an instance image (an object id in each pixel) or a list of objects. A range image is optional.
    """

    name = "annotations"
    version = "4"  # also the version of the sensor models in the folder `sensors`
    needs: ClassVar[frozenset[str]] = frozenset({"annotations"})

    class Config(ComponentConfig):
        noise: Literal["auto", "none", "uniform", "uniform-heavy", "panoseg", "segments"] | Noise | UserFile = Field(
            "auto",
            union_mode="left_to_right",
            description="errors to simulate. none: no errors; uniform: the same error rates for all objects; "
            "uniform-heavy: twice the rates of uniform; a mapping such as {missed: 0.3}: your rates, the same for all "
            "objects; panoseg, segments: the measured errors of the detector with this name; a path: measured errors "
            "in a file written by `salframe sensor`; auto: panoseg on rendered panoramas, none on real panoramas",
        )
        seed: int = Field(0, ge=0, description="random seed of the simulated detector errors")

        @field_validator("noise", mode="before")
        @classmethod
        def _check_noise(cls, value: Any) -> Any:
            """Reject unknown words with one message. The union type alone would report one error for each of its
            alternatives."""
            words = ("auto", *LEVELS, *MEASURED)
            if isinstance(value, str) and value not in words and not Path(value).is_file():
                choices = ", ".join(map(repr, words))
                raise ValueError(
                    f"received {value!r}, expected {choices}, a mapping of error rates, or a file that `salframe "
                    "sensor` wrote"
                )
            return value

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Create the detector.

        Raises:
            DataError: The noise is a file, but not a sensor model.
        """
        super().__init__(config)
        noise = MEASURED[0] if self.config.noise == "auto" else self.config.noise
        path = SENSORS / f"{noise}.json" if noise in MEASURED else noise
        self._sensor_noise = SensedNoise.read(path) if isinstance(path, Path) else None

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
            raise InputMissing(
                f"{panorama.display_name} has no annotations, which the detector {self.name!r} needs: choose another "
                "detector"
            )
        objects, seed = visible_objects(panorama), (self.config.seed, zlib.crc32(panorama.error_id.encode()))
        noise = self.config.noise
        if noise == "auto" and not annotations.rendered:
            detected = objects
        elif self._sensor_noise is not None:
            detected = self._sensor_noise.simulate_detections(panorama, objects, self.config.seed)
        else:
            detected = simulate_errors(
                objects, annotations.vocabulary, LEVELS[noise] if isinstance(noise, str) else noise, seed
            )
        return as_detections(detected, ranged=has_points(panorama))


def simulate_errors(
    objects: list[Annotated], vocabulary: Sequence[str], noise: Noise, seed: tuple[int, int]
) -> list[Annotated]:
    """Return the objects with simulated errors.

    The random numbers of an object depend only on the seed and its key, not on the other objects.

    Args:
        objects: The annotated objects.
        vocabulary: Labels of the data set, from which wrong labels are drawn.
        noise: Rates and sizes of the errors.
        seed: Seed from the settings, and seed of the panorama.
    """
    detected: list[Annotated] = []
    for annotated in objects:
        rng = np.random.default_rng((*seed, annotated.key))
        missed, mislabelled, split, merged = rng.random(4) < (
            noise.missed,
            noise.mislabelled,
            noise.split,
            noise.merged,
        )
        factor = max(1 + noise.range_share * rng.standard_normal(), MIN_FACTOR)
        if missed:
            continue
        label = another_label(annotated.label, vocabulary, rng) if mislabelled else annotated.label
        points_m = (annotated.points_m * factor).astype(np.float32)
        noisy = replace(annotated, label=label, points_m=points_m, text="" if mislabelled else annotated.text)
        if merged and (nearest := _nearest_of_label(annotated, objects)) is not None:
            noisy = replace(
                noisy,
                points_m=np.concatenate([points_m, nearest.points_m]),
                solid_angle_sr=np.concatenate([annotated.solid_angle_sr, nearest.solid_angle_sr]),
            )
        detected.extend(_split(noisy) if split else [noisy])
    return detected


def _nearest_of_label(target: Annotated, objects: list[Annotated]) -> Annotated | None:
    """Return the nearest other object of the same label; None if there is none."""
    others = [o for o in objects if o is not target and o.label == target.label]
    centre = target.points_m.mean(0)
    return min(others, key=lambda o: float(np.linalg.norm(o.points_m.mean(0) - centre)), default=None)


def _split(annotated: Annotated) -> list[Annotated]:
    """Cut the object into two halves across the length of its box, as an occluder does."""
    _, yaw = upright_box(annotated.points_m)
    along = annotated.points_m[:, :2] @ np.array([np.cos(yaw), np.sin(yaw)])
    left = along < np.median(along)
    if left.all() or not left.any():
        return [annotated]
    return [
        replace(annotated, points_m=annotated.points_m[part], solid_angle_sr=annotated.solid_angle_sr[part])
        for part in (left, ~left)
    ]
