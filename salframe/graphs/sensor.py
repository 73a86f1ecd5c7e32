"""The sensor model of a detector, measured against annotations: detection probability, label confusion, false positives
and errors of position and size. It is used to simulate the detector on annotations, and to weight errors when graphs
are matched."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import AfterValidator, Field

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_json, read_model
from salframe.framework.validation import Settings
from salframe.graphs.vocabulary import common_label

FORMAT: Final = "salframe sensor 2"
QUANTILES = 11
"""Number of quantiles that represent a distribution: minimum, deciles and maximum."""
PSEUDO_COUNT = 1.0
"""Number of virtual objects that are added to the counts of a label to smooth them, see
`SensorModel.label_probabilities`."""


def _check_quantiles(values: tuple[float, ...]) -> tuple[float, ...]:
    """Return the quantiles. Raises ValueError if their number is neither 0 nor QUANTILES, or if they are not in
    ascending order."""
    if len(values) not in (0, QUANTILES):
        raise ValueError(f"received a list of {len(values)} quantiles, expected {QUANTILES} quantiles or an empty list")
    if list(values) != sorted(values):
        raise ValueError(f"received the quantiles {list(values)}, expected values in ascending order")
    return values


LogOdds = Annotated[float, Field(ge=-1000, le=1000)]
NumObjects = Annotated[int, Field(ge=0, le=10**12)]
Length = Annotated[float, Field(ge=0, le=10_000)]
Quantiles = Annotated[tuple[float, ...], AfterValidator(_check_quantiles)]
Lengths = Annotated[tuple[Length, ...], AfterValidator(_check_quantiles)]


class DetectionModel(Settings):
    """Probability that an object is detected.

    It is the logistic function of `intercept` + `per_log_solid_angle` ln(solid angle / reference) + `per_log_range`
    ln(range / reference) + `per_hidden_share` (hidden share - reference) + offset of the label group. The hidden share
    is the share of the outline of the object that borders a nearer surface.

    A group is a set of labels with the same `common_label`. A group without measurements has the offset 0. The
    references are the medians of the measurements. An unknown quantity is replaced by its reference.
    """

    intercept: LogOdds
    per_log_solid_angle: LogOdds
    per_log_range: LogOdds
    per_hidden_share: LogOdds
    reference_solid_angle_sr: float = Field(gt=0)
    reference_range_m: float = Field(gt=0)
    reference_hidden_share: float = Field(ge=0, le=1)
    offsets: dict[str, LogOdds] = Field(
        description="change of the log-odds of detection for each group of labels, shrunk towards 0 for groups of "
        "few objects"
    )
    offset_deviation: float = Field(
        ge=0, description="standard deviation of the per-group changes of the log-odds of detection"
    )

    def probability(
        self,
        labels: Sequence[str],
        solid_angle_sr: np.ndarray | None = None,
        range_m: np.ndarray | None = None,
        hidden_share: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the probability that each of N objects is detected, (N,) float64.

        Args:
            labels: N annotated labels.
            solid_angle_sr: (N,) solid angles in steradians, NaN or None if unknown.
            range_m: (N,) ranges in metres, NaN or None if unknown.
            hidden_share: (N,) as in ObjectVisibility, NaN or None if unknown.
        """
        offset = np.array([self.offsets.get(common_label(label), 0.0) for label in labels], np.float64)
        terms = self.terms(len(labels), solid_angle_sr, range_m, hidden_share)
        slopes = (self.per_log_solid_angle, self.per_log_range, self.per_hidden_share)
        return 1 / (1 + np.exp(-(self.intercept + terms @ slopes + offset)))

    def terms(
        self, count: int, solid_angle_sr: np.ndarray | None, range_m: np.ndarray | None, hidden_share: np.ndarray | None
    ) -> np.ndarray:
        """Return the three quantities that the slopes are multiplied by, relative to their references, (N, 3) float64:
        log solid angle, log range and hidden share; 0 where unknown."""
        terms = np.full((count, 3), np.nan)
        if solid_angle_sr is not None:
            terms[:, 0] = np.log(np.maximum(solid_angle_sr, 1e-9) / self.reference_solid_angle_sr)
        if range_m is not None:
            terms[:, 1] = np.log(np.maximum(range_m, 1e-3) / self.reference_range_m)
        if hidden_share is not None:
            terms[:, 2] = hidden_share - self.reference_hidden_share
        return np.nan_to_num(terms)


class FalseObjects(Settings):
    """False positives: detections without an annotated object.

    A list of quantiles has evenly spaced levels from 0 (minimum) to 1 (maximum).
    """

    per_panorama: float = Field(ge=0, le=10_000, description="mean number of false positives per panorama")
    labels: dict[str, NumObjects] = Field(description="number of false positives with each label of the detector")
    range_m: Lengths = Field(description="quantiles of the range of the centroids of false positives (m)")
    elevation_rad: Quantiles = Field(
        description="quantiles of the elevation of the bearings of false positives (radians)"
    )
    size_m: Lengths = Field(
        description="quantiles of the size of false positives: the cube root of the box's volume (m)"
    )


class Errors(Settings):
    """Robust standard deviations (1.4826 times the median absolute deviation) of the errors of detections."""

    bearing_rad: float = Field(
        ge=0,
        le=np.pi,
        description="robust standard deviation of the bearing of a detection, along either of two axes across it "
        "(radians)",
    )
    range_share: float = Field(
        ge=0, le=10, description="robust standard deviation of the natural logarithm of the range of a detection"
    )
    size_log: float = Field(
        ge=0,
        le=10,
        description="robust standard deviation of the natural logarithm of a detection's size, the cube root of "
        "its box's volume",
    )
    height_m: float = Field(
        ge=0, le=10_000, description="robust standard deviation of the height of a detection's centroid (m)"
    )


class Provenance(Settings):
    """Origin of a sensor model: the detector, the data, and the version of salframe that it was measured with."""

    salframe: str
    detector: dict[str, Any] = Field(
        description="identity of the measured detector: name, version, settings, sha256 of weights and files"
    )
    data: dict[str, dict[str, Any]] = Field(
        description="mapping from the name of each dataset to its identity (settings and version)"
    )
    panoramas: NumObjects = Field(description="number of panoramas in which the detector was measured")
    objects: NumObjects = Field(
        description="number of annotated objects in the measured panoramas; an object counts once per panorama "
        "that shows it"
    )
    detected: NumObjects = Field(description="number of annotated objects that the detector detected")


class SensorModel(Settings):
    """The sensor model of a detector. `confusion` maps each annotated label to a mapping from the label of the detector
    to the number of detected objects."""

    format: Literal["salframe sensor 2"] = FORMAT
    provenance: Provenance
    detection: DetectionModel
    confusion: dict[str, dict[str, NumObjects]]
    false_objects: FalseObjects
    errors: Errors

    @property
    def right_share(self) -> float:
        """The share of detected objects with the correct label, compared by `common_label`."""
        correct = total = 0
        for label, row in self.confusion.items():
            total += sum(row.values())
            correct += sum(count for detected, count in row.items() if common_label(detected) == common_label(label))
        return correct / total if total else 1.0

    def label_probabilities(self, label: str) -> dict[str, float]:
        """Return the probability of each label of the detector for a detected object with this annotated label.

        The probabilities are proportional to the counts of the label. If the label was never detected, the counts of
        its group are used: the labels with the same `common_label`. The counts are smoothed:
        PSEUDO_COUNT virtual objects are added to them. The share `right_share` of these is distributed over the labels
        that are correct for the group, in the proportions in which the detector uses them. The rest is distributed over
        wrong labels, in the proportions of all wrong labels of the detector.
        """
        group = common_label(label)
        group_labels = [annotated for annotated in self.confusion if common_label(annotated) == group]
        counts = Counter[str]()
        for annotated in [label] if label in self.confusion else group_labels:
            counts.update(self.confusion[annotated])
        correct, wrong = Counter[str](), Counter[str]()
        for annotated, row in self.confusion.items():
            for name, count in row.items():
                if common_label(name) == group:
                    correct[name] += count
                elif common_label(annotated) != common_label(name):
                    wrong[name] += count
        share = self.right_share if wrong else 1.0
        prior = Counter({name: share * part for name, part in _shares(correct or {group: 1}).items()})
        prior.update({name: (1 - share) * part for name, part in _shares(wrong).items()})
        total = sum(counts.values()) + PSEUDO_COUNT
        return {name: (counts[name] + PSEUDO_COUNT * prior[name]) / total for name in sorted({*counts, *prior})}


def read_sensor(path: Path) -> SensorModel:
    """Read the sensor model in a file written by `salframe sensor`.

    Raises:
        DataError: The file cannot be read or is not a sensor file.
    """
    content = read_json(path)
    file_format = content.get("format") if isinstance(content, Mapping) else None
    if file_format != FORMAT:
        raise DataError(
            f"{path} has the format {file_format!r}, expected {FORMAT!r}: write a sensor file with `salframe sensor`"
        )
    return read_model(path, SensorModel)


def quantiles(values: np.ndarray) -> Quantiles:
    """Return QUANTILES evenly spaced quantiles (minimum to maximum) of finite values (N,), rounded to 4 decimals; () if
    there are no values."""
    if not len(values):
        return ()
    return tuple(round(float(value), 4) for value in np.quantile(values, np.linspace(0, 1, QUANTILES)))


def value_at(distribution: Quantiles, shares: np.ndarray | float) -> np.ndarray:
    """Return the values of a distribution at the quantile levels `shares` (from 0 to 1), in the shape of `shares`, by
    linear interpolation. `distribution` contains evenly spaced quantiles, as `quantiles` returns them."""
    return np.asarray(np.interp(shares, np.linspace(0, 1, len(distribution)), distribution))


def _shares(counts: Mapping[str, float]) -> dict[str, float]:
    total = sum(counts.values())
    return {name: count / total for name, count in counts.items()}
