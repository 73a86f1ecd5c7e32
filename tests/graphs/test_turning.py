from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from salframe.graphs.boxes import detections_from_points
from salframe.graphs.detections import Detections
from salframe.graphs.turning import from_near_side, peak_column, rotate_detections
from salframe.panoramas.geometry import column_azimuth, equirectangular_rays, pose_2d, transform_points
from salframe.panoramas.panorama import Annotations, Panorama

HEIGHT = 24
WIDTH = 2 * HEIGHT


@pytest.mark.parametrize("peak", [0, 3.3, 23, 47.6])
def test_the_peak_of_a_cosine_is_where_it_is_highest(peak):
    wave = 5 + np.cos(2 * np.pi * (np.arange(WIDTH) - peak) / WIDTH) + np.cos(6 * np.pi * np.arange(WIDTH) / WIDTH)
    assert peak_column(wave) % WIDTH == round(peak) % WIDTH


@pytest.mark.parametrize("width", [10, 62, 1000])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_peak_moves_with_the_values(width, mirrored):
    values = np.random.default_rng(0).random(width)
    if mirrored:
        values += values[::-1]  # it lies half-way between two columns
    assert [(peak_column(np.roll(values, c)) - peak_column(values) - c) % width for c in range(width)] == [0] * width


def test_turned_detections_are_those_of_turned_points():
    rng = np.random.default_rng(1)
    clouds = [(rng.normal(size=(20, 3)) * (2, 1, 1) + rng.uniform(-4, 4, 3)).astype(np.float32) for _ in range(5)]
    found = replace(detections_from_points(list("abcde"), np.full(5, 0.5), clouds), rays=tuple(clouds))
    turn = pose_2d(0, 0, 2.3)
    expected = detections_from_points(
        list("abcde"), np.full(5, 0.5), [transform_points(turn, cloud) for cloud in clouds]
    )
    turned = rotate_detections(found, 2.3)
    assert turned.labels == expected.labels
    for name in ("scores", "centroid_m", "size_m", "yaw_rad"):
        np.testing.assert_allclose(getattr(turned, name), getattr(expected, name), atol=1e-5)
    for points, moved in zip(turned.points_m, expected.points_m, strict=True):
        np.testing.assert_allclose(points, moved, atol=1e-5)
    for rays, moved in zip(turned.rays, expected.points_m, strict=True):
        np.testing.assert_allclose(rays, moved, atol=1e-5)


def room(peak: float) -> np.ndarray:
    """Ranges (HEIGHT, WIDTH) in a room whose wall is nearest in the direction of this column, with holes."""
    away_m = 3 - np.cos(2 * np.pi * (np.arange(WIDTH) + 0.5 - peak) / WIDTH)
    range_m = np.tile(away_m, (HEIGHT, 1)).astype(np.float32)
    range_m[:2] = np.nan
    return range_m


class Fixed:
    """Sees no more than the pixels in the middle of the panorama, and tells where they are."""

    def __init__(self):
        self.seen = []

    @from_near_side
    def detect(self, panorama):
        self.seen.append(panorama)
        if panorama.range_m is None or not np.isfinite(panorama.range_m).any():
            return Detections.empty()
        middle = np.s_[HEIGHT // 2 - 1 : HEIGHT // 2 + 1, HEIGHT - 1 : HEIGHT + 1]
        points = equirectangular_rays(HEIGHT)[middle] * panorama.range_m[middle][..., None]
        return detections_from_points(["wall"], np.ones(1), [points.reshape(-1, 3)])


@pytest.mark.parametrize("column", [0, 7, 24, 47])
def test_a_detector_is_shown_the_near_side_and_its_answer_is_turned_back(column):
    found = Fixed().detect(Panorama("a", range_m=room(column)))
    # The boundary between columns c - 1 and c is half a column to the left of the centre of column c.
    azimuth_rad = column_azimuth(WIDTH)[column] + np.pi / WIDTH
    np.testing.assert_allclose(
        found.centroid_m[0], 2 * np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0]), rtol=0.01, atol=0.01
    )


@pytest.mark.parametrize("range_m", [None, np.full((HEIGHT, WIDTH), np.nan, np.float32)])
def test_without_range_the_bright_side_is_shown(range_m):
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    rgb[:, 40] = 200
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[:, 0] = False
    detector = Fixed()
    detector.detect(
        Panorama(
            "a", rgb=rgb, range_m=range_m, valid=valid, annotations=Annotations(np.zeros((HEIGHT, WIDTH), np.int32))
        )
    )
    (shown,) = detector.seen
    assert np.flatnonzero(shown.rgb.any((0, 2))).tolist() == [HEIGHT]
    assert np.flatnonzero(~shown.valid.all(0)).tolist() == [HEIGHT + 8]
    assert shown.annotations is None


def test_where_nothing_is_seen_nothing_is_turned():
    detector, panorama = Fixed(), Panorama("a", valid=np.zeros((HEIGHT, WIDTH), bool))
    detector.detect(panorama)
    assert detector.seen[0] is panorama
