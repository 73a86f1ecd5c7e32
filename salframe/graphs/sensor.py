"""A sensor model: what a detector finds, what it calls it, what it makes up and how far off it is, as measured against
annotations. What adds a detector's errors to annotations and what weighs them when graphs are matched speak it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_json, read_model
from salframe.framework.validation import Settings
from salframe.graphs.vocabulary import common_label

FORMAT: Final = "salframe sensor 2"
QUANTILES = 11
"""A distribution is kept as so many values: its least, its deciles, its largest."""
PSEUDO_COUNT = 1.0
"""What all labels together are taken to have been seen of, beside the counts of one."""

Quantiles = tuple[float, ...]


class DetectionModel(Settings):
    """P(found): the logistic function of `intercept` + `per_log_solid_angle` ln(solid angle / reference) +
    `per_log_range` ln(range / reference) + `per_hidden_share` (hidden share - reference) + the group's offset.

    A group is what detectors call by one name (`common_label`); one that was not seen has offset 0, and an unknown
    quantity is taken for its reference, the median of what was measured.
    """

    intercept: float
    per_log_solid_angle: float
    per_log_range: float
    per_hidden_share: float
    reference_solid_angle_sr: float = Field(gt=0)
    reference_range_m: float = Field(gt=0)
    reference_hidden_share: float = Field(ge=0, le=1)
    offsets: dict[str, float] = Field(description="by group, drawn towards 0 as far as few objects tell")
    offset_deviation: float = Field(ge=0, description="standard deviation of the offsets of all groups")

    def probability(
        self,
        labels: Sequence[str],
        solid_angle_sr: np.ndarray | None = None,
        range_m: np.ndarray | None = None,
        hidden_share: np.ndarray | None = None,
    ) -> np.ndarray:
        """(N,) float64: how likely each of N objects is found. NaN and None are what is not known."""
        offset = np.array([self.offsets.get(common_label(label), 0.0) for label in labels], np.float64)
        terms = self.terms(len(labels), solid_angle_sr, range_m, hidden_share)
        slopes = (self.per_log_solid_angle, self.per_log_range, self.per_hidden_share)
        return 1 / (1 + np.exp(-(self.intercept + terms @ slopes + offset)))

    def terms(
        self, count: int, solid_angle_sr: np.ndarray | None, range_m: np.ndarray | None, hidden_share: np.ndarray | None
    ) -> np.ndarray:
        """(N, 3) float64: what the three slopes are multiplied by."""
        terms = np.full((count, 3), np.nan)
        if solid_angle_sr is not None:
            terms[:, 0] = np.log(np.maximum(solid_angle_sr, 1e-9) / self.reference_solid_angle_sr)
        if range_m is not None:
            terms[:, 1] = np.log(np.maximum(range_m, 1e-3) / self.reference_range_m)
        if hidden_share is not None:
            terms[:, 2] = hidden_share - self.reference_hidden_share
        return np.nan_to_num(terms)


class FalseObjects(Settings):
    """Detections that no annotated object accounts for. Quantiles from the least to the largest, evenly spaced."""

    per_panorama: float = Field(ge=0, description="mean number")
    labels: dict[str, int] = Field(description="how often each label, as the detector says it")
    range_m: Quantiles = Field(description="of the centroid")
    elevation_rad: Quantiles = Field(description="of the bearing")
    size_m: Quantiles = Field(description="cube root of the box's volume")


class Errors(Settings):
    """Robust standard deviations (1.4826 times the median distance from the median) of what is found."""

    bearing_rad: float = Field(ge=0, description="of the bearing, along either of two axes across it")
    range_share: float = Field(ge=0, description="of the logarithm of the range")
    size_log: float = Field(ge=0, description="of the logarithm of the cube root of the box's volume")
    height_m: float = Field(ge=0, description="of the centroid's height")


class Provenance(Settings):
    """What was measured, on what, and with which salframe."""

    salframe: str
    detector: dict[str, Any] = Field(description="its identity: name, version, settings, sha256 of weights and files")
    data: dict[str, dict[str, Any]] = Field(description="the identity of each data set")
    panoramas: int = Field(ge=0)
    objects: int = Field(ge=0, description="annotated objects, one for each panorama that shows it")
    detected: int = Field(ge=0, description="how many of them were found")


class SensorModel(Settings):
    """What a detector gets right, and how often. `confusion`: annotated label -> label of the detector -> count, of
    objects that were found."""

    format: Literal["salframe sensor 2"] = FORMAT
    provenance: Provenance
    detection: DetectionModel
    confusion: dict[str, dict[str, int]]
    false_objects: FalseObjects
    errors: Errors

    @property
    def right_share(self) -> float:
        """The share of the objects found whose label is right in the words that detectors share."""
        right = total = 0
        for label, row in self.confusion.items():
            total += sum(row.values())
            right += sum(count for said, count in row.items() if common_label(said) == common_label(label))
        return right / total if total else 1.0

    def label_probabilities(self, label: str) -> dict[str, float]:
        """How likely the detector says what of a found object that is annotated so.

        The counts of the label, or where it was never found those of its group, smoothed: PSEUDO_COUNT objects more
        that are right as often as all labels are, by a word of the detector's for the group, and else get any wrong
        label.
        """
        group = common_label(label)
        alike = [own for own in self.confusion if common_label(own) == group]
        counts = Counter[str]()
        for own in [label] if label in self.confusion else alike:
            counts.update(self.confusion[own])
        said, wrong = Counter[str](), Counter[str]()
        for own, row in self.confusion.items():
            for name, count in row.items():
                if common_label(name) == group:
                    said[name] += count
                elif common_label(own) != common_label(name):
                    wrong[name] += count
        right = _shares(said or {group: 1})
        share = self.right_share if wrong else 1.0
        prior = Counter({name: share * part for name, part in right.items()})
        prior.update({name: (1 - share) * part for name, part in _shares(wrong).items()})
        total = sum(counts.values()) + PSEUDO_COUNT
        return {name: (counts[name] + PSEUDO_COUNT * prior[name]) / total for name in sorted({*counts, *prior})}


def read_sensor(path: Path) -> SensorModel:
    """The sensor model in a file that `salframe sensor` wrote. Raises DataError."""
    content = read_json(path)
    found = content.get("format") if isinstance(content, Mapping) else None
    if found != FORMAT:
        raise DataError(
            f"{path} is no sensor file: its format is {found!r}, expected {FORMAT!r} as `salframe sensor` writes"
        )
    return read_model(path, SensorModel)


def quantiles(values: np.ndarray) -> Quantiles:
    """A distribution of finite values as its quantiles; none of no values."""
    if not len(values):
        return ()
    return tuple(round(float(value), 4) for value in np.quantile(values, np.linspace(0, 1, QUANTILES)))


def value_at(distribution: Quantiles, shares: np.ndarray | float) -> np.ndarray:
    """The values below which these shares, from 0 to 1, of a distribution lie."""
    return np.asarray(np.interp(shares, np.linspace(0, 1, len(distribution)), distribution))


def _shares(counts: Mapping[str, float]) -> dict[str, float]:
    total = sum(counts.values())
    return {name: count / total for name, count in counts.items()}
