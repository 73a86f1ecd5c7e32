"""The places of a map in a flat layout for matching."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from salframe.framework.files.array_files import ArrayKind
from salframe.framework.files.columns import PackedColumn, Row
from salframe.graphs.segments import Segments, ranges
from salframe.graphs.table import count_graphs_by_label
from salframe.panoramas.geometry import as_complex
from salframe_graphs.places.merging import Place
from salframe_graphs.places.rates import Likelihood, Rates

PLACE_COLUMNS = {
    "labels": ArrayKind("U", (None,)),
    "xyz_m": ArrayKind("f", (None, 3)),
    "variance_m2": ArrayKind("f", (None,)),
    "log_size": ArrayKind("f", (None, 3)),
    "detection_logit": ArrayKind("f", (None,)),
}
"""Columns of a place's objects on disk, as in PlaceIndex. `xyz_m` has x and y in the world, and the height above the
camera."""


@dataclass(frozen=True, eq=False)
class PlaceIndex:
    """The M objects of K places, one place after the other.

    Attributes:
        vocabulary: Mapping from each of L labels to its index.
        frequency: (L + 1,) fraction of the map's objects that have each label. The last value is for labels that are
            not in the map.
        rarity: (L + 1,) smooth inverse document frequency over the places.
        count: (K,) number of objects of each place.
        label: (M,) index of each object's label.
        xy_m: (M, 2) positions in the world.
        z_m: (M,) heights above the camera.
        variance_m2: (M,) variance of the position along each axis.
        log_size: (M, 3) logarithms of length, width and height.
        detection_logit: (M,) logit of the probability of detection from a distance of 2 m.
        cameras_m: (K, F, 2) positions of the scene frames. A place with fewer than F frames repeats its last one.
        camera_height_m: (K,) height above the floor of the camera that `z_m` refers to; NaN where it is unknown.
        has_boxes: (K,) bool, whether `log_size` holds the sides of boxes. Otherwise the objects were triangulated, and
            `log_size` holds the sides of cubes with the same projected area.
    """

    vocabulary: dict[str, int]
    frequency: np.ndarray
    rarity: np.ndarray
    count: np.ndarray
    label: np.ndarray
    xy_m: np.ndarray
    z_m: np.ndarray
    variance_m2: np.ndarray
    log_size: np.ndarray
    detection_logit: np.ndarray
    cameras_m: np.ndarray
    camera_height_m: np.ndarray
    has_boxes: np.ndarray

    def __len__(self) -> int:
        return len(self.count)

    @cached_property
    def segments(self) -> Segments:
        """The objects grouped by place."""
        return Segments(self.count)

    @cached_property
    def place(self) -> np.ndarray:
        """(M,) int64 index of the place of each object."""
        return self.segments.spread(np.arange(len(self)))

    @cached_property
    def position(self) -> np.ndarray:
        """(M,) complex128 positions x + iy of the objects."""
        return as_complex(self.xy_m)

    @cached_property
    def weight(self) -> np.ndarray:
        """(K,) float64 sum of the rarities of each place's objects."""
        return self.segments.sum(self.rarity[self.label])

    def camera_height_offset_m(self, camera_height_m: float) -> np.ndarray:
        """Return the camera height of each place minus `camera_height_m`, (K,) in metres.

        Both are heights above the floor. The difference is 0 if one of them is unknown (NaN).
        """
        return np.nan_to_num(self.camera_height_m - camera_height_m)

    def height_and_size_terms(self, camera_height_m: float) -> np.ndarray:
        """Return 8 values of each object, (8, M) float64, that the likelihood of objects with range is computed from.

        The first six rows are z, log length and log height of the box, and the squares of these three. The seventh row
        is the constant 1. The eighth row is 1 if the box is known, else 0. The sizes of unknown boxes are 0.

        z is relative to a camera at `camera_height_m` above the floor. If this height or the camera height of a place
        is unknown (NaN), the two heights are assumed to be equal.
        """
        height_m = self.z_m + self.segments.spread(self.camera_height_offset_m(camera_height_m))
        has_box = self.segments.spread(self.has_boxes).astype(np.float64)
        values = np.stack([height_m, self.log_size[:, 0] * has_box, self.log_size[:, 2] * has_box])
        return np.concatenate([values, values**2, np.ones((1, values.shape[1])), has_box[None]])

    def take(self, places: np.ndarray) -> PlaceIndex:
        """Return the index of a subset of places (C,), ascending, with the same vocabulary and frequencies."""
        if len(places) == len(self):
            return self
        objects = ranges(self.segments.start[places], self.count[places])
        of_objects = ("label", "xy_m", "z_m", "variance_m2", "log_size", "detection_logit")
        columns = {name: getattr(self, name)[objects] for name in of_objects}
        of_places = {
            name: getattr(self, name)[places] for name in ("count", "cameras_m", "camera_height_m", "has_boxes")
        }
        return replace(self, **of_places, **columns)


def index_places(
    places: Sequence[Place],
    cameras_m: Sequence[np.ndarray],
    rates: Rates,
    likelihood: Likelihood,
    camera_height_m: np.ndarray | None = None,
    has_boxes: np.ndarray | None = None,
) -> PlaceIndex:
    """Return the index of places.

    Args:
        places: The places.
        cameras_m: For each place the positions (F, 3) of its scene frames in the world.
        rates: Error rates of the detector.
        likelihood: Constants of the likelihood.
        camera_height_m: (K,) as in PlaceIndex; None: unknown.
        has_boxes: (K,) as in PlaceIndex; None: true for all places.
    """
    names = sorted({label for place in places for label in place.labels})
    number = {label: i for i, label in enumerate(names)}
    cameras = np.zeros((len(places), max(map(len, cameras_m), default=0), 2))
    logit, xyz_m = [np.zeros(0)], [np.zeros((0, 3))]
    for k, (place, positions_m) in enumerate(zip(places, cameras_m, strict=True)):
        xyz_m.append(place.centroid_m - [0, 0, np.median(positions_m[:, 2])])
        logit.append(
            rates.detection_logit
            + rates.detection_per_saliency * place.log_saliency
            + likelihood.detection_per_sighting * np.log(place.sightings)
        )
        cameras[k] = positions_m[np.minimum(np.arange(cameras.shape[1]), len(positions_m) - 1), :2]
    return _index(
        names,
        np.array([len(place.labels) for place in places], int),
        np.array([number[name] for place in places for name in place.labels], int),
        {
            "xyz_m": np.concatenate(xyz_m),
            "variance_m2": np.concatenate([np.zeros(0), *(place.variance_m2 for place in places)]),
            "log_size": np.concatenate([np.zeros((0, 3)), *(place.log_size for place in places)]),
            "detection_logit": np.concatenate(logit),
        },
        cameras,
        np.full(len(places), np.nan) if camera_height_m is None else camera_height_m,
        np.ones(len(places), bool) if has_boxes is None else has_boxes,
    )


def place_rows(index: PlaceIndex) -> Iterator[Row]:
    """Yield the objects of each place as a row of PLACE_COLUMNS."""
    names = np.array([*index.vocabulary], np.str_)
    xyz_m = np.column_stack([index.xy_m, index.z_m])
    for low, high in pairwise(index.segments.start.tolist()):
        objects = slice(low, high)
        yield {
            "labels": names[index.label[objects]],
            "xyz_m": xyz_m[objects],
            **{name: getattr(index, name)[objects] for name in ("variance_m2", "log_size", "detection_logit")},
        }


def read_places(
    columns: Mapping[str, PackedColumn], cameras_m: np.ndarray, camera_height_m: np.ndarray, has_boxes: np.ndarray
) -> PlaceIndex:
    """Return the index of places from the columns PLACE_COLUMNS; the other arguments are as in PlaceIndex."""
    labels = columns["labels"]
    values = {
        name: columns[name].values.reshape(-1, *kind.shape[1:])
        for name, kind in PLACE_COLUMNS.items()
        if name != "labels"
    }
    return _index(
        labels.words or (), np.diff(labels.start), labels.values, values, cameras_m, camera_height_m, has_boxes
    )


def _index(
    names: Sequence[str],
    count: np.ndarray,
    label: np.ndarray,
    values: Mapping[str, np.ndarray],
    cameras_m: np.ndarray,
    camera_height_m: np.ndarray,
    has_boxes: np.ndarray,
) -> PlaceIndex:
    """Return the index of places with `count` (K,) objects. `label` (M,) contains indices into `names`."""
    number = np.bincount(label, minlength=len(names) + 1) + 0.5
    return PlaceIndex(
        {name: i for i, name in enumerate(names)},
        number / number.sum(),
        np.log((1 + len(count)) / (1 + count_graphs_by_label(count, label, len(names) + 1))) + 1,
        count,
        label.astype(np.int64),
        values["xyz_m"][:, :2],
        values["xyz_m"][:, 2],
        values["variance_m2"],
        values["log_size"],
        values["detection_logit"],
        cameras_m,
        camera_height_m,
        has_boxes,
    )
