"""Merging of the panoramas of a place into one graph in the world. Objects with the same label and about the same
position become one object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe_graphs.places.rates import Rates
from salframe_graphs.sightings import Sightings, concatenate_sightings, merge_sightings, select_sightings, sightings_of

PlaceOf = Callable[[np.ndarray, ReferenceFrame], Sequence[str | None]]
"""Function that returns the name of the place at each world position (N, 2), on the storey of a frame; None outside all
places."""


@dataclass(frozen=True, eq=False)
class Place:
    """A place with M objects in the world. A sighting is an object of one panorama.

    Attributes:
        name: Name of the place.
        frames: Indices of the reference frames of this place in the map, without frames in doorways.
        labels: M labels.
        centroid_m: (M, 3) mean of the sightings in the world, weighted by inverse variance.
        variance_m2: (M,) variance of the mean position along each axis.
        log_size: (M, 3) mean logarithms of length, width and height.
        log_saliency: (M,) mean of ln(saliency / average saliency of the panorama).
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


def gather_places(
    graphs: Sequence[SaliencyGraph],
    frames: Sequence[ReferenceFrame],
    rates: Rates,
    place_of: PlaceOf | None = None,
    merged: bool = True,
) -> list[Place]:
    """Return the places of the scene frames with their merged objects, in the order of the map.

    Scene frames are in rooms, transition frames in doorways. An object in a transition frame is added to the place that
    contains the object, if `place_of` is not None. In a map without scene frames, the transition frames are treated as
    scene frames.

    Args:
        graphs: The graph of each frame.
        frames: The reference frames of the map.
        rates: Error rates of the detector.
        place_of: Function that returns the places at positions. None if the floor areas are unknown.
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
        sightings = concatenate_sightings([select_sightings(frame_sightings[number], rows) for number, rows in parts])
        places.append(merge(name, scene_frames, sightings, rates))
    return places


def merge(name: str, frames: Sequence[int], sightings: Sightings, rates: Rates) -> Place:
    """Merge sightings into the objects of one place. `rates` gives the variance of each sighting's position."""
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
