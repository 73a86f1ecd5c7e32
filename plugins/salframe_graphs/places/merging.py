"""Merging of the panoramas of a place into one graph in the world, where equal label and position mean one object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import transform_points
from salframe_graphs.places.rates import Rates

MAX_SIGMAS = 3.0
"""Maximum distance of two sightings of one object, in standard deviations of their difference."""
MIN_SALIENCY = 1e-3
"""Lower bound of saliency relative to the panorama's average, which keeps its logarithm finite."""

PlaceOf = Callable[[np.ndarray, ReferenceFrame], Sequence[str | None]]
"""Function that returns the place at each position (N, 2) in the world, on the floor of a frame; None outside all."""


@dataclass(frozen=True, eq=False)
class Place:
    """A place with M objects in the world.

    Attributes:
        name: Name of the place.
        frames: Numbers of the scene frames of the place in the map.
        labels: M labels.
        centroid_m: (M, 3) mean of the sightings in the world, weighted by inverse variance.
        variance_m2: (M,) variance of that mean along each axis.
        log_size: (M, 3) mean logarithms of length, width and height.
        log_saliency: (M,) mean logarithm of saliency relative to the panorama's average.
        sightings: (M,) number of sightings.
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
class Sightings:
    """N sightings of objects in panoramas, in the world or another common frame.

    Attributes:
        frame: (N,) number of the panorama.
        labels: (N,) labels.
        centroid_m: (N, 3) positions in the common frame.
        range_m: (N,) horizontal distances from the camera.
        log_size: (N, 3) logarithms of length, width and height.
        log_saliency: (N,) logarithm of saliency relative to the panorama's average.
    """

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
    """Return the places of the scene frames with their merged objects, in the order of the map.

    An object in a transition frame is added to the place that contains it, if `place_of` is available. A map with only
    transition frames has their places.

    Args:
        graphs: The graph of each frame.
        frames: The reference frames of the map.
        rates: Error rates of the detector.
        place_of: Returns the place at positions; None where the floor areas are unknown.
        merged: Whether to merge the frames of a place. Otherwise each scene frame is a separate place with only its own
            objects.
    """
    frame_sightings = [
        sightings_of(number, graph, frame.T_world_pano)
        for number, (graph, frame) in enumerate(zip(graphs, frames, strict=True))
    ]
    frames_of_place: dict[tuple[str, int], list[int]] = {}
    kinds = {frame.kind for frame in frames}
    for number, frame in enumerate(frames):
        if frame.kind is FrameKind.SCENE or FrameKind.SCENE not in kinds:
            frames_of_place.setdefault((frame.place, 0 if merged else number), []).append(number)
    added: dict[str, list[tuple[int, np.ndarray]]] = {}
    if merged and place_of is not None and FrameKind.SCENE in kinds:
        for number, frame in enumerate(frames):
            if frame.kind is FrameKind.TRANSITION:
                owner = np.array(place_of(frame_sightings[number].centroid_m[:, :2], frame), object)
                for name in {place for place in owner if place is not None}:
                    added.setdefault(name, []).append((number, np.flatnonzero(owner == name)))
    places = []
    for (name, _), scene_frames in frames_of_place.items():
        parts = [(number, np.arange(len(frame_sightings[number].labels))) for number in scene_frames] + added.get(
            name, []
        )
        sightings = concatenate_sightings([_select(frame_sightings[number], rows) for number, rows in parts])
        places.append(merge(name, scene_frames, sightings, rates))
    return places


@dataclass(frozen=True, eq=False)
class MergedSightings:
    """M objects that N sightings were merged to.

    Attributes:
        owner: (N,) number of the object of each sighting.
        labels: M labels.
        centroid_m: (M, 3) mean of the sightings, weighted by inverse variance.
        variance_m2: (M,) variance of that mean along each axis.
        log_size: (M, 3) mean logarithms of length, width and height.
        log_saliency: (M,) mean logarithm of saliency.
        sightings: (M,) number of sightings.
    """

    owner: np.ndarray
    labels: tuple[str, ...]
    centroid_m: np.ndarray
    variance_m2: np.ndarray
    log_size: np.ndarray
    log_saliency: np.ndarray
    sightings: np.ndarray


def merge(name: str, frames: Sequence[int], sightings: Sightings, rates: Rates) -> Place:
    """Merge sightings to the objects of one place, with the variance of a position by `rates`."""
    variance = rates.position_error_m**2 + (rates.range_error_share * sightings.range_m) ** 2
    merged = merge_sightings(sightings, variance)
    return Place(
        name,
        tuple(frames),
        merged.labels,
        merged.centroid_m,
        merged.variance_m2,
        merged.log_size,
        merged.log_saliency,
        merged.sightings,
    )


def merge_sightings(sightings: Sightings, variance_m2: np.ndarray) -> MergedSightings:
    """Merge sightings of one object.

    Sightings are processed in the order of range. Each is merged with the nearest object of the same label that has no
    sighting of the same panorama and lies within MAX_SIGMAS; otherwise it is a new object.

    Args:
        sightings: N sightings.
        variance_m2: (N,) variance of each sighting's position along each axis.
    """
    count = len(sightings.labels)
    owner = np.full(count, -1)
    weight, centre, label = np.zeros(count), np.zeros((count, 3)), np.empty(count, object)
    frames_of_group: list[set[int]] = []
    for row in np.argsort(sightings.range_m, kind="stable"):
        open_groups = [
            g
            for g in range(len(frames_of_group))
            if label[g] == sightings.labels[row] and sightings.frame[row] not in frames_of_group[g]
        ]
        distance = np.hypot(*(centre[open_groups, :2] - sightings.centroid_m[row, :2]).T)
        is_near = distance < MAX_SIGMAS * np.sqrt(1 / weight[open_groups] + variance_m2[row])
        if is_near.any():
            group = int(open_groups[int(np.argmin(np.where(is_near, distance, np.inf)))])
        else:
            group = len(frames_of_group)
            frames_of_group.append(set())
            label[group] = sightings.labels[row]
        owner[row] = group
        frames_of_group[group].add(int(sightings.frame[row]))
        total = weight[group] + 1 / variance_m2[row]
        centre[group] += (sightings.centroid_m[row] - centre[group]) / variance_m2[row] / total
        weight[group] = total
    size = len(frames_of_group)
    num_sightings = np.bincount(owner, minlength=size).astype(np.float64)
    log_size, log_saliency = np.zeros((size, 3)), np.zeros(size)
    np.add.at(log_size, owner, sightings.log_size)
    np.add.at(log_saliency, owner, sightings.log_saliency)
    return MergedSightings(
        owner,
        tuple(label[:size]),
        centre[:size],
        1 / weight[:size],
        log_size / num_sightings[:, None],
        log_saliency / num_sightings,
        num_sightings,
    )


def relative_log_saliency(graph: SaliencyGraph) -> np.ndarray:
    """Return the logarithm (N,) of each node's saliency relative to the panorama's average; 0 where all are equal."""
    return np.log(np.maximum(graph.saliency * len(graph), MIN_SALIENCY))


def sightings_of(number: int, graph: SaliencyGraph, T_common_pano: np.ndarray) -> Sightings:
    """Return the sightings of the graph of a panorama.

    Args:
        number: Number of the panorama.
        graph: The graph.
        T_common_pano: (4, 4) motion from the panorama to the common frame.
    """
    return Sightings(
        np.full(len(graph), number),
        np.array(graph.labels, object),
        transform_points(T_common_pano, graph.centroid_m),
        np.hypot(*graph.centroid_m[:, :2].T),
        np.log(graph.size_m),
        relative_log_saliency(graph),
    )


def _select(sightings: Sightings, rows: np.ndarray) -> Sightings:
    return Sightings(*(getattr(sightings, name)[rows] for name in Sightings.__dataclass_fields__))


def concatenate_sightings(parts: Sequence[Sightings]) -> Sightings:
    """Return the sightings of all parts, at least one."""
    return Sightings(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in Sightings.__dataclass_fields__)
    )
