"""A detector's errors as a sensor model has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from salframe.graphs.annotated import Annotated, has_points
from salframe.graphs.sensor import SensorModel, read_sensor, value_at
from salframe.graphs.sightings import box_solid_angle, sightings
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama

SENSORS = Path(__file__).with_name("sensors")
"""The sensor models that come with salframe, by the detector that they were measured of."""
OF_FALSE = (0, 1)
"""Ends the seed of a panorama's false objects: the seed of an object ends with its key."""
CORNERS = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T


class SensedNoise:
    """The errors of a measured detector. Every draw of an object depends on the seed, the frame and its key alone;
    azimuths of false objects are from the first annotated object on, so that they turn with the panorama."""

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self._words = cache(self._distribution)

    @classmethod
    def read(cls, path: Path) -> SensedNoise:
        """That of a file. Raises DataError."""
        return cls(read_sensor(path))

    def spoil(self, panorama: Panorama, objects: Sequence[Annotated], seed: tuple[int, int]) -> list[Annotated]:
        """What the detector makes of the annotated objects of a panorama, and what it makes up."""
        shown = sightings(panorama, objects)
        chances = self._sensor.detection.probability(
            shown.labels, shown.solid_angle_sr, shown.range_m, shown.hidden_share
        )
        found = []
        for one, chance in zip(objects, chances, strict=True):
            rng = np.random.default_rng((*seed, one.key))
            if rng.random() < chance:
                found.append(self._misplace(one, has_points(panorama), rng))
        ahead = _azimuth(objects[0].points_m) if objects else 0.0
        return found + self._false_objects(ahead, has_points(panorama), np.random.default_rng((*seed, *OF_FALSE)))

    def _misplace(self, one: Annotated, ranged: bool, rng: np.random.Generator) -> Annotated:
        """The object under another label, elsewhere and larger or smaller, as may be."""
        names, upto = self._words(one.label)
        label = names[int(np.searchsorted(upto, rng.random() * upto[-1], side="right"))]
        errors = self._sensor.errors
        left, up, further, larger = rng.standard_normal(4)
        points = one.points_m.astype(np.float64)
        growth = np.exp(errors.size_log * larger)
        if ranged:
            centre = points.mean(0)
            points = (centre + growth * (points - centre)) * np.exp(errors.range_share * further)
        points = _shift_bearing(points, errors.bearing_rad * left, errors.bearing_rad * up)
        return replace(
            one, label=label, points_m=points.astype(np.float32), solid_angle_sr=one.solid_angle_sr * growth**2
        )

    def _false_objects(self, ahead_rad: float, ranged: bool, rng: np.random.Generator) -> list[Annotated]:
        """Cubes that are not there, a Poisson number of them, at azimuths that are alike likely."""
        false = self._sensor.false_objects
        if not (false.labels and false.range_m and false.elevation_rad and false.size_m):
            return []
        names, counts = list(false.labels), np.array(list(false.labels.values()), float)
        made = []
        for number in range(rng.poisson(false.per_panorama)):
            label = names[rng.choice(len(names), p=counts / counts.sum())]
            range_m, elevation, side_m = (
                float(value_at(values, rng.random())) for values in (false.range_m, false.elevation_rad, false.size_m)
            )
            azimuth = ahead_rad + rng.uniform(-np.pi, np.pi)
            towards = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
            turn = pose_2d(0, 0, azimuth)[:3, :3]
            points = (range_m * towards + side_m * CORNERS) @ turn.T
            if not ranged:
                points = np.tile(turn @ towards, (8, 1))
            solid_angle_sr = min(box_solid_angle(np.full(3, side_m), range_m), 4 * np.pi)
            made.append(Annotated(-1 - number, label, points.astype(np.float32), np.full(8, solid_angle_sr / 8)))
        return made

    def _distribution(self, label: str) -> tuple[tuple[str, ...], np.ndarray]:
        """What the detector may say of an object of this label, and how likely one of the first so many words is."""
        chances = self._sensor.label_probabilities(label)
        return tuple(chances), np.cumsum(list(chances.values()))


def _azimuth(points_m: np.ndarray) -> float:
    x, y, _ = points_m.mean(0, dtype=np.float64)
    return float(np.arctan2(y, x))


def _shift_bearing(points: np.ndarray, left_rad: float, up_rad: float) -> np.ndarray:
    """Points (n, 3) turned about the camera: their mean moves by so much to the left and up on the sphere."""
    x, y, z = points.mean(0)
    level = np.hypot(x, y)
    if level < 1e-9:  # straight above or below there is no left
        return points
    ahead, side, up = np.array([x, y, 0.0]) / level, np.array([-y, x, 0.0]) / level, np.array([0.0, 0.0, 1.0])
    raised = np.arctan2(z, level) + up_rad
    across = np.cos(raised) * up - np.sin(raised) * ahead
    return points @ (_rotation(across, left_rad) @ _rotation(-side, up_rad)).T


def _rotation(axis: np.ndarray, angle_rad: float) -> np.ndarray:
    """(3, 3) rotation about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle_rad) * skew + (1 - np.cos(angle_rad)) * skew @ skew
