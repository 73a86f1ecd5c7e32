"""Detections in the cache: without loss, once for each detector and panorama, with the time of their computation."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from salframe.framework.component import ComponentConfig
from salframe.framework.files.cache import Cache
from salframe.graphs.cached_detections import detect_cached, detections_from_arrays, detections_to_arrays
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.panorama import Panorama

PANORAMA = Panorama("a", rgb=np.zeros((8, 16, 3), np.uint8))
KEY = {"dataset": "data", "frame": "a"}
DELAY_S = 0.05


def some(count: int, points: bool, rays: bool) -> Detections:
    rng = np.random.default_rng(count)
    centroid_m = rng.normal(size=(count, 3))
    centroid_m[:1] = np.nan
    return Detections(
        tuple(["sofa", "Sessel, groß", "text"][number % 3] for number in range(count)),
        rng.random(count),
        centroid_m,
        rng.random((count, 3)),
        rng.random(count),
        tuple(rng.normal(size=(number, 3)).astype(np.float32) for number in range(count)) if points else None,
        rng.normal(size=(count, 3)),
        np.full(count, np.nan),
        tuple(rng.normal(size=(number + 1, 3)) for number in range(count)) if rays else None,
        tuple(["", "3.14", "Büro"][number % 3] for number in range(count)),
    )


def assert_equal(received: Detections, expected: Detections) -> None:
    for field in dataclasses.fields(Detections):
        one, other = getattr(received, field.name), getattr(expected, field.name)
        if isinstance(other, tuple) and field.name in ("points_m", "rays"):
            assert len(one) == len(other)
            for first, second in zip(one, other, strict=True):
                assert first.dtype == second.dtype
                np.testing.assert_array_equal(first, second)
        elif isinstance(other, np.ndarray):
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)
        else:
            assert one == other


class Colours(Detector):
    """One object with the red of the first pixel as its score. Waits DELAY_S."""

    name, version = "colours", "1"
    needs = frozenset({"rgb"})
    calls = 0

    class Config(ComponentConfig):
        label: str = "sofa"

    def detect(self, panorama: Panorama) -> Detections:
        type(self).calls += 1
        time.sleep(DELAY_S)
        score = np.array([panorama.rgb[0, 0, 0] / 255])
        return Detections((self.config.label,), score, np.ones((1, 3)), np.ones((1, 3)), np.zeros(1))


class NewColours(Colours):
    """A newer version."""

    version = "2"
    calls = 0


class Listed(Colours):
    """Needs no colour."""

    name = "listed"
    calls = 0
    needs = frozenset({"annotations"})


@pytest.mark.parametrize(("points", "rays"), [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("count", [0, 1, 12])
def test_stored_detections_are_the_same_to_the_last_bit(tmp_path, count, points, rays):
    expected, cache = some(count, points, rays), Cache(tmp_path)
    cache.put(KEY, detections_to_arrays(expected), 0.0)
    assert_equal(detections_from_arrays(cache.get(KEY)[0]), expected)


def test_a_panorama_is_detected_once_and_the_time_is_that_of_the_detection(tmp_path):
    cache, before = Cache(tmp_path), Colours.calls
    first, seconds = detect_cached(Colours(), PANORAMA, cache, KEY)
    again, seconds_again = detect_cached(Colours(), PANORAMA, Cache(tmp_path), KEY)
    assert Colours.calls == before + 1
    assert seconds == seconds_again >= DELAY_S
    assert_equal(again, first)


def test_another_setting_version_or_panorama_is_detected_again(tmp_path):
    cache = Cache(tmp_path)
    detect_cached(Colours(), PANORAMA, cache, KEY)
    before = Colours.calls, NewColours.calls
    other, _ = detect_cached(Colours(Colours.Config(label="bed")), PANORAMA, cache, KEY)
    assert other.labels == ("bed",)
    bright = Panorama("a", rgb=np.full((8, 16, 3), 255, np.uint8))
    other, _ = detect_cached(Colours(), bright, cache, {**KEY, "dataset": "other"})
    assert other.scores == [1]
    other, _ = detect_cached(Colours(), bright, cache, {**KEY, "level": "turned"})
    assert other.scores == [1]
    assert Colours.calls == before[0] + 3
    detect_cached(NewColours(), PANORAMA, cache, KEY)
    assert NewColours.calls == before[1] + 1


def test_detectors_without_colour_are_not_cached(tmp_path):
    cache, before = Cache(tmp_path), Listed.calls
    for _ in range(2):
        _, seconds = detect_cached(Listed(), PANORAMA, cache, KEY)
        assert seconds >= DELAY_S
    assert (Listed.calls, cache.state().entries) == (before + 2, 0)
