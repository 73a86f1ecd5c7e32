"""An RGB-D panorama, any part of which may be missing, and what a labelled data set tells about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError

PARTS = frozenset({"rgb", "range", "annotations"})
"""What a panorama may provide, and a component may need."""
VISIBLE_PIXELS = 50
"""An object that covers fewer pixels of a panorama is not visible."""


@dataclass(frozen=True, eq=False)
class ObjectBoxes:
    """Annotated objects by their upright boxes, in the panorama frame.

    labels: N names; keys: N strings that stay with an object when the panorama is turned (they key noise, nothing
    else); centroid_m, size_m (N, 3) float64, centre and length, width, height; yaw_rad (N,) float64, azimuth of the
    length, modulo pi. A centroid whose range is not known is NaN.
    """

    labels: tuple[str, ...]
    keys: tuple[str, ...]
    centroid_m: np.ndarray
    size_m: np.ndarray
    yaw_rad: np.ndarray

    def __post_init__(self) -> None:
        n = len(self.labels)
        if len(self.keys) != n:
            raise DataError(f"ObjectBoxes.keys holds {len(self.keys)} keys, expected {n}, one an object")
        check_array(self, "centroid_m", np.float64, n, 3)
        check_array(self, "size_m", np.float64, n, 3)
        check_array(self, "yaw_rad", np.float64, n)

    @classmethod
    def empty(cls) -> ObjectBoxes:
        return cls((), (), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))

    def take(self, chosen: np.ndarray) -> ObjectBoxes:
        """Some of the objects, (N,) bool."""
        rows = np.flatnonzero(chosen)
        labels, keys = (tuple(of_all[i] for i in rows) for of_all in (self.labels, self.keys))
        return ObjectBoxes(labels, keys, self.centroid_m[rows], self.size_m[rows], self.yaw_rad[rows])


@dataclass(frozen=True, eq=False)
class Annotations:
    """What a labelled data set tells about a panorama: an instance image with its label table, or a list of objects.

    instance_id (H, 2H) int32, 0 where there is no object; labels: instance id -> label. `objects` instead, where there
    is no image. `rendered`: labels and ranges come from a renderer and hold no error of their own.
    """

    instance_id: np.ndarray | None = None
    labels: Mapping[int, str] = field(default_factory=dict)
    objects: ObjectBoxes | None = None
    rendered: bool = False

    def __post_init__(self) -> None:
        if (self.instance_id is None) == (self.objects is None):
            raise DataError("Annotations take either an instance image or a list of objects, received both or neither")
        if self.instance_id is not None:
            check_array(self, "instance_id", np.int32, None, None)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The labels that are told of, each once, in alphabetical order."""
        return tuple(sorted(set(self.labels.values() if self.objects is None else self.objects.labels)))


@dataclass(frozen=True, eq=False)
class Panorama:
    """An equirectangular RGB-D panorama; any part may be missing, and `provides` says what is there.

    rgb (H, 2H, 3) uint8; range_m (H, 2H) float32, range along the ray, NaN where unknown; valid (H, 2H) bool, the part
    of the sphere that was seen (None: all of it). `id` names the frame it was taken in; `range_by` the range model that
    estimated the range, None where a sensor or a renderer gave it. Raises DataError on images that do not fit together.
    """

    id: str
    rgb: np.ndarray | None = None
    range_m: np.ndarray | None = None
    valid: np.ndarray | None = None
    annotations: Annotations | None = None
    range_by: str | None = None

    def __post_init__(self) -> None:
        if self.range_by is not None and self.range_m is None:
            raise DataError(f"{self.id} has a range by {self.range_by!r} and no range image, expected both or neither")
        height = None
        instance_id = None if self.annotations is None else self.annotations.instance_id
        for name, image in (
            ("rgb", self.rgb),
            ("range", self.range_m),
            ("valid", self.valid),
            ("instance", instance_id),
        ):
            if image is None:
                continue
            shape = np.shape(image)
            if len(shape) < 2 or shape[1] != 2 * shape[0]:
                raise DataError(
                    f"{self.id}: the {name} image is {' x '.join(map(str, shape[1::-1]))}, "
                    "expected a width of twice the height"
                )
            if height is not None and shape[0] != height:
                raise DataError(
                    f"{self.id}: the {name} image is {shape[1]} x {shape[0]}, "
                    f"expected {2 * height} x {height} as the others"
                )
            height = shape[0]
        if self.rgb is not None:
            check_array(self, "rgb", np.uint8, None, None, 3)
        if self.range_m is not None:
            check_array(self, "range_m", np.float32, None, None)
        if self.valid is not None:
            check_array(self, "valid", np.bool_, None, None)

    @property
    def provides(self) -> frozenset[str]:
        """Which of "rgb", "range", "annotations" are there."""
        parts = {"rgb": self.rgb, "range": self.range_m, "annotations": self.annotations}
        return frozenset(name for name, value in parts.items() if value is not None)


def visible_instances(instance_id: np.ndarray) -> tuple[int, ...]:
    """The ids, ascending, of the objects that are visible in an instance image (H, 2H) int32, 0 where there is none."""
    pixels = np.bincount(instance_id.ravel())
    return tuple(int(i) for i in np.flatnonzero(pixels >= VISIBLE_PIXELS) if i)
