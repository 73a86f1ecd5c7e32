"""Merge the detections of a network in perspective views of one panorama: suppress overlapping boxes in each view, then
combine the detections of the same object in several views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.boxes import MIN_POINTS, detections_where_known
from salframe.graphs.detections import Detections, unit_vectors
from salframe.graphs.foreground import foreground
from salframe.panoramas.coverage import Rig

AGREEMENT = 0.2
"""Minimum intersection over union of two detections of the same object in two views. It is low because a box in a
tilted view has another shape on the sphere. In a test on three rendered buildings, with boxes around the objects that
were cut at the borders of the views, 7 of 1,995 objects were reported twice (24 with a minimum of 0.45), and one pair
of objects was confused."""
INSIDE = 0.3
"""A detection that is cut by the border of a view is joined with a larger detection that covers more than this share of
the cut detection. Without this rule, 70 of the 1,995 objects in the test of AGREEMENT were reported twice."""
MIN_SHARED = 0.1
"""Minimum overlap of two detections of the same object, as a share of the smaller detection. It excludes detections
that overlap only in a narrow strip at the border of a view."""
CANDIDATES, MAX_DETECTIONS = 1000, 100
"""Maximum number of boxes per view before and after suppression, as the defaults of Detectron2. They limit the
computing time for networks with more outputs."""


@dataclass(frozen=True, eq=False)
class ImageDetections:
    """Detections of a network in one image.

    Attributes:
        box_px: (n, 4) boxes in pixels: left, top, right, bottom. The centre of the first pixel is (0.5, 0.5).
        score: (n,) scores in [0, 1].
        label: (n,) int, class indices.
        mask: (n, height, width) bool masks; None if only boxes are known.
    """

    box_px: np.ndarray
    score: np.ndarray
    label: np.ndarray
    mask: np.ndarray | None = None

    def take(self, index: np.ndarray) -> ImageDetections:
        """Return the detections with these indices."""
        return ImageDetections(
            self.box_px[index], self.score[index], self.label[index], None if self.mask is None else self.mask[index]
        )

    def masks(self) -> Sequence[np.ndarray | None]:
        """Return one entry per detection: its mask (height, width) bool, or None if only boxes are known."""
        return [None] * len(self.score) if self.mask is None else list(self.mask)


def suppress(detections: ImageDetections, overlap: float) -> ImageDetections:
    """Return the detections after non-maximum suppression: if the intersection over union of boxes of one class exceeds
    `overlap`, only the box with the best score remains.

    Only the CANDIDATES boxes with the best scores are compared. At most MAX_DETECTIONS boxes are returned.
    """
    import cv2

    if not len(detections.score):
        return detections
    detections = detections.take(_best(detections.score, CANDIDATES))
    corner, size = detections.box_px[:, :2], detections.box_px[:, 2:] - detections.box_px[:, :2]
    indices = cv2.dnn.NMSBoxesBatched(
        np.hstack([corner, size]).tolist(), detections.score.tolist(), detections.label.tolist(), 0.0, overlap
    )
    detections = detections.take(np.array(indices, int).ravel())
    return detections.take(_best(detections.score, MAX_DETECTIONS))


def _best(score: np.ndarray, count: int) -> np.ndarray:
    """Return the indices of the `count` highest scores, in ascending order. Among equal scores, the first ones are
    selected."""
    return np.sort(np.argsort(-score, kind="stable")[:count])


def group(
    footprint: np.ndarray, view: np.ndarray, cut: np.ndarray, visible: np.ndarray, solid_angle_sr: np.ndarray
) -> list[np.ndarray]:
    """Group the detections of one class by object.

    Two detections in different views are the same object if the intersection over union of their footprints exceeds
    AGREEMENT. It is computed in the part of the sphere that both views show. A group has at most one detection per
    view. Pairs with the highest intersection over union are joined first.

    Then small groups at the borders of views are joined with larger detections: if the borders of the views cut all
    detections of a group, and a larger detection of another view covers more than INSIDE of one of them, the group is
    joined with the group of this larger detection.

    Args:
        footprint: (D, P) bool, pixels of the sphere that each of the D detections covers.
        view: (D,) index of the view of each detection.
        cut: (D,) bool, whether each detection reaches the border of its view.
        visible: (V, P) bool, pixels that each of the V views shows.
        solid_angle_sr: (P,) solid angles of the pixels in steradians.

    Returns:
        One array per object, with the indices of its detections.
    """
    used = footprint.any(0)
    covered, area = footprint[:, used].astype(np.float32), solid_angle_sr[used]
    weighted = (covered * area).astype(np.float32)
    shown = weighted @ visible[view][:, used].T.astype(np.float32)
    common, size = weighted @ covered.T, weighted.sum(1)
    union = shown + shown.T - common
    agreement = common / np.maximum(union, 1e-12)
    agreement[common < MIN_SHARED * np.minimum(size[:, None], size)] = 0
    a, b = np.triu_indices(len(view), 1)
    joinable = agreement[a, b] > AGREEMENT
    a, b = a[joinable], b[joinable]
    group_of = np.arange(len(view))
    for i in np.argsort(-agreement[a, b], kind="stable"):
        group_a, group_b = np.flatnonzero(group_of == group_of[a[i]]), np.flatnonzero(group_of == group_of[b[i]])
        if not np.isin(view[group_a], view[group_b]).any():
            group_of[group_b] = group_of[a[i]]
    share = common / np.maximum(size[:, None], 1e-12)
    for i in np.argsort(size, kind="stable"):
        members = group_of == group_of[i]
        same_view = np.isin(group_of, group_of[np.isin(view, view[members])])
        covers = np.where(~same_view & (size > size[i]), share[i], 0)
        if cut[members].all() and covers.max() > INSIDE:
            group_of[members] = group_of[covers.argmax()]
    return [np.flatnonzero(group_of == name) for name in np.unique(group_of)]


def outline(footprint: np.ndarray, view: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Return the pixels of an object, (P,) bool.

    For each pixel, the views that detect the object and show the pixel are counted. The pixel belongs to the object if
    the detections in more than half of these views cover it.

    Args:
        footprint: (D, P) bool, pixels of the sphere that each of the D detections of the object covers.
        view: (D,) index of the view of each of these detections.
        visible: (V, P) bool, pixels that each of the V views shows.
    """
    return 2 * footprint.sum(0) > visible[view].sum(0)


def merge_views(
    detections: Sequence[ImageDetections],
    names: Sequence[str],
    rig: Rig,
    height: int,
    range_m: np.ndarray | None = None,
) -> Detections:
    """Merge the detections in the views of a panorama, so that each object is reported once.

    Args:
        detections: Detections in each view of the rig.
        names: Names of the classes.
        rig: Directions and intrinsics of the views.
        height: Height of the panorama in pixels.
        range_m: Range image (height, 2 height) in metres; None if no range is known.
    """
    grid = rig.grid(height)
    range_m = None if range_m is None else grid.thin(range_m)
    view = np.repeat(np.arange(len(detections)), [len(view_detections.score) for view_detections in detections])
    label, score = (
        np.concatenate([getattr(view_detections, name) for view_detections in detections])
        for name in ("label", "score")
    )
    cut = rig.cuts(np.concatenate([view_detections.box_px for view_detections in detections]))
    marked = [
        grid.footprint(v, box, mask)
        for v, view_detections in enumerate(detections)
        for box, mask in zip(view_detections.box_px, view_detections.masks(), strict=True)
    ]
    footprint = np.array(marked, bool).reshape(len(view), len(grid.rays))
    # Boxes that are cut by the border of a view and cover fewer than MIN_POINTS pixels are ignored.
    usable = ~cut | (footprint.sum(1) >= MIN_POINTS)
    labels, scores, bearing, solid_angle_sr, masks, points = [], [], [], [], [], []
    for kind in np.unique(label[usable]):
        alike = np.flatnonzero(usable & (label == kind))
        for members in group(footprint[alike], view[alike], cut[alike], grid.visible, grid.solid_angle_sr):
            indices = alike[members]
            labels.append(names[kind])
            scores.append(score[indices].max())
            inside = np.flatnonzero(outline(footprint[indices], view[indices], grid.visible))
            bearing.append(grid.solid_angle_sr[inside] @ grid.rays[inside])
            solid_angle_sr.append(grid.solid_angle_sr[inside].sum())
            masks.append(grid.rays[inside])
            if range_m is not None:
                inside = inside[foreground(range_m[inside], grid.solid_angle_sr[inside])]
                points.append(grid.rays[inside] * range_m[inside, None])
    towards, covered_sr = unit_vectors(np.reshape(bearing, (-1, 3))), np.array(solid_angle_sr, float)
    clouds = None if range_m is None else points
    return detections_where_known(labels, np.array(scores, float), clouds, towards, covered_sr, masks)
