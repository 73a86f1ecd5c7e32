"""Detections of a panorama: objects with labels, scores and boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import InvalidAnswer

MAX_TEXT = 64
"""Maximum number of characters of the text of an object."""


@dataclass(frozen=True, eq=False)
class Detections:
    """Objects detected in one panorama, in the panorama frame.

    Attributes:
        labels: N names.
        scores: (N,) float64 in [0, 1].
        centroid_m: (N, 3) float64, centroids in metres, NaN where the range is unknown.
        size_m: (N, 3) float64, length, width and height of the upright boxes in metres, NaN where the range is unknown.
        yaw_rad: (N,) float64, azimuth of the longer horizontal side of the box, modulo pi.
        points_m: N arrays (n_i, 3) float32, the points behind the masks in metres; None if only boxes are known, or no
            range.
        bearing: (N, 3) float64, unit vectors towards the objects, known without range too; by default the directions of
            the centroids.
        solid_angle_sr: (N,) float64, solid angle that each object covers, NaN where unknown.
        rays: N arrays (n_i, 3) float32, unit vectors through the pixels of the masks; None if there are no masks.
        texts: N strings, the text written on each object, at most MAX_TEXT characters; "" where there is none or it
            cannot be read. By default, no object has a text.
    """

    labels: tuple[str, ...]
    scores: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray
    yaw_rad: np.ndarray
    points_m: tuple[np.ndarray, ...] | None = None
    bearing: np.ndarray = None  # type: ignore[assignment]  # set in __post_init__
    solid_angle_sr: np.ndarray = None  # type: ignore[assignment]
    rays: tuple[np.ndarray, ...] | None = None
    texts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", tuple(self.labels))
        n = len(self.labels)
        scores = check_array(self, "scores", np.float64, n, error=InvalidAnswer)
        outside = scores[~((scores >= 0) & (scores <= 1))]
        if len(outside):
            raise InvalidAnswer(f"Detections.scores contains {outside[0]}, expected numbers from 0 to 1")
        check_array(self, "centroid_m", np.float64, n, 3, error=InvalidAnswer)
        check_array(self, "size_m", np.float64, n, 3, error=InvalidAnswer)
        check_array(self, "yaw_rad", np.float64, n, error=InvalidAnswer)
        if self.bearing is None:
            object.__setattr__(self, "bearing", unit_vectors(self.centroid_m))
        if self.solid_angle_sr is None:
            object.__setattr__(self, "solid_angle_sr", np.full(n, np.nan))
        check_array(self, "bearing", np.float64, n, 3, error=InvalidAnswer)
        check_array(self, "solid_angle_sr", np.float64, n, error=InvalidAnswer)
        for name in ("points_m", "rays"):
            if (sets := getattr(self, name)) is not None and len(sets) != n:
                raise InvalidAnswer(f"Detections.{name} has {len(sets)} point sets, expected {n}, one for each object")

        object.__setattr__(self, "texts", tuple(self.texts) or ("",) * n)
        if len(self.texts) != n:
            raise InvalidAnswer(f"Detections.texts has {len(self.texts)} strings, expected {n}, one for each object")
        if (longest := max(map(len, self.texts), default=0)) > MAX_TEXT:
            raise InvalidAnswer(f"Detections.texts has a string of {longest} characters, expected at most {MAX_TEXT}")

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, index) -> Detections:
        """Return the detections with these indices, in this order."""
        index = np.asarray(index, int)
        points = None if self.points_m is None else tuple(self.points_m[i] for i in index)
        return Detections(
            tuple(self.labels[i] for i in index),
            self.scores[index],
            self.centroid_m[index],
            self.size_m[index],
            self.yaw_rad[index],
            points,
            self.bearing[index],
            self.solid_angle_sr[index],
            None if self.rays is None else tuple(self.rays[i] for i in index),
            tuple(self.texts[i] for i in index),
        )

    @classmethod
    def empty(cls) -> Detections:
        """Return an empty set of detections."""
        return cls((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def unit_vectors(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (N, 3) scaled to length 1; NaN for vectors of length 0."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.full(vectors.shape, np.nan), where=length > 0)
