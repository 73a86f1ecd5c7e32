"""The detector `union`: merged detections of several detectors, each object once."""

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
from salframe.graphs.vocabulary import with_common_labels
from salframe.panoramas.panorama import Panorama
from salframe_detectors.duplicates import same_objects


class UnionDetector(Detector):
    """Merges the detections of several detectors. An object that more than one of them detects is reported once.

    The merged object has the best score of its detections. Its other values, such as the position, come from the
    detection with the best score among those with a known position. Labels with the same meaning, such as couch and
    sofa, count as equal.
    """

    name = "union"
    version = "2"

    class Config(ComponentConfig):
        of: slots("detector", ("segments", "onnx"), "list of the detectors whose detections are merged")  # type: ignore[valid-type]

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._members: list[Detector] = [registry().build("detector", detector) for detector in self.config.of]

    @property
    def needs(self) -> frozenset[str]:  # type: ignore[override]
        """Inputs that any of the detectors needs."""
        return frozenset[str]().union(*(member.needs for member in self._members))

    @property
    def column_step(self) -> int:  # type: ignore[override]
        """Number of pixel columns of one rotation step: the least common multiple of the detectors' `column_step`."""
        return lcm(*(member.column_step for member in self._members))

    @property
    def turn_tolerance_m(self) -> float:  # type: ignore[override]
        """Maximum change of a centroid and of a size in metres, apart from the rotation itself, if the panorama is
        rotated: the largest `turn_tolerance_m` of the detectors."""
        return max(member.turn_tolerance_m for member in self._members)

    def detect(self, panorama: Panorama) -> Detections:
        return unite([member.detect(panorama) for member in self._members])


def unite(parts: Sequence[Detections]) -> Detections:
    """Merge the objects of several detectors under common labels, sorted by label and by score, best first."""
    joined = _join(list(map(with_common_labels, parts)))
    source = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    order = _order(joined)
    joined, source = joined.take(order), source[order]
    groups = same_objects(joined, source)
    placed = np.isfinite(joined.centroid_m).all(1)
    # The detection with the best score is first in each group.
    representative = np.array([group[np.argmax(placed[group])] for group in groups], int)
    scores = np.array([joined.scores[group].max() for group in groups], float)
    united = replace(joined.take(representative), scores=scores)
    return united.take(_order(united))


def _order(detections: Detections) -> np.ndarray:
    """Return the indices that sort detections by label and then by score, best first.

    Equal scores are sorted by values that depend neither on the order of the detectors nor on the yaw of the panorama.
    """
    keys = [detections.centroid_m[:, 2], detections.bearing[:, 2], detections.size_m.prod(1), detections.solid_angle_sr]
    return np.lexsort(
        [*(np.nan_to_num(key) for key in keys), -detections.scores, np.array(detections.labels, dtype=np.str_)]
    )


def _join(parts: Sequence[Detections]) -> Detections:
    """Concatenate detections.

    If some detections have points, the corners of the boxes replace the missing points of the others. Missing masks are
    replaced by empty masks.
    """
    columns = ("scores", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in columns}
    points: list[np.ndarray] | None = None
    if any(part.points_m is not None for part in parts):
        points = [cloud for part in parts for cloud in (_corners(part) if part.points_m is None else part.points_m)]
    labels = tuple(label for part in parts for label in part.labels)
    empty = np.zeros((0, 3), np.float32)
    masks = tuple(rays for part in parts for rays in part.rays or [empty] * len(part))
    texts = tuple(text for part in parts for text in part.texts)
    return Detections(labels, points_m=points, rays=masks, texts=texts, **arrays)  # type: ignore[arg-type]


def _corners(detections: Detections) -> list[np.ndarray]:
    """Return the corners (8, 3) float32 of each box, NaN if its position is unknown."""
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    c, s = np.cos(detections.yaw_rad), np.sin(detections.yaw_rad)
    along, across = np.stack([c, s, 0 * c], 1), np.stack([-s, c, 0 * c], 1)
    offset = signs[None] * detections.size_m[:, None]
    corners = offset[..., :1] * along[:, None] + offset[..., 1:2] * across[:, None]
    corners[..., 2] = offset[..., 2]
    return list((detections.centroid_m[:, None] + corners).astype(np.float32))
