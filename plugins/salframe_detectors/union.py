"""The detector `union`: what several detectors find, each object once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import lcm

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slots
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.vocabulary import common_label
from salframe.panoramas.panorama import Panorama
from salframe_detectors.duplicates import same_objects


class UnionDetector(Detector):
    """What several detectors find, in the names that detectors share; what more than one of them finds comes out once.

    Of an object found more than once stays the detection with the best score whose position is known, with the best of
    its scores. The order of the detectors does not matter.
    """

    name = "union"
    version = "1"

    class Config(ComponentConfig):
        of: slots("detector", ("segments", "onnx"), "the detectors to unite")  # type: ignore[valid-type]

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._members: list[Detector] = [registry().build("detector", one) for one in self.config.of]

    @property
    def needs(self) -> frozenset[str]:  # type: ignore[override]
        """All that the detectors need."""
        return frozenset[str]().union(*(member.needs for member in self._members))

    @property
    def column_step(self) -> int:  # type: ignore[override]
        """A multiple of every detector's."""
        return lcm(*(member.column_step for member in self._members))

    @property
    def turn_tolerance_m(self) -> float:  # type: ignore[override]
        """That of the least steady detector."""
        return max(member.turn_tolerance_m for member in self._members)

    def detect(self, panorama: Panorama) -> Detections:
        return unite([member.detect(panorama) for member in self._members])


def unite(found: Sequence[Detections]) -> Detections:
    """The objects of several detectors, each once, under common names; by name, the surest of each name first."""
    together = _join([replace(one, labels=tuple(map(common_label, one.labels))) for one in found])
    of = np.repeat(np.arange(len(found)), [len(one) for one in found])
    order = _order(together)
    together, of = together.take(order), of[order]
    groups = same_objects(together, of)
    placed = np.isfinite(together.centroid_m).all(1)
    # The surest comes first in each group, as in the order.
    kept = np.array([group[np.argmax(placed[group])] for group in groups], int)
    scores = np.array([together.scores[group].max() for group in groups], float)
    united = replace(together.take(kept), scores=scores)
    return united.take(_order(united))


def _order(found: Detections) -> np.ndarray:
    """Positions by label, the best score first; where scores are equal, by what neither the order of detectors nor
    turning the panorama changes."""
    keys = [found.centroid_m[:, 2], found.bearing[:, 2], found.size_m.prod(1), found.solid_angle_sr]
    return np.lexsort([*(np.nan_to_num(key) for key in keys), -found.scores, np.array(found.labels, dtype=np.str_)])


def _join(found: Sequence[Detections]) -> Detections:
    """Detections one after another. Where some have points, boxes without have those of their corners; where some have
    no masks, theirs are empty."""
    columns = ("scores", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr")
    arrays = {name: np.concatenate([getattr(one, name) for one in found]) for name in columns}
    points: list[np.ndarray] | None = None
    if any(one.points_m is not None for one in found):
        points = [cloud for one in found for cloud in (_corners(one) if one.points_m is None else one.points_m)]
    labels = tuple(label for one in found for label in one.labels)
    empty = np.zeros((0, 3), np.float32)
    masks = tuple(rays for one in found for rays in one.rays or [empty] * len(one))
    return Detections(labels, points_m=points, rays=masks, **arrays)  # type: ignore[arg-type]


def _corners(found: Detections) -> list[np.ndarray]:
    """The corners (8, 3) float32 of each box; NaN where a position is not known."""
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    c, s = np.cos(found.yaw_rad), np.sin(found.yaw_rad)
    along, across = np.stack([c, s, 0 * c], 1), np.stack([-s, c, 0 * c], 1)
    offset = signs[None] * found.size_m[:, None]
    corners = offset[..., :1] * along[:, None] + offset[..., 1:2] * across[:, None]
    corners[..., 2] = offset[..., 2]
    return list((found.centroid_m[:, None] + corners).astype(np.float32))
