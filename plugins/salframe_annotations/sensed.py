"""Simulated errors of a detector, according to its sensor model (measured error rates)."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from salframe.graphs.annotated import Annotated, has_points
from salframe.graphs.boxes import box_solid_angle
from salframe.graphs.sensor import SensorModel, read_sensor, value_at
from salframe.graphs.visibility import object_visibility
from salframe.panoramas.geometry import column_azimuth, pixel_solid_angles, pose_2d, row_elevation, sample_nearest
from salframe.panoramas.panorama import Panorama

SENSORS = Path(__file__).with_name("sensors")
"""Folder of the sensor models that are distributed with salframe, named after the measured detectors."""
FALSE_POSITIVE_SEED = (0, 1)
"""Last part of the random seed of a panorama's false positives. The seed of an object ends with the key of the object
instead."""
MAX_DIRECTIONS = 2000
"""Maximum number of directions to draw for a false positive until one lies in the view."""
CORNERS = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
"""(8, 3) corners of a cube with edges of length 1, centred at the origin."""


class SensedNoise:
    """Simulates the errors of a detector, with the error rates that were measured for it (a sensor model).

    The random numbers of an object depend only on the seed, the `error_id` of the panorama (views with the same errors
    share it) and the key of the object.
    The random numbers of false positives depend only on the seed and the id of the panorama. Azimuths of false
    positives are relative to the first annotated object, so that they rotate with the panorama. The expected number of
    false positives is proportional to the share of the sphere that a partial view shows.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self._label_distribution = cache(self._distribution)

    @classmethod
    def read(cls, path: Path) -> SensedNoise:
        """Read a sensor model from a file.

        Raises:
            DataError: The file is not a sensor model.
        """
        return cls(read_sensor(path))

    def simulate_detections(self, panorama: Panorama, objects: Sequence[Annotated], seed: int) -> list[Annotated]:
        """Return the simulated detections of the annotated objects of a panorama, followed by false positives."""
        visibility = object_visibility(panorama, objects)
        probabilities = self._sensor.detection.probability(
            visibility.labels, visibility.solid_angle_sr, visibility.range_m, visibility.hidden_share
        )
        detections = []
        for annotated, detection_probability in zip(objects, probabilities, strict=True):
            rng = np.random.default_rng((seed, zlib.crc32(panorama.error_id.encode()), annotated.key))
            if rng.random() < detection_probability:
                detections.append(self._perturb(annotated, has_points(panorama), rng))
        return detections + self._draw_false_positives(
            panorama,
            _azimuth(objects[0].points_m) if objects else 0.0,
            np.random.default_rng((seed, zlib.crc32(panorama.id.encode()), *FALSE_POSITIVE_SEED)),
        )

    def _perturb(self, annotated: Annotated, ranged: bool, rng: np.random.Generator) -> Annotated:
        """Return the object with a randomly drawn label, and with random errors of direction, range and size."""
        labels, cumulative = self._label_distribution(annotated.label)
        label = labels[int(np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right"))]
        errors = self._sensor.errors
        left_error, up, range_error, size_error = rng.standard_normal(4)
        points = annotated.points_m.astype(np.float64)
        growth = np.exp(errors.size_log * size_error)
        if ranged:
            centre = points.mean(0)
            points = (centre + growth * (points - centre)) * np.exp(errors.range_share * range_error)
        points = _shift_bearing(points, errors.bearing_rad * left_error, errors.bearing_rad * up)
        return replace(
            annotated,
            label=label,
            text=annotated.text if label == annotated.label else "",
            points_m=points.astype(np.float32),
            solid_angle_sr=annotated.solid_angle_sr * growth**2,
        )

    def _draw_false_positives(self, panorama: Panorama, ahead_rad: float, rng: np.random.Generator) -> list[Annotated]:
        """Return false positives: cubes at uniformly distributed azimuths. Their number is Poisson distributed."""
        false = self._sensor.false_objects
        if not (false.labels and false.range_m and false.elevation_rad and false.size_m):
            return []
        labels, counts = list(false.labels), np.array(list(false.labels.values()), float)
        view = None if panorama.valid is None or panorama.valid.all() else panorama.valid
        false_positives = []
        for number in range(rng.poisson(false.per_panorama * (1.0 if view is None else _sphere_share(view)))):
            label = labels[rng.choice(len(labels), p=counts / counts.sum())]
            range_m, elevation, side_m = (
                float(value_at(values, rng.random())) for values in (false.range_m, false.elevation_rad, false.size_m)
            )
            azimuth = ahead_rad + rng.uniform(-np.pi, np.pi)
            if view is not None and not _sees(view, elevation, azimuth):
                elevation, azimuth = self._draw_direction(view, ahead_rad, rng)
            towards = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
            turn = pose_2d(0, 0, azimuth)[:3, :3]
            points = (range_m * towards + side_m * CORNERS) @ turn.T
            if not has_points(panorama):
                points = np.tile(turn @ towards, (8, 1))
            solid_angle_sr = min(box_solid_angle(np.full(3, side_m), range_m), 4 * np.pi)
            false_positives.append(
                Annotated(-1 - number, label, points.astype(np.float32), np.full(8, solid_angle_sr / 8))
            )
        return false_positives

    def _draw_direction(self, view: np.ndarray, ahead_rad: float, rng: np.random.Generator) -> tuple[float, float]:
        """Draw the elevation and azimuth (radians) of a false positive that the view (H, 2H) bool shows.

        If no drawn direction is in the view, return the direction of a random visible pixel.
        """
        for _ in range(MAX_DIRECTIONS):
            elevation = float(value_at(self._sensor.false_objects.elevation_rad, rng.random()))
            azimuth = ahead_rad + rng.uniform(-np.pi, np.pi)
            if _sees(view, elevation, azimuth):
                return elevation, azimuth
        row, column = divmod(int(rng.choice(np.flatnonzero(view))), view.shape[1])
        return float(row_elevation(len(view))[row]), float(column_azimuth(view.shape[1])[column])

    def _distribution(self, label: str) -> tuple[tuple[str, ...], np.ndarray]:
        """Return the labels that the detector may assign to an object with the true label `label`, and their cumulative
        probabilities."""
        probabilities = self._sensor.label_probabilities(label)
        return tuple(probabilities), np.cumsum(list(probabilities.values()))


def _sphere_share(view: np.ndarray) -> float:
    """Return the fraction of the sphere that a view (H, 2H) bool covers."""
    return float(pixel_solid_angles(len(view)) @ view.sum(1) / (4 * np.pi))


def _sees(view: np.ndarray, elevation_rad: float, azimuth_rad: float) -> bool:
    """Return whether a view (H, 2H) bool shows a direction."""
    level = np.cos(elevation_rad)
    ray = np.array([[level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), np.sin(elevation_rad)]])
    return bool(sample_nearest(view, ray)[0])


def _azimuth(points_m: np.ndarray) -> float:
    x, y, _ = points_m.mean(0, dtype=np.float64)
    return float(np.arctan2(y, x))


def _shift_bearing(points: np.ndarray, left_rad: float, up_rad: float) -> np.ndarray:
    """Return points (n, 3) rotated about the camera, so that their mean moves to the left and up by these angles."""
    x, y, z = points.mean(0)
    level = np.hypot(x, y)
    if level < 1e-9:  # straight above or below the camera, left is undefined
        return points
    forward, side, up = np.array([x, y, 0.0]) / level, np.array([-y, x, 0.0]) / level, np.array([0.0, 0.0, 1.0])
    raised = np.arctan2(z, level) + up_rad
    across = np.cos(raised) * up - np.sin(raised) * forward
    return points @ (_rotation(across, left_rad) @ _rotation(-side, up_rad)).T


def _rotation(axis: np.ndarray, angle_rad: float) -> np.ndarray:
    """Return the rotation (3, 3) about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle_rad) * skew + (1 - np.cos(angle_rad)) * skew @ skew
