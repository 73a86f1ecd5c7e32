"""Objects from class probabilities of views: weighted means in the panorama's pixels, and connected parts of one
class."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.boxes import detections_where_known
from salframe.graphs.detections import Detections
from salframe.graphs.panels import join_panels
from salframe.graphs.pixels import without_strays
from salframe.panoramas.geometry import equirectangular_rays, pixel_solid_angles
from salframe_segments.instances import find_instances
from salframe_segments.view_scores import HEIGHT, Views, average_scores

UNSEEN = 114
"""Grey value of the pixels that a partial panorama does not cover."""
MAX_SCORES = 160
"""Maximum number of rows and of columns of a view's scores that are used. A panorama of 512 x 256 pixels cannot resolve
more."""


@dataclass(frozen=True, eq=False)
class PixelClasses:
    """The most likely class of each pixel of a panorama.

    Attributes:
        names: Class names. An object class has its name in the graph. A structure class has the network's label.
        class_id: Index (H, W) int32 in `names` of the most likely class.
        probability: Probability (H, W) float32 of this class.
        valid: Mask (H, W) bool, False where no view shows the pixel or the panorama is not valid.
    """

    names: tuple[str, ...]
    class_id: np.ndarray
    probability: np.ndarray
    valid: np.ndarray


@dataclass(frozen=True, eq=False)
class Classes:
    """Classes of the graph, and their relation to the network's classes. Classes with the same name are merged.

    Attributes:
        names: Class names; the first name, "", stands for no object.
        index: (C,) int, the index in `names` for each class of the network.
        is_object: (names,) bool, whether each name is an object.
        is_fixed: (names,) bool, whether each name is an object that is part of the building.
    """

    names: tuple[str, ...]
    index: np.ndarray
    is_object: np.ndarray
    is_fixed: np.ndarray

    @classmethod
    def of(cls, labels: Sequence[tuple[str, str | None]], fixed: Collection[str]) -> Classes:
        """Return the classes of a network.

        Args:
            labels: For each class of the network: its label, and its name in the graph. The name is None for structure,
                such as walls and floors, which does not become objects.
            fixed: Names of objects that are part of the building.
        """
        name_by_class = [name or label for label, name in labels]
        names = ("", *dict.fromkeys(name_by_class))
        objects = {name for _, name in labels if name}
        return cls(
            names,
            np.array([names.index(name) for name in name_by_class]),
            np.array([name in objects for name in names]),
            np.array([name in objects and name in fixed for name in names]),
        )

    def join(self, probabilities: np.ndarray) -> np.ndarray:
        """Sum the probabilities (h, w, C) of the classes with the same name: (h, w, names) float32."""
        joined = np.zeros((*probabilities.shape[:2], len(self.names)), np.float32)
        names, first = np.unique(self.index, return_index=True)
        joined[..., names] = probabilities[..., first]
        for other in np.setdiff1d(np.arange(len(self.index)), first):
            joined[..., self.index[other]] += probabilities[..., other]
        return joined

    def join_views(self, views: Iterable[np.ndarray]) -> np.ndarray:
        """Apply `join` to the probabilities (h, w, C) of each view: (V, h, w, names) float32.

        The result has at most MAX_SCORES rows and MAX_SCORES columns.
        """
        return np.stack([self.join(_subsample(probabilities)) for probabilities in views])


def classify(
    rgb: np.ndarray,
    valid: np.ndarray | None,
    views: Views,
    names: tuple[str, ...],
    probabilities: Callable[[np.ndarray], np.ndarray],
) -> PixelClasses:
    """Classify the pixels of a panorama.

    Args:
        rgb: Colour (H, 2H, 3) uint8.
        valid: Pixels (H, 2H) bool that the panorama covers; None: all.
        views: Views of the panorama.
        names: Class names.
        probabilities: Function that returns the probabilities (v, h, w, names) float32 of views (v, height, width, 3)
            uint8 RGB.
    """
    covered, shown = np.ones((HEIGHT, 2 * HEIGHT), bool), np.ones(views.count, bool)
    if valid is not None:
        rgb = np.where(valid[..., None], rgb, np.uint8(UNSEEN))
        covered = _downsample(valid.astype(np.uint8)) > 0
        shown = views.visible_views(covered)
    if not shown.any():
        zeros = np.zeros(covered.shape, np.float32)
        return PixelClasses(names, zeros.astype(np.int32), zeros, zeros > 0)
    mean, weight = average_scores(views, shown, probabilities(views.cut(rgb)[shown]))
    class_id = mean.argmax(-1)
    probability = np.take_along_axis(mean, class_id[..., None], -1)[..., 0]
    return PixelClasses(names, class_id.astype(np.int32), probability, covered & (weight > 0))


def find_objects(
    pixels: PixelClasses,
    classes: Classes,
    range_m: np.ndarray | None,
    score: Callable[[float], float],
    min_score: float,
) -> Detections:
    """Return the objects of a panorama. Pieces of one flat panel are joined to one object.

    Args:
        pixels: Class of each pixel.
        classes: The classes.
        range_m: Range image (H, 2H) in metres; None if no range is known.
        score: Function that returns the score of an object from the mean probability of its class.
        min_score: Minimum score of an object.
    """
    rays = equirectangular_rays(HEIGHT)
    area_sr = np.broadcast_to(pixel_solid_angles(HEIGHT)[:, None], pixels.valid.shape)
    points_m = None
    if range_m is not None:
        points_m = rays * _downsample(range_m)[..., None]
    # Pixels that are not valid get class 0, no object.
    class_id = np.where(pixels.valid, pixels.class_id, 0)
    instances = find_instances(class_id, classes.is_object, classes.is_fixed, points_m, area_sr)
    labels, scores, bearing, solid_angle_sr, masks, clouds = [], [], [], [], [], []
    for pixel_indices in instances:
        weight = area_sr.flat[pixel_indices]
        object_score = score(float(np.average(pixels.probability.flat[pixel_indices], weights=weight)))
        if object_score < min_score:
            continue
        labels.append(pixels.names[int(class_id.flat[pixel_indices[0]])])
        scores.append(object_score)
        towards = weight @ rays.reshape(-1, 3)[pixel_indices]
        bearing.append(towards / np.linalg.norm(towards))
        solid_angle_sr.append(weight.sum())
        masks.append(rays.reshape(-1, 3)[pixel_indices])
        if points_m is not None:
            points = points_m.reshape(-1, 3)[pixel_indices]
            points = points[np.isfinite(points).all(1)]
            clouds.append(without_strays(points) if len(points) else points)
    pieces = detections_where_known(
        labels,
        np.array(scores),
        None if points_m is None else clouds,
        np.array(bearing).reshape(-1, 3),
        np.array(solid_angle_sr),
        masks,
    )
    return join_panels(pieces)


def _subsample(scores: np.ndarray) -> np.ndarray:
    """Subsample scores (h, w, C) to at most MAX_SCORES evenly spaced rows and columns."""
    for axis in (0, 1):
        length = scores.shape[axis]
        if length > MAX_SCORES:
            scores = scores.take(((np.arange(MAX_SCORES) + 0.5) * length / MAX_SCORES).astype(int), axis)
    return scores


def _downsample(image: np.ndarray) -> np.ndarray:
    """Resize an image (H, 2H) of ranges or a mask to HEIGHT rows by nearest-neighbour sampling."""
    import cv2

    return cv2.resize(image, (2 * HEIGHT, HEIGHT), interpolation=cv2.INTER_NEAREST)
