"""A map's places laid out for matching, and a query laid out beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe_graphs.places.merging import Place
from salframe_graphs.places.rates import Likelihood, Rates


@dataclass(frozen=True, eq=False)
class PlaceIndex:
    """K places padded to the largest, m objects; padding bears label -1.

    label (K, m); xy_m (K, m, 2) in the world; z_m (K, m) over the camera; variance_m2, found_logit (K, m), the latter
    of an object 2 m away; log_size (K, m, 3); cameras_m (K, F, 2), where the scene frames stood, the first one
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

    def take(self, places: np.ndarray) -> PlaceIndex:
        """Those of these places, padded to the largest of them."""
        width = (self.label[places] >= 0).sum(1).max(initial=0)
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
    shape = (len(places), max((len(place.labels) for place in places), default=0))
    label = np.full(shape, -1)
    xyz, log_size = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    variance, logit = np.ones(shape), np.zeros(shape)
    cameras = np.zeros((len(places), max(map(len, cameras_m), default=0), 2))
    for k, (place, stood) in enumerate(zip(places, cameras_m, strict=True)):
        count = len(place.labels)
        label[k, :count] = [vocabulary[name] for name in place.labels]
        xyz[k, :count] = place.centroid_m - [0, 0, np.median(stood[:, 2])]
        variance[k, :count], log_size[k, :count] = place.variance_m2, place.log_size
        logit[k, :count] = (
            rates.found_logit
            + rates.found_per_saliency * place.log_saliency
            + likelihood.found_per_sighting * np.log(place.sightings)
        )
        cameras[k] = stood[np.minimum(np.arange(cameras.shape[1]), len(stood) - 1), :2]
    owner, count = np.nonzero(label >= 0)[0], len(vocabulary) + 1
    having = np.bincount(np.unique(owner * count + label[label >= 0]) % count, minlength=count)
    rarity = np.log((1 + len(places)) / (1 + having)) + 1
    number = np.bincount(label[label >= 0], minlength=count) + 0.5
    weight = np.where(label >= 0, rarity[label], 0).sum(1)
    return PlaceIndex(
        vocabulary,
        number / number.sum(),
        rarity,
        weight,
        label,
        xyz[..., :2],
        xyz[..., 2],
        variance,
        log_size,
        logit,
        cameras,
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
