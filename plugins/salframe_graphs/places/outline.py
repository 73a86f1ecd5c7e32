"""The outline of free space: horizontal range of a panorama above the furniture, by azimuth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.localization.evidence_model import PlaceFrames
from salframe.panoramas.geometry import equirectangular_rays, wrap_angle
from salframe_graphs.places.poses import Poses
from salframe_graphs.sectors import BINS, MIDDLES_RAD, azimuth_bins

OUTLINE = "outline_m"
"""Key of the outline in a description."""
LOWEST_M, HIGHEST_M = 1.85, 2.3
"""Minimum and maximum height (m) above the floor of an outline's points. Most furniture is lower. More than half of
this interval is above a door of 2 m."""
USUAL_HEIGHT_M = 1.5
"""Assumed height (m) of a camera above the floor if its height is unknown."""
ERROR_LOG, OUTLIER_FRACTION, PEAK, MAX_SQUARED = 0.1, 0.15, 3.0, 50.0
"""Standard deviation of the logarithm of a range, fraction of outlier bins, maximum likelihood ratio of an inlier, and
upper bound of the squared deviation in standard deviations."""
_MAX_M = 65.535
"""Maximum range of a packed outline: 65535 mm."""
_MIDDLES = np.column_stack([np.cos(MIDDLES_RAD), np.sin(MIDDLES_RAD)])
"""(BINS, 2) directions of the centres of the bins."""


def free_outline(range_m: np.ndarray, camera_height_m: float = np.nan) -> np.ndarray:
    """Return the outline of free space of a panorama.

    It is the median horizontal range of the points LOWEST_M to HIGHEST_M above the floor, by azimuth from +x,
    counter-clockwise.

    Args:
        range_m: (H, 2H) range image in metres.
        camera_height_m: Height of the camera above the floor; NaN: unknown, USUAL_HEIGHT_M is used.

    Returns:
        (BINS,) float32 in metres; NaN for a bin without points.
    """
    points = (equirectangular_rays(len(range_m)) * range_m[..., None]).reshape(-1, 3)
    height_m = points[:, 2] + (USUAL_HEIGHT_M if np.isnan(camera_height_m) else camera_height_m)
    points = points[(height_m > LOWEST_M) & (height_m < HIGHEST_M)]  # leaves out NaN too
    bin_ = azimuth_bins(np.arctan2(points[:, 1], points[:, 0]))
    order = np.argsort(bin_, kind="stable")
    parts = np.split(np.hypot(points[order, 0], points[order, 1]), np.searchsorted(bin_[order], np.arange(1, BINS)))
    return np.array([np.median(part) if len(part) else np.nan for part in parts], np.float32)


def pack_outline(outline_m: np.ndarray) -> np.ndarray:
    """Return the outline as (BINS,) uint16 in millimetres, 0 where it is unknown."""
    limited_m = np.minimum(np.nan_to_num(outline_m), _MAX_M)
    return np.round(limited_m * 1000).astype(np.uint16)


def unpack_outline(outline_mm: np.ndarray) -> np.ndarray:
    """Return a packed outline as (BINS,) float32 in metres, with a precision of 1 mm."""
    return np.where(outline_mm > 0, outline_mm / np.float32(1000), np.float32(np.nan))


def _fit(offset_m: np.ndarray, yaw_rad: np.ndarray, outline_m: np.ndarray) -> np.ndarray:
    """Return the log likelihood ratio (P,) that points lie on outlines, against clutter.

    Args:
        offset_m: (P, BINS, 2) points relative to the position of each outline's camera, in metres.
        yaw_rad: (P, 1) heading of each outline's camera, in [-pi, pi].
        outline_m: (P, BINS) outlines in metres.
    """
    x, y = offset_m[..., 0], offset_m[..., 1]
    bins = azimuth_bins(np.arctan2(y, x) - yaw_rad)
    expected = outline_m.ravel().take(bins + BINS * np.arange(len(bins))[:, None])
    with np.errstate(divide="ignore"):
        deviation = (0.5 / ERROR_LOG) * np.log((x * x + y * y) / (expected * expected))
    ratio = np.log(
        OUTLIER_FRACTION + (1 - OUTLIER_FRACTION) * PEAK * np.exp(-0.5 * np.minimum(deviation * deviation, MAX_SQUARED))
    )
    return np.where(np.isfinite(deviation), ratio, 0).sum(-1)


@dataclass(frozen=True, eq=False)
class MapOutlines:
    """The outlines of the frames of K places, F frames each.

    Places with fewer frames repeat their last frame. Single precision is sufficient, because an outline has an error of
    a few centimetres.

    Attributes:
        range_m: (K, F, BINS) float32 outlines in metres, NaN where unknown.
        corners_m: (K, F, BINS, 2) float32 points of the outlines in the world.
        pose: (K, F, 3) float32 x, y and yaw of the cameras in the world.
    """

    range_m: np.ndarray
    corners_m: np.ndarray
    pose: np.ndarray

    @classmethod
    def of(cls, range_m: np.ndarray, pose: np.ndarray) -> MapOutlines:
        """Return an instance for K places with F frames each, from the outlines (K, F, BINS) in metres and the camera
        poses (K, F, 3): x, y, yaw."""
        return cls(*(a.astype(np.float32) for a in (range_m, _corners(range_m, pose[..., :2], pose[..., 2]), pose)))

    @classmethod
    def of_places(cls, outline_m: np.ndarray, places: PlaceFrames, T_world_pano: np.ndarray) -> MapOutlines:
        """Return an instance from the outlines (S, BINS) and the poses (S, 3, 4) of all frames of a map, NaN for a
        frame without an outline."""
        poses = T_world_pano[places.padded]
        yaw_rad = np.arctan2(poses[..., 1, 0], poses[..., 0, 0])
        range_m = outline_m[places.padded].astype(np.float64)
        range_m[np.arange(range_m.shape[1]) >= np.diff(places.start)[:, None]] = np.nan  # ignore repeated frames
        return cls.of(range_m, np.concatenate([poses[..., :2, 3], yaw_rad[..., None]], -1))

    @cached_property
    def has_outline(self) -> np.ndarray:
        """(K, F) bool: whether a frame has an outline."""
        return np.isfinite(self.range_m).any(2)

    def ratio(self, query_m: np.ndarray, poses: Poses) -> np.ndarray:
        """Return the log likelihood ratio (C,) of a query's outline under poses; 0 where no frame has an outline.

        The points of the place's outline are compared with the query's outline, and the points of the query's outline
        with the place's. The result is the sum over all bins for the frame that fits best.

        Args:
            query_m: (BINS,) outline of the query in metres, NaN where unknown.
            poses: C poses of the query.
        """
        place = poses.place
        scaled_m = poses.scale[:, None] * query_m
        scaled_m, shift_m, yaw_rad = (a.astype(np.float32) for a in (scaled_m, poses.shift_m, poses.yaw_rad))
        row, frame = np.nonzero(self.has_outline[place])
        map_m, pose = self.range_m[place[row], frame], self.pose[place[row], frame]
        map_offset_m = self.corners_m[place[row], frame] - shift_m[row, None]
        query_offset_m = _corners(scaled_m, shift_m, yaw_rad)[row] - pose[:, None, :2]
        heading = wrap_angle(np.concatenate([yaw_rad[row], pose[:, 2]]))[:, None].astype(np.float32)
        expected = np.concatenate([scaled_m[row], map_m])
        total = _fit(np.concatenate([map_offset_m, query_offset_m]), heading, expected).reshape(2, -1).sum(0)
        best = np.full(len(place), -np.inf, total.dtype)
        np.maximum.at(best, row, total)
        return np.where(np.isfinite(best), best, 0).astype(np.float64)


def _corners(outline_m: np.ndarray, position_m: np.ndarray, yaw_rad: np.ndarray) -> np.ndarray:
    """Return the points (..., BINS, 2) of outlines in the world."""
    x, y = np.moveaxis(outline_m[..., None] * _MIDDLES.astype(outline_m.dtype), -1, 0)
    c, s = np.cos(yaw_rad)[..., None], np.sin(yaw_rad)[..., None]
    return np.stack([c * x - s * y, s * x + c * y], -1) + position_m[..., None, :]  # type: ignore[no-any-return]
