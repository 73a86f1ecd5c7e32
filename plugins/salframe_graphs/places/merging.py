"""The panoramas of a place as one graph in the world: objects that are the same by label and position are one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import transform_points
from salframe_graphs.places.rates import Rates

MAX_SIGMAS = 3.0
"""Two sightings further apart than so many standard deviations of their difference are of two objects."""
MIN_SALIENCY = 1e-3
"""Least saliency, relative to the panorama's average, that is told from none."""

PlaceOf = Callable[[np.ndarray, ReferenceFrame], Sequence[str | None]]
"""The places of positions (N, 2) in the world that a reference frame sees; None off the floor."""


@dataclass(frozen=True, eq=False)
class Place:
    """A place's objects in the world, M of them.

    frames: positions in the map of the scene frames that show it; labels: M names; centroid_m (M, 3), the mean of the
    sightings weighted by their certainty; variance_m2 (M,), of that mean along each axis; log_size (M, 3), mean
    logarithms of length, width and height; log_saliency (M,), mean logarithm of saliency relative to the average of the
    panorama; sightings (M,) counts.
    """

    name: str
    frames: tuple[int, ...]
    labels: tuple[str, ...]
    centroid_m: np.ndarray
    variance_m2: np.ndarray
    log_size: np.ndarray
    log_saliency: np.ndarray
    sightings: np.ndarray


@dataclass(frozen=True, eq=False)
class MapSightings:
    """Objects as panoramas saw them, in the world; a row a sighting: frame, position in the map; range_m; the rest as
    in Place."""

    frame: np.ndarray
    labels: np.ndarray
    centroid_m: np.ndarray
    range_m: np.ndarray
    log_size: np.ndarray
    log_saliency: np.ndarray


def gather_places(
    graphs: Sequence[SaliencyGraph],
    frames: Sequence[ReferenceFrame],
    rates: Rates,
    place_of: PlaceOf | None = None,
    merged: bool = True,
) -> list[Place]:
    """The places that scene frames show, in the order of the map, their frames' objects merged.

    What a transition frame sees feeds the places that its objects lie in, by place_of; nothing without. A map of
    transition frames alone has their places. With `merged` false each scene frame is a place of its own, which the
    others of its name do not feed.
    """
    sightings = [
        _sightings(number, graph, frame) for number, (graph, frame) in enumerate(zip(graphs, frames, strict=True))
    ]
    shown: dict[tuple[str, int], list[int]] = {}
    kinds = {frame.kind for frame in frames}
    for number, frame in enumerate(frames):
        if frame.kind is FrameKind.SCENE or FrameKind.SCENE not in kinds:
            shown.setdefault((frame.place, 0 if merged else number), []).append(number)
    fed: dict[str, list[tuple[int, np.ndarray]]] = {}
    if merged and place_of is not None and FrameKind.SCENE in kinds:
        for number, frame in enumerate(frames):
            if frame.kind is FrameKind.TRANSITION:
                owner = np.array(place_of(sightings[number].centroid_m[:, :2], frame), object)
                for name in {place for place in owner if place is not None}:
                    fed.setdefault(name, []).append((number, np.flatnonzero(owner == name)))
    places = []
    for (name, _), own in shown.items():
        parts = [(number, np.arange(len(sightings[number].labels))) for number in own] + fed.get(name, [])
        seen = _joined([_taken(sightings[number], rows) for number, rows in parts])
        places.append(merge(name, own, seen, rates))
    return places


def merge(name: str, frames: Sequence[int], seen: MapSightings, rates: Rates) -> Place:
    """A place of sightings (N): nearest first, each joins the nearest object of its label that its own panorama has not
    seen yet and that is near enough by the errors of both; else it is another object."""
    variance = rates.position_error_m**2 + (rates.range_error_share * seen.range_m) ** 2
    count = len(seen.labels)
    owner = np.full(count, -1)
    weight, centre, label = np.zeros(count), np.zeros((count, 3)), np.empty(count, object)
    held: list[set[int]] = []
    for row in np.argsort(seen.range_m, kind="stable"):
        open_ = [g for g in range(len(held)) if label[g] == seen.labels[row] and seen.frame[row] not in held[g]]
        distance = np.hypot(*(centre[open_, :2] - seen.centroid_m[row, :2]).T)
        near = distance < MAX_SIGMAS * np.sqrt(1 / weight[open_] + variance[row])
        if near.any():
            group = int(open_[int(np.argmin(np.where(near, distance, np.inf)))])
        else:
            group = len(held)
            held.append(set())
            label[group] = seen.labels[row]
        owner[row] = group
        held[group].add(int(seen.frame[row]))
        total = weight[group] + 1 / variance[row]
        centre[group] += (seen.centroid_m[row] - centre[group]) / variance[row] / total
        weight[group] = total
    size = len(held)
    sightings = np.bincount(owner, minlength=size).astype(np.float64)
    log_size, log_saliency = np.zeros((size, 3)), np.zeros(size)
    np.add.at(log_size, owner, seen.log_size)
    np.add.at(log_saliency, owner, seen.log_saliency)
    return Place(
        name,
        tuple(frames),
        tuple(label[:size]),
        centre[:size],
        1 / weight[:size],
        log_size / sightings[:, None],
        log_saliency / sightings,
        sightings,
    )


def relative_log_saliency(graph: SaliencyGraph) -> np.ndarray:
    """(N,) logarithm of each node's saliency relative to the average node of its panorama: 0 where all are alike."""
    return np.log(np.maximum(graph.saliency * len(graph), MIN_SALIENCY))


def _sightings(number: int, graph: SaliencyGraph, frame: ReferenceFrame) -> MapSightings:
    return MapSightings(
        np.full(len(graph), number),
        np.array(graph.labels, object),
        transform_points(frame.T_world_pano, graph.centroid_m),
        np.hypot(*graph.centroid_m[:, :2].T),
        np.log(graph.size_m),
        relative_log_saliency(graph),
    )


def _taken(seen: MapSightings, rows: np.ndarray) -> MapSightings:
    return MapSightings(*(getattr(seen, name)[rows] for name in MapSightings.__dataclass_fields__))


def _joined(parts: Sequence[MapSightings]) -> MapSightings:
    return MapSightings(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in MapSightings.__dataclass_fields__)
    )
