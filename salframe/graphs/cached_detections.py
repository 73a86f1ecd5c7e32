"""Cache of detections: methods that use the same detector detect the objects of a panorama only once."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from salframe.framework.components.identity import identity
from salframe.framework.files.cache import Cache
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.panorama import Panorama

VERSION = "1"
"""Version of the format of `detections_to_arrays`, as part of the cache keys of detections."""
_COLUMNS = ("scores", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr")
_POINT_SETS = ("points_m", "rays")


def detect_cached(
    detector: Detector, panorama: Panorama, cache: Cache, cache_key: Mapping[str, Any]
) -> tuple[Detections, float]:
    """Return the detections of a panorama, and the time in seconds that their computation took.

    Methods with the same cache share the detections of detectors with the same identity (name, version, settings and
    weights). If the detections come from the cache, the returned time is the time of the original computation.
    Detections of detectors that do not read colour are not cached: such detectors run no network, and detecting takes
    less time than reading the cache.

    Args:
        detector: The detector.
        panorama: The panorama.
        cache: Cache of detections.
        cache_key: Identifies the content of the panorama, JSON-serializable.
    """
    is_cached = "rgb" in detector.needs
    key = {**cache_key, "detections": VERSION, "detector": identity(detector.config, describing=True)}
    cached = cache.get(key) if is_cached else None
    if cached is not None:
        return detections_from_arrays(cached[0]), cached[1]
    start = time.perf_counter()
    detections = detector.detect(panorama)
    seconds = time.perf_counter() - start
    if is_cached:
        cache.put(key, detections_to_arrays(detections), seconds)
    return detections, seconds


def detections_to_arrays(detections: Detections) -> dict[str, np.ndarray]:
    """Return the fields of detections as named arrays, without loss, for `detections_from_arrays`."""
    arrays = {name: getattr(detections, name) for name in _COLUMNS}
    for name in _POINT_SETS:
        sets = getattr(detections, name)
        arrays[f"has_{name}"] = np.array(sets is not None)
        arrays |= {f"{name}_{number}": points for number, points in enumerate(sets or ())}
    labels, texts = np.array(detections.labels, np.str_), np.array(detections.texts, np.str_)
    return {"labels": labels, "texts": texts, **arrays}


def detections_from_arrays(arrays: Mapping[str, np.ndarray]) -> Detections:
    """Return the detections of arrays from `detections_to_arrays`."""
    labels = tuple(arrays["labels"].tolist())
    points_m, rays = (
        tuple(arrays[f"{name}_{number}"] for number in range(len(labels))) if arrays[f"has_{name}"] else None
        for name in _POINT_SETS
    )
    scores, centroid_m, size_m, yaw_rad, bearing, solid_angle_sr = (arrays[name] for name in _COLUMNS)
    texts = tuple(arrays["texts"].tolist())
    return Detections(labels, scores, centroid_m, size_m, yaw_rad, points_m, bearing, solid_angle_sr, rays, texts)
