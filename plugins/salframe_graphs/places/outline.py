"""The outline of free space: how far a panorama sees at the height of furniture, by azimuth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays, wrap_angle
from salframe_graphs.places.likelihood import Poses

BINS = 72
LOWEST_M, HIGHEST_M = 0.35, 0.8
"""Heights over the camera whose points make the outline: over most furniture and under lintels."""
ERROR_LOG, STRAY, PEAK, MAX_SQUARED = 0.1, 0.15, 3.0, 50.0
"""Standard deviation of the logarithm of a range, the share of bins that do not fit, the ratio of one that does, and
the square of standard deviations beyond which none is further off."""
_MAX_M = 65.535
_MIDDLES = np.array([(np.cos(azimuth), np.sin(azimuth)) for azimuth in (np.arange(BINS) + 0.5) * (2 * np.pi / BINS)])
"""(BINS, 2): the directions of the bins' middles."""


def free_outline(range_m: np.ndarray) -> np.ndarray:
    """(BINS,) float32 metres: the median horizontal range of the points LOWEST_M to HIGHEST_M over the camera, by
    azimuth from +x on, counter-clockwise; NaN where there is none. range_m (H, 2H)."""
    points = (equirectangular_rays(len(range_m)) * range_m[..., None]).reshape(-1, 3)
    points = points[(points[:, 2] > LOWEST_M) & (points[:, 2] < HIGHEST_M)]  # NaN is neither
    bin_ = _bin(np.arctan2(points[:, 1], points[:, 0]))
    order = np.argsort(bin_, kind="stable")
    parts = np.split(np.hypot(points[order, 0], points[order, 1]), np.searchsorted(bin_[order], np.arange(1, BINS)))
    return np.array([np.median(part) if len(part) else np.nan for part in parts], np.float32)


def pack_outline(outline_m: np.ndarray) -> np.ndarray:
    """The outline (BINS,) uint16 in millimetres, 0 where it is not known."""
    known = np.minimum(np.nan_to_num(outline_m), _MAX_M)
    return np.round(known * 1000).astype(np.uint16)


def unpack_outline(outline_mm: np.ndarray) -> np.ndarray:
    """The outline (BINS,) float32 metres that was packed, to the millimetre."""
    return np.where(outline_mm > 0, outline_mm / np.float32(1000), np.float32(np.nan))


def _fit(offset_m: np.ndarray, yaw_rad: np.ndarray, outline_m: np.ndarray) -> np.ndarray:
    """How well points lie on outlines, (P,).

    offset_m: (P, BINS, 2) points relative to where each outline was seen. yaw_rad: (P, 1) in [-pi, pi], the heading
    there. outline_m: (P, BINS).
    """
    x, y = offset_m[..., 0], offset_m[..., 1]
    bins = _bin(np.arctan2(y, x) - yaw_rad)
    expected = outline_m.ravel().take(bins + BINS * np.arange(len(bins))[:, None])
    with np.errstate(divide="ignore"):
        off = (0.5 / ERROR_LOG) * np.log((x * x + y * y) / (expected * expected))
    ratio = np.log(STRAY + (1 - STRAY) * PEAK * np.exp(-0.5 * np.minimum(off * off, MAX_SQUARED)))
    return np.where(np.isfinite(off), ratio, 0).sum(-1)


@dataclass(frozen=True, eq=False)
class MapOutlines:
    """The outlines of K places' frames, the last one repeated up to F a place: range_m (K, F, BINS), NaN where not
    known; corners_m (K, F, BINS, 2), their points in the world; pose (K, F, 3), x, y and yaw of where each was seen.
    Single precision: the outline is a few centimetres rough."""

    range_m: np.ndarray
    corners_m: np.ndarray
    pose: np.ndarray

    @classmethod
    def of(cls, range_m: np.ndarray, pose: np.ndarray) -> MapOutlines:
        """Of outlines and where they were seen."""
        return cls(*(a.astype(np.float32) for a in (range_m, _corners(range_m, pose[..., :2], pose[..., 2]), pose)))

    @cached_property
    def known(self) -> np.ndarray:
        """(K, F) whether a frame has an outline."""
        return np.isfinite(self.range_m).any(2)

    def ratio(self, query_m: np.ndarray, poses: Poses) -> np.ndarray:
        """Return the log likelihood ratio of a query's outline under poses, (C,): 0 where no frame has an outline.

        The place's outlines are seen from the pose and the query's from theirs, bin by bin; the sum of the frame that
        fits best counts.
        query_m: (BINS,) metres, NaN where not known.
        """
        place = poses.place
        query_m, shift_m, yaw_rad = (a.astype(np.float32) for a in (query_m, poses.shift_m, poses.yaw_rad))
        row, frame = np.nonzero(self.known[place])
        map_m, pose = self.range_m[place[row], frame], self.pose[place[row], frame]
        forth = self.corners_m[place[row], frame] - shift_m[row, None]
        back = _corners(query_m, shift_m, yaw_rad)[row] - pose[:, None, :2]
        heading = wrap_angle(np.concatenate([yaw_rad[row], pose[:, 2]]))[:, None].astype(np.float32)
        expected = np.concatenate([np.broadcast_to(query_m, map_m.shape), map_m])
        total = _fit(np.concatenate([forth, back]), heading, expected).reshape(2, -1).sum(0)
        best = np.full(len(place), -np.inf, total.dtype)
        np.maximum.at(best, row, total)
        return np.where(np.isfinite(best), best, 0).astype(np.float64)


def _corners(outline_m: np.ndarray, position_m: np.ndarray, yaw_rad: np.ndarray) -> np.ndarray:
    """(..., BINS, 2) the outline's points in the world."""
    x, y = np.moveaxis(outline_m[..., None] * _MIDDLES.astype(outline_m.dtype), -1, 0)
    c, s = np.cos(yaw_rad)[..., None], np.sin(yaw_rad)[..., None]
    return np.stack([c * x - s * y, s * x + c * y], -1) + position_m[..., None, :]  # type: ignore[no-any-return]


def _bin(azimuth_rad: np.ndarray) -> np.ndarray:
    """The bins of azimuths in [-2 pi, 2 pi), int32; 0 of one that is not known."""
    with np.errstate(invalid="ignore"):
        number = np.floor(azimuth_rad * azimuth_rad.dtype.type(BINS / (2 * np.pi))).astype(np.int32)
    number += BINS * (number < 0)
    return np.minimum(np.maximum(number, 0), BINS - 1)
