"""A map's places laid out for matching, and a query laid out beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from salframe.framework.array_files import ArrayKind
from salframe.framework.columns import Column, Row
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.table import count_having
from salframe_graphs.places.merging import Place
from salframe_graphs.places.rates import Likelihood, Rates

PLACE_COLUMNS = {
    "labels": ArrayKind("U", (None,)),
    "xyz_m": ArrayKind("f", (None, 3)),
    "variance_m2": ArrayKind("f", (None,)),
    "log_size": ArrayKind("f", (None, 3)),
    "found_logit": ArrayKind("f", (None,)),
}
"""What is kept of a place's objects on disk, as in PlaceIndex; xyz_m: in the world, height over the camera."""


@dataclass(frozen=True, eq=False)
class PlaceIndex:
    """K places padded to the largest, m objects; padding bears label -1.

    label (K, m); xy_m (K, m, 2) in the world; z_m (K, m) over the camera; variance_m2, found_logit (K, m), the latter
    of an object 2 m away; log_size (K, m, 3); cameras_m (K, F, 2), where the scene frames stood, the last one
    repeated. Of L labels and, last, of one that the map lacks: frequency (L + 1,), its share among the map's objects;
    rarity (L + 1,), its smooth inverse document frequency over the places. weight (K,): the rarities of each place's
    objects together.
    """

    vocabulary: dict[str, int]
    frequency: np.ndarray
    rarity: np.ndarray
    weight: np.ndarray
    label: np.ndarray
    xy_m: np.ndarray
    z_m: np.ndarray
    variance_m2: np.ndarray
    log_size: np.ndarray
    found_logit: np.ndarray
    cameras_m: np.ndarray

    def __len__(self) -> int:
        return len(self.label)

    @cached_property
    def size(self) -> np.ndarray:
        """(K,) how many objects each place has."""
        return (self.label >= 0).sum(1)

    def take(self, places: np.ndarray) -> PlaceIndex:
        """Those of these places, padded to the largest of them."""
        width = self.size[places].max(initial=0)
        of_objects = ("label", "xy_m", "z_m", "variance_m2", "log_size", "found_logit")
        taken = {name: getattr(self, name)[places, :width] for name in of_objects}
        return replace(self, **taken, weight=self.weight[places], cameras_m=self.cameras_m[places])


@dataclass(frozen=True, eq=False)
class QueryObjects:
    """A query's n objects in its own frame: label (n,), len(vocabulary) where the map lacks it; xy_m (n, 2); z_m, range
    in the plane range_m (n,); ray (n, 2), unit vectors; log_size (n, 3); score (n,), how sure the detector is."""

    label: np.ndarray
    xy_m: np.ndarray
    z_m: np.ndarray
    range_m: np.ndarray
    ray: np.ndarray
    log_size: np.ndarray
    score: np.ndarray

    def __len__(self) -> int:
        return len(self.label)


def index_places(
    places: Sequence[Place], cameras_m: Sequence[np.ndarray], rates: Rates, likelihood: Likelihood
) -> PlaceIndex:
    """Lay out places; cameras_m: for each, where its scene frames stood, (F, 3) in the world."""
    names = sorted({label for place in places for label in place.labels})
    vocabulary = {label: i for i, label in enumerate(names)}
    cameras = np.zeros((len(places), max(map(len, cameras_m), default=0), 2))
    logit, over_camera = [np.zeros(0)], [np.zeros((0, 3))]
    for k, (place, stood) in enumerate(zip(places, cameras_m, strict=True)):
        over_camera.append(place.centroid_m - [0, 0, np.median(stood[:, 2])])
        logit.append(
            rates.found_logit
            + rates.found_per_saliency * place.log_saliency
            + likelihood.found_per_sighting * np.log(place.sightings)
        )
        cameras[k] = stood[np.minimum(np.arange(cameras.shape[1]), len(stood) - 1), :2]
    return _pad(
        names,
        np.array([len(place.labels) for place in places], int),
        np.array([vocabulary[name] for place in places for name in place.labels], int),
        {
            "xyz_m": np.concatenate(over_camera),
            "variance_m2": np.concatenate([np.zeros(0), *(place.variance_m2 for place in places)]),
            "log_size": np.concatenate([np.zeros((0, 3)), *(place.log_size for place in places)]),
            "found_logit": np.concatenate(logit),
        },
        cameras,
    )


def place_rows(index: PlaceIndex) -> Iterator[Row]:
    """The objects of each place, of the columns PLACE_COLUMNS."""
    names = np.array([*index.vocabulary], np.str_)
    for k, count in enumerate((index.label >= 0).sum(1)):
        yield {
            "labels": names[index.label[k, :count]],
            "xyz_m": np.column_stack([index.xy_m[k, :count], index.z_m[k, :count]]),
            **{name: getattr(index, name)[k, :count] for name in ("variance_m2", "log_size", "found_logit")},
        }


def read_places(columns: Mapping[str, Column], cameras_m: np.ndarray) -> PlaceIndex:
    """The places of the columns PLACE_COLUMNS, whose scene frames stood at cameras_m (K, F, 2), the last one
    repeated."""
    labels = columns["labels"]
    values = {
        name: columns[name].values.reshape(-1, *kind.shape[1:])
        for name, kind in PLACE_COLUMNS.items()
        if name != "labels"
    }
    return _pad(labels.words or (), np.diff(labels.start), labels.values, values, cameras_m)


def _pad(
    names: Sequence[str], count: np.ndarray, label: np.ndarray, values: Mapping[str, np.ndarray], cameras_m: np.ndarray
) -> PlaceIndex:
    """Places of count (K,) objects each, one place's after the other's: label (P,), numbers of names in order, and what
    else is known of them."""
    is_object = np.arange(count.max(initial=0)) < count[:, None]

    def padded(ragged: np.ndarray, fill: float) -> np.ndarray:
        laid = np.full((*is_object.shape, *ragged.shape[1:]), fill, ragged.dtype)
        laid[is_object] = ragged
        return laid

    rarity = np.log((1 + len(count)) / (1 + count_having(count, label, len(names) + 1))) + 1
    number = np.bincount(label, minlength=len(names) + 1) + 0.5
    label, xyz_m = padded(label.astype(np.int64), -1), padded(values["xyz_m"], 0)
    return PlaceIndex(
        {name: i for i, name in enumerate(names)},
        number / number.sum(),
        rarity,
        np.where(is_object, rarity[label], 0).sum(1),
        label,
        xyz_m[..., :2],
        xyz_m[..., 2],
        padded(values["variance_m2"], 1),
        padded(values["log_size"], 0),
        padded(values["found_logit"], 0),
        cameras_m,
    )


def lay_out_query(graph: SaliencyGraph, index: PlaceIndex) -> QueryObjects:
    """A query's objects beside a map's."""
    xy = graph.centroid_m[:, :2]
    range_m = np.hypot(*xy.T)
    return QueryObjects(
        np.array([index.vocabulary.get(name, len(index.vocabulary)) for name in graph.labels], int),
        xy,
        graph.centroid_m[:, 2],
        range_m,
        xy / np.maximum(range_m, 1e-9)[:, None],
        np.log(graph.size_m),
        graph.scores,
    )
