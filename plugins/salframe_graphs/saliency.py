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
    """The saliency of an object is its share of the volume of all objects: S_b = V_b / sum(V).

    V_b is the volume of the convex hull of the points of object b. An object of unknown volume has the saliency 0. If
    no volume is known, such as in a panorama without range, the saliency is the object's share of the solid angle of
    all objects. If no solid angle is known either, all objects have the same saliency.
    """

    name = "volumetric"
    version = "1"

    def score(self, detections: Detections) -> np.ndarray:
        for measure in (object_volumes_m3(detections), detections.solid_angle_sr):
            values = np.nan_to_num(measure)
            if values.any():
                return values / values.sum()
        return np.full(len(detections), 1 / max(len(detections), 1))


class UniformSaliency(SaliencyModel):
    """The same saliency for all objects, a control experiment that shows the effect of saliency."""

    name = "uniform"
    version = "1"

    def score(self, detections: Detections) -> np.ndarray:
        return np.full(len(detections), 1 / max(len(detections), 1))


class RandomSaliency(SaliencyModel):
    """Random saliency, a control experiment that shows the effect of saliency.

    The same panorama always gets the same values.
    """

    name = "random"
    version = "1"

    class Config(ComponentConfig):
        seed: int = Field(0, ge=0, description="random seed of the saliency values")

    def score(self, detections: Detections) -> np.ndarray:
        height = np.where(
            np.isfinite(detections.centroid_m[:, 2]), detections.centroid_m[:, 2], detections.bearing[:, 2]
        )
        labels = np.array(detections.labels, np.str_)
        rng = np.random.default_rng((self.config.seed, zlib.crc32("\n".join(sorted(detections.labels)).encode())))
        share = np.empty(len(detections))
        share[np.lexsort((height, labels))] = rng.exponential(
            size=len(detections)
        )  # independent of the order of objects and the heading
        return share / share.sum() if len(share) else share


def object_volumes_m3(detections: Detections) -> np.ndarray:
    """Return the volume of each detection, (N,) float64 in m^3.

    This is the volume of the convex hull of the object's points. If the points are coplanar, fewer than four or
    unknown, the volume of the upright box is returned. It is NaN if the size of the box is unknown.
    """
    from scipy.spatial import ConvexHull, QhullError

    volume = detections.size_m.prod(1)
    for i, points in enumerate(detections.points_m or ()):
        if len(points) >= 4 and detections.size_m[i].min() > MIN_SIDE_M:
            try:
                volume[i] = ConvexHull(points).volume
            except QhullError:  # coplanar, but not parallel to a side of the box
                continue
    return volume
