"""A detector that finds the same balls whatever it is shown: what is seen of them is known in closed form."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

import salframe
from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError
from salframe.graphs.boxes import detections_from_points
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.geometry import equirectangular_rays

BALLS = (
    ("globe", (1.0, np.sqrt(3.0), 0.0), 0.5, 0.9),  # 2 m away at 60 deg to the left
    ("lamp", (1.5, 0.0, 1.5), 0.3, 0.4),  # 45 deg up
    ("ottoman", (-3.0, 0.0, -0.4), 0.6, 0.7),  # behind, on the seam
)
"""Label, centre and radius in metres, score."""


def visible_points(centre_m, radius_m: float, height: int = 256) -> np.ndarray:
    """(n, 3) float32 where the rays of a panorama meet a ball first."""
    rays, centre = equirectangular_rays(height).reshape(-1, 3).astype(np.float64), np.array(centre_m)
    along = rays @ centre
    square = radius_m**2 - (centre @ centre - along**2)
    hit = (along > 0) & (square > 0)
    return (rays[hit] * (along[hit] - np.sqrt(square[hit]))[:, None]).astype(np.float32)


def angular_radius(centre_m, radius_m: float) -> float:
    """Radians."""
    return float(np.arcsin(radius_m / np.linalg.norm(centre_m)))


def balls(with_range: bool) -> Detections:
    """All of them; without range their bearings and solid angles."""
    labels, scores = [ball[0] for ball in BALLS], np.array([ball[3] for ball in BALLS])
    if with_range:
        return detections_from_points(labels, scores, [visible_points(*ball[1:3]) for ball in BALLS])
    centres = np.array([ball[1] for ball in BALLS])
    solid = 2 * np.pi * (1 - np.cos([angular_radius(*ball[1:3]) for ball in BALLS]))
    unknown = np.full((len(BALLS), 3), np.nan)
    bearing = centres / np.linalg.norm(centres, axis=1, keepdims=True)
    return Detections(tuple(labels), scores, unknown, unknown, unknown[:, 0], None, bearing, solid)


class BallDetector(Detector):
    """Finds the balls, and how far they are where the panorama has range."""

    name = "balls"
    version = "1"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})

    class Config(ComponentConfig):
        min_score: float = Field(0.0, description="balls that score less are left out")
        fail: bool = Field(False, description="find fault with every panorama")

    def detect(self, panorama):
        if self.config.fail:
            raise DataError("no ball today")
        found = balls(panorama.range_m is not None)
        return found.take(np.flatnonzero(found.scores >= self.config.min_score))


class RangeBallDetector(BallDetector):
    """Needs range."""

    name = "range-balls"
    needs = frozenset({"rgb", "range"})


@salframe.hookimpl
def salframe_provides():
    return [BallDetector, RangeBallDetector]
