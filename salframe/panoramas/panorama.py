"""RGB-D panoramas, any part of which may be missing, and their annotations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from salframe.framework.arrays import as_array, check_array, check_mask
from salframe.framework.errors import DataError
from salframe.panoramas.range_encoding import RangeEncoding

UNNAMED_ID = "the panorama"
"""Id of a panorama that was passed as arrays or uploaded, without an id."""
PARTS = frozenset({"rgb", "range", "annotations"})
"""Parts that a panorama may provide and a component may need."""
VISIBLE_PIXELS = 50
"""Minimum number of pixels of a visible object."""
MAX_INSTANCE_ID = 65535
"""Maximum instance id: the maximum of a 16-bit image."""


def clean_range(range_m: Any, where: str) -> np.ndarray:
    """Return a range or depth image as float32 metres of the same shape. Values that are not positive and finite become
    NaN.

    Args:
        range_m: Floating-point array of any shape, in metres.
        where: Name of the array in errors.

    Raises:
        DataError: The array has integers or no numbers.
    """
    image = as_array(range_m, where)
    if image.dtype.kind != "f":
        raise DataError(
            f"{where} has dtype {image.dtype}, expected floating-point metres, NaN where unknown: "
            "multiply by the unit in metres, such as 0.001 for millimetres"
        )
    with np.errstate(over="ignore"):
        image = image.astype(np.float32, copy=False)
    is_known = np.isfinite(image) & (image > 0)
    is_clean = (is_known | np.isnan(image)).all()
    return image if is_clean else np.where(is_known, image, np.float32(np.nan))


def labels_by_id(labels: Any, where: str) -> dict[int, str]:
    """Return the label of each instance id. Ids as text, such as those of JSON, become integers.

    Args:
        labels: Mapping from ids to labels.
        where: Name of the mapping in errors.

    Raises:
        DataError: `labels` is not a mapping, an id is not a whole number from 0 to MAX_INSTANCE_ID, two ids
            are equal, or a label is not text.
    """
    expected = 'expected the label of each instance id, such as {7: "chair"}'
    if not isinstance(labels, Mapping):
        raise DataError(f"{where} has the type {type(labels).__name__}, {expected}")
    converted: dict[int, str] = {}
    for key, label in labels.items():
        text = str(key)
        is_id = isinstance(key, int | np.integer | str) and not isinstance(key, bool)
        if not (is_id and text.isascii() and text.isdecimal() and int(text[:6]) <= MAX_INSTANCE_ID and len(text) <= 6):
            raise DataError(f"{where} has the instance id {key!r}, expected a whole number from 0 to {MAX_INSTANCE_ID}")
        if not isinstance(label, str):
            raise DataError(f"{where} has the label {label!r} of the instance id {key}, expected text, such as 'chair'")
        if int(text) in converted:
            raise DataError(f"{where} has the instance id {int(text)} twice, expected one label for each id")
        converted[int(text)] = label
    return converted


TEXT_PREFIX = "text: "
"""Start of the label of an annotated object that shows a text. The label "text: 3.14" is a sign with text "3.14"."""


def split_text(label: str) -> tuple[str, str]:
    """Return the name and the text of an annotated label: ("text", "3.14") for "text: 3.14", ("chair", "") for
    "chair"."""
    return ("text", label.removeprefix(TEXT_PREFIX)) if label.startswith(TEXT_PREFIX) else (label, "")


@dataclass(frozen=True, eq=False)
class ObjectBoxes:
    """Upright boxes of N annotated objects, in the panorama frame.

    Attributes:
        labels: N labels.
        keys: N strings, one for each object, that do not change if the panorama is rotated. They are only used as
            random seeds of the simulated detection errors of the objects.
        centroid_m: (N, 3) float64 centres; NaN where the range is unknown.
        size_m: (N, 3) float64 length, width and height.
        yaw_rad: (N,) float64 azimuth of the axis along which the length is measured, modulo pi.
        ranged: Whether detectors may use the ranges. If false, they use directions and solid angles only.
    """

    labels: tuple[str, ...]
    keys: tuple[str, ...]
    centroid_m: np.ndarray
    size_m: np.ndarray
    yaw_rad: np.ndarray
    ranged: bool = True

    def __post_init__(self) -> None:
        n = len(self.labels)
        if len(self.keys) != n:
            raise DataError(f"the field ObjectBoxes.keys has {len(self.keys)} keys, expected {n}, one for each object")
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
        return ObjectBoxes(labels, keys, self.centroid_m[rows], self.size_m[rows], self.yaw_rad[rows], self.ranged)


@dataclass(frozen=True, eq=False)
class Annotations:
    """Annotated objects of a panorama: either an instance image with its labels, or a list of objects.

    Attributes:
        instance_id: (H, 2H) int32 instance image, 0 where there is no object, at most MAX_INSTANCE_ID; other integers
            are converted. None if there is a list of objects.
        labels: Label of each instance id. Ids as text, such as "7", are converted. The label of an object with a text
            on it, such as a sign, is "text: " and the text.
        objects: List of objects; None if there is an instance image.
        rendered: Whether labels and ranges come from a renderer and are free of errors.
        error_id: Seeds the simulated errors of objects. Panoramas with the same `error_id` have the same errors of the
            same objects, like consecutive views with a real detector. "": the id of the panorama.

    Raises:
        DataError: There are both an instance image and a list of objects, or neither; the image has no integers, or
            integers out of range; or the labels are no mapping from ids to text.
    """

    instance_id: np.ndarray | None = None
    labels: Mapping[int, str] = field(default_factory=dict)
    objects: ObjectBoxes | None = None
    rendered: bool = False
    error_id: str = ""

    def __post_init__(self) -> None:
        if (self.instance_id is None) == (self.objects is None):
            received = "both `instance_id` and" if self.instance_id is not None else "neither `instance_id` nor"
            raise DataError(f"Annotations received {received} `objects`, expected exactly one of these arguments")
        if self.instance_id is not None:
            ids = check_array(self, "instance_id", np.int32, None, None)
            if ids.min(initial=0) < 0 or ids.max(initial=0) > MAX_INSTANCE_ID:
                raise DataError(
                    f"the field Annotations.instance_id has ids from {ids.min()} to {ids.max()}, expected 0 to "
                    f"{MAX_INSTANCE_ID}"
                )
        elif not isinstance(self.objects, ObjectBoxes):
            raise DataError(
                f"the field Annotations.objects has the type {type(self.objects).__name__}, expected ObjectBoxes"
            )
        object.__setattr__(self, "labels", labels_by_id(self.labels, "Annotations.labels"))

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Labels of all objects without their texts, each once, in alphabetical order."""
        labels = self.labels.values() if self.objects is None else self.objects.labels
        return tuple(sorted({split_text(label)[0] for label in labels}))


@dataclass(frozen=True, eq=False)
class Panorama:
    """An equirectangular RGB-D panorama. Any part may be missing; `provides` lists the parts.

    Attributes:
        id: Id of the frame.
        rgb: (H, 2H, 3) uint8 colour, red first. Blue first, the order of OpenCV, cannot be detected.
        range_m: (H, 2H) float32 range along the ray in metres, NaN where unknown. float16 and float64 are converted;
            infinite, zero and negative ranges become NaN.
        valid: (H, 2H) bool, the visible part of the sphere; None: all of it. Integers are true where they are not 0.
        annotations: Annotated objects.
        range_by: Name of the range model that estimated the range; None if it comes from a sensor or a renderer.
        range_encoding: Encoding of the panorama file that the range was read from; None if there is no such file.
        up: (3,) float64 direction of up in the panorama frame as an IMU measures it, of any length; None: not measured.
        notes: Changes that the file reader made, one line each: a reduced size, the placement of a crop, levelling.

    Raises:
        DataError: An image has another shape or dtype, the images differ in size, `range_by` is set
            without range, or `up` is no direction.
    """

    id: str
    rgb: np.ndarray | None = None
    range_m: np.ndarray | None = None
    valid: np.ndarray | None = None
    annotations: Annotations | None = None
    range_by: str | None = None
    range_encoding: RangeEncoding | None = None
    up: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.range_by is not None and self.range_m is None:
            raise DataError(
                f"the panorama {self.id} has range_by = {self.range_by!r} (the model that estimated its range) but no "
                "range image: pass range_m, or set range_by to None"
            )
        if self.annotations is not None and not isinstance(self.annotations, Annotations):
            received = type(self.annotations).__name__
            raise DataError(
                f"{self.id}: the field annotations has the type {received}, expected Annotations(instance_id, labels)"
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
            shape = as_array(image, f"{self.id}: the {name} image").shape
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
            if (received := as_array(self.rgb, f"{self.id}: the rgb image").dtype) != np.uint8:
                raise DataError(
                    f"{self.id}: the rgb image has dtype {received}, expected uint8 from 0 to 255: "
                    "scale other values, such as 0 to 1, and convert with .astype(numpy.uint8)"
                )
            check_array(self, "rgb", np.uint8, None, None, 3)
        if self.range_m is not None:
            object.__setattr__(self, "range_m", clean_range(self.range_m, f"{self.id}: range_m"))
            check_array(self, "range_m", np.float32, None, None)
        if self.valid is not None:
            check_mask(self, "valid")
        if self.up is not None:
            length = float(np.linalg.norm(check_array(self, "up", np.float64, 3)))
            if not (np.isfinite(length) and length > 0):
                raise DataError(
                    f"{self.id}: the vector up is {self.up.tolist()}, expected a vector with a finite length above 0"
                )

    @property
    def display_name(self) -> str:
        """Name of the panorama in messages: "panorama" and the id, or "the panorama" without an id."""
        return self.id if self.id == UNNAMED_ID else f"panorama {self.id}"

    @property
    def error_id(self) -> str:
        """Id that seeds the simulated errors of objects: `error_id` of the annotations, or else the panorama's id."""
        return self.id if self.annotations is None else self.annotations.error_id or self.id

    @property
    def provides(self) -> frozenset[str]:
        """Parts that the panorama has, a subset of {"rgb", "range", "annotations"}."""
        parts = {"rgb": self.rgb, "range": self.range_m, "annotations": self.annotations}
        return frozenset(name for name, value in parts.items() if value is not None)


def visible_instances(instance_id: np.ndarray) -> tuple[int, ...]:
    """Return the ids of the objects that are visible in an instance image, in ascending order.

    Args:
        instance_id: (H, 2H) int32, 0 where there is no object.
    """
    pixels = np.bincount(instance_id.ravel())
    return tuple(int(i) for i in np.flatnonzero(pixels >= VISIBLE_PIXELS) if i)


def unlabelled_note(panorama: Panorama) -> str | None:
    """Return a one-line warning if visible objects of the instance image have no label; None if all have one."""
    annotations = panorama.annotations
    if annotations is None or annotations.instance_id is None:
        return None
    visible = visible_instances(annotations.instance_id)
    unlabelled = [str(id) for id in visible if id not in annotations.labels]
    if not unlabelled:
        return None
    ids = ", ".join(unlabelled[:5]) + (", ..." if len(unlabelled) > 5 else "")
    return (
        f"{panorama.id}: {len(unlabelled)} of {len(visible)} objects of the instance image are ignored, because their "
        f"ids have no label: {ids}"
    )
