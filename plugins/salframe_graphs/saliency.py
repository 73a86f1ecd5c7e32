"""Volumetric saliency (docs/explanation/method.md#from-panorama-to-graph; paper section "360-degree Saliency
Graph")."""

from __future__ import annotations

import zlib

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.graphs.boxes import MIN_SIDE_M
from salframe.graphs.detections import Detections
from salframe.graphs.saliency import SaliencyModel


class VolumetricSaliency(SaliencyModel):
    """Share of the volume of all objects: S_b = V_b / sum(V), V_b the convex hull's; 0 where it is not known.

    Where no volume is known, as without range, the share of solid angle; where that is not known either, equal shares.
    """

    name = "volumetric"
    version = "1"

    def score(self, detections: Detections) -> np.ndarray:
        for part in (object_volumes_m3(detections), detections.solid_angle_sr):
            known = np.nan_to_num(part)
            if known.any():
                return known / known.sum()
        return np.full(len(detections), 1 / max(len(detections), 1))


class UniformSaliency(SaliencyModel):
    """Equal shares: the control in which no object stands out."""

    name = "uniform"
    version = "1"

    def score(self, detections: Detections) -> np.ndarray:
        return np.full(len(detections), 1 / max(len(detections), 1))


class RandomSaliency(SaliencyModel):
    """Shares drawn by lot: the control in which what stands out means nothing. One panorama gets the same twice."""

    name = "random"
    version = "1"

    class Config(ComponentConfig):
        seed: int = Field(0, ge=0, description="seed of the draw")

    def score(self, detections: Detections) -> np.ndarray:
        height = np.where(
            np.isfinite(detections.centroid_m[:, 2]), detections.centroid_m[:, 2], detections.bearing[:, 2]
        )
        labels = np.array(detections.labels, np.str_)
        rng = np.random.default_rng((self.config.seed, zlib.crc32("\n".join(sorted(detections.labels)).encode())))
        share = np.empty(len(detections))
        share[np.lexsort((height, labels))] = rng.exponential(size=len(detections))  # neither order nor turn matters
        return share / share.sum() if len(share) else share


def object_volumes_m3(detections: Detections) -> np.ndarray:
    """(N,) float64 m^3: the convex hull of an object's points; the upright box where they are flat or too few, or where
    only boxes are known; NaN where the size is not known."""
    from scipy.spatial import ConvexHull, QhullError

    volume = detections.size_m.prod(1)
    for i, points in enumerate(detections.points_m or ()):
        if len(points) >= 4 and detections.size_m[i].min() > MIN_SIDE_M:
            try:
                volume[i] = ConvexHull(points).volume
            except QhullError:  # coplanar, but not along a side of the box
                continue
    return volume
