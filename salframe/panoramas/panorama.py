"""RGB-D panoramas, any part of which may be missing, and their annotations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError

PARTS = frozenset({"rgb", "range", "annotations"})
"""Parts that a panorama may provide and a component may need."""
VISIBLE_PIXELS = 50
"""Minimum number of pixels of a visible object."""


@dataclass(frozen=True, eq=False)
class ObjectBoxes:
    """Upright boxes of N annotated objects, in the panorama frame.

    Attributes:
        labels: N labels.
        keys: N strings that identify an object when the panorama is rotated. They only key the random noise.
        centroid_m: (N, 3) float64 centres; NaN where the range is unknown.
        size_m: (N, 3) float64 length, width and height.
        yaw_rad: (N,) float64 azimuth of the length, modulo pi.
    """

    labels: tuple[str, ...]
    keys: tuple[str, ...]
    centroid_m: np.ndarray
    size_m: np.ndarray
    yaw_rad: np.ndarray

    def __post_init__(self) -> None:
        n = len(self.labels)
        if len(self.keys) != n:
            raise DataError(f"ObjectBoxes.keys has {len(self.keys)} keys, expected {n}, one for each object")
        check_array(self, "centroid_m", np.float64, n, 3)
        check_array(self, "size_m", np.float64, n, 3)
        check_array(self, "yaw_rad", np.float64, n)

    @classmethod
    def empty(cls) -> ObjectBoxes:
        """Return a list without objects."""
        return cls((), (), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))

    def take(self, mask: np.ndarray) -> ObjectBoxes:
        """Return the objects where a mask (N,) bool is true."""
        rows = np.flatnonzero(mask)
        labels, keys = (tuple(column[i] for i in rows) for column in (self.labels, self.keys))
        return ObjectBoxes(labels, keys, self.centroid_m[rows], self.size_m[rows], self.yaw_rad[rows])


@dataclass(frozen=True, eq=False)
class Annotations:
    """Annotated objects of a panorama: either an instance image with its labels, or a list of objects.

    Attributes:
        instance_id: (H, 2H) int32 instance image, 0 where there is no object; None where there is a list of objects.
        labels: Label of each instance id.
        objects: List of objects; None where there is an instance image.
        rendered: Whether labels and ranges come from a renderer and are free of errors.

    Raises:
        DataError: There are both an instance image and a list of objects, or neither; or the image is no int32 array.
    """

    instance_id: np.ndarray | None = None
    labels: Mapping[int, str] = field(default_factory=dict)
    objects: ObjectBoxes | None = None
    rendered: bool = False

    def __post_init__(self) -> None:
        if (self.instance_id is None) == (self.objects is None):
            received = "both" if self.instance_id is not None else "neither"
            raise DataError(f"Annotations received {received}, expected either an instance image or a list of objects")
        if self.instance_id is not None:
            check_array(self, "instance_id", np.int32, None, None)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Labels of all objects, each once, in alphabetical order."""
        return tuple(sorted(set(self.labels.values() if self.objects is None else self.objects.labels)))


@dataclass(frozen=True, eq=False)
class Panorama:
    """An equirectangular RGB-D panorama. Any part may be missing; `provides` lists the parts.

    Attributes:
        id: Id of the frame.
        rgb: (H, 2H, 3) uint8 colour.
        range_m: (H, 2H) float32 range along the ray in metres, NaN where unknown.
        valid: (H, 2H) bool, the visible part of the sphere; None: all of it.
        annotations: Annotated objects.
        range_by: Name of the range model that estimated the range; None where it comes from a sensor or a renderer.
        notes: What the reader changed in the picture, one line each: reduced, placed as a crop, levelled.

    Raises:
        DataError: An image has another shape or dtype, the images differ in size, or `range_by` is set without range.
    """

    id: str
    rgb: np.ndarray | None = None
    range_m: np.ndarray | None = None
    valid: np.ndarray | None = None
    annotations: Annotations | None = None
    range_by: str | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.range_by is not None and self.range_m is None:
            raise DataError(
                f"{self.id} has range_by {self.range_by!r} and no range image, expected both or neither of them"
            )
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
                    "expected width = 2 x height (equirectangular)"
                )
            if height is not None and shape[0] != height:
                raise DataError(
                    f"{self.id}: the {name} image is {shape[1]} x {shape[0]}, "
                    f"expected {2 * height} x {height} like the other images"
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
        """Parts that the panorama has, of "rgb", "range" and "annotations"."""
        parts = {"rgb": self.rgb, "range": self.range_m, "annotations": self.annotations}
        return frozenset(name for name, value in parts.items() if value is not None)


def visible_instances(instance_id: np.ndarray) -> tuple[int, ...]:
    """Return the ids of the objects that are visible in an instance image, in ascending order.

    Args:
        instance_id: (H, 2H) int32, 0 where there is no object.
    """
    pixels = np.bincount(instance_id.ravel())
    return tuple(int(i) for i in np.flatnonzero(pixels >= VISIBLE_PIXELS) if i)
