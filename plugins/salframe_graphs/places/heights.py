"""Heights of cameras above the floor: of a panorama, stored in its description, and of the places of a map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.panorama import Panorama
from salframe_graphs.places.scene_frames import SceneFrames

HEIGHT, PACKED_HEIGHT = "camera_height_m", "camera_height_mm"
"""Keys of the height in a description, and in a packed description."""
_MAX_M = 65.535
"""Maximum height that is stored: 65535 mm."""


def measure_height(panorama: Panorama) -> dict[str, np.ndarray]:
    """Return a part of a description: a dict with one array (1,), the height of the camera above the floor in metres.
    The dict is empty if the height is unknown.

    Estimated ranges are not used, because their scale may be wrong.
    """
    if panorama.range_m is None or panorama.range_by is not None:
        return {}
    height_m = camera_height(panorama.range_m)
    return {} if height_m is None or height_m > _MAX_M else {HEIGHT: np.array([height_m])}


def height_of(description: Mapping[str, np.ndarray]) -> float:
    """Return the height above the floor (m) of the camera that took a described panorama; NaN if it is unknown."""
    return float(description[HEIGHT][0]) if HEIGHT in description else np.nan


def join_heights(heights_m: Sequence[float], T_last_view: np.ndarray) -> dict[str, np.ndarray]:
    """Return the camera height of the last of V views as an array (1,) of a description; {} if no height is known.

    Each known height gives an estimate for the last view. The result is the median of the estimates.

    Args:
        heights_m: (V,) height of the camera of each view above the floor in metres, NaN where it is unknown.
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
    """
    of_last_m = np.array(heights_m) - T_last_view[:, 2, 3]
    known_m = of_last_m[np.isfinite(of_last_m)]
    return {HEIGHT: np.array([np.median(known_m)])} if len(known_m) else {}


def pack_height(description: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the height of a description as (1,) uint16 in millimetres; {} if it is unknown."""
    return {PACKED_HEIGHT: np.round(description[HEIGHT] * 1000).astype(np.uint16)} if HEIGHT in description else {}


def unpack_height(packed: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return a packed height as an array (1,) of a description."""
    return {HEIGHT: packed[PACKED_HEIGHT] / 1000} if PACKED_HEIGHT in packed else {}


def at_map_height(query: SaliencyGraph, height_m: float, map_height_m: np.ndarray) -> SaliencyGraph:
    """Return the graph of a query as seen from the median camera height of the map.

    Heights are in metres above the floor. The graph does not change if the height of the query or of all places is
    unknown.

    Args:
        query: The graph.
        height_m: Height of the camera of the query; NaN: unknown.
        map_height_m: (K,) height of the cameras of each place, NaN where it is unknown.
    """
    known_m = map_height_m[np.isfinite(map_height_m)]
    offset_m = float(np.nan_to_num(height_m - np.median(known_m))) if len(known_m) else 0.0
    return replace(query, centroid_m=query.centroid_m + np.array([0, 0, offset_m])) if offset_m else query


def place_heights(scene_frames: SceneFrames, frame_height_m: np.ndarray, frame_z_m: np.ndarray) -> np.ndarray:
    """Return the typical camera height (K,) above the floor in each place, in metres.

    This is the median z of the cameras of the place's scene frames, minus the median z of the floor below them. It is
    NaN for a place without a frame of known height.

    Args:
        scene_frames: The places and their scene frames.
        frame_height_m: (S,) height of each frame's camera above the floor, NaN where it is unknown.
        frame_z_m: (S,) z of each frame in the world.
    """
    floor_z_m = frame_z_m - frame_height_m
    heights_m = np.full(len(scene_frames), np.nan)
    for place, frames in enumerate(np.split(scene_frames.frame, scene_frames.start[1:-1])):
        known_m = floor_z_m[frames][np.isfinite(floor_z_m[frames])]
        if len(known_m):
            heights_m[place] = np.median(frame_z_m[frames]) - np.median(known_m)
    return heights_m
