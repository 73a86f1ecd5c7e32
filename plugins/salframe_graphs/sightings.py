"""Sightings of objects in panoramas with known poses. Sightings with the same label and about the same position are
merged into one object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.geometry import transform_points

MAX_SIGMAS = 3.0
"""Maximum distance between two sightings of one object, in standard deviations of the distance."""
MIN_SALIENCY = 1e-3
"""Lower bound of saliency relative to the panorama's average, which keeps its logarithm finite."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """N sightings of objects in panoramas, in the world or another common frame.

    Attributes:
        frame: (N,) number of the panorama.
        labels: (N,) labels.
        centroid_m: (N, 3) positions in the common frame.
        range_m: (N,) horizontal distances from the camera.
        log_size: (N, 3) logarithms of length, width and height.
        log_saliency: (N,) ln(saliency / average saliency of the panorama).
        common_m2: (N,) variance of the part of the position error that all sightings of an object have in common,
            because they were triangulated together; 0 where positions were measured.
    """

    frame: np.ndarray
    labels: np.ndarray
    centroid_m: np.ndarray
    range_m: np.ndarray
    log_size: np.ndarray
    log_saliency: np.ndarray
    common_m2: np.ndarray


@dataclass(frozen=True, eq=False)
class MergedSightings:
    """M objects that N sightings were merged into.

    Attributes:
        owner: (N,) index of the object of each sighting.
        labels: M labels.
        centroid_m: (M, 3) mean of the sightings, weighted by inverse variance.
        variance_m2: (M,) variance of the mean position along each axis.
        log_size: (M, 3) mean logarithms of length, width and height.
        log_saliency: (M,) mean of the sightings' `log_saliency`.
        sightings: (M,) number of sightings.
    """

    owner: np.ndarray
    labels: tuple[str, ...]
    centroid_m: np.ndarray
    variance_m2: np.ndarray
    log_size: np.ndarray
    log_saliency: np.ndarray
    sightings: np.ndarray


def merge_sightings(sightings: Sightings, variance_m2: np.ndarray) -> MergedSightings:
    """Merge the sightings that show the same object.

    Sightings are processed in ascending order of range. A sighting is merged with the nearest object that has the same
    label, lies within MAX_SIGMAS, and has no sighting of the same panorama. If there is no such object, the sighting
    becomes a new object.

    Args:
        sightings: N sightings.
        variance_m2: (N,) variance of each sighting's position along each axis, without `sightings.common_m2`.
    """
    count = len(sightings.labels)
    owner = np.full(count, -1)
    weight, centre = np.zeros(count), np.zeros((count, 3))
    labels: list[str] = []
    frames_of_group: list[set[int]] = []
    groups_of_label: dict[str, list[int]] = {}
    names, frames = sightings.labels.tolist(), sightings.frame.tolist()
    for row in np.argsort(sightings.range_m, kind="stable").tolist():
        same_label = groups_of_label.setdefault(names[row], [])
        open_groups = [g for g in same_label if frames[row] not in frames_of_group[g]]
        group = -1
        if open_groups:
            distance = np.hypot(*(centre[open_groups, :2] - sightings.centroid_m[row, :2]).T)
            is_near = distance < MAX_SIGMAS * np.sqrt(1 / weight[open_groups] + variance_m2[row])
            if is_near.any():
                group = open_groups[int(np.argmin(np.where(is_near, distance, np.inf)))]
        if group < 0:
            group = len(labels)
            labels.append(names[row])
            frames_of_group.append(set())
            same_label.append(group)
        owner[row] = group
        frames_of_group[group].add(frames[row])
        total = weight[group] + 1 / variance_m2[row]
        centre[group] += (sightings.centroid_m[row] - centre[group]) / variance_m2[row] / total
        weight[group] = total
    size = len(labels)
    num_sightings = np.bincount(owner, minlength=size).astype(np.float64)
    log_size, log_saliency, common_m2 = np.zeros((size, 3)), np.zeros(size), np.zeros(size)
    np.add.at(log_size, owner, sightings.log_size)
    np.add.at(log_saliency, owner, sightings.log_saliency)
    np.add.at(common_m2, owner, sightings.common_m2)
    return MergedSightings(
        owner,
        tuple(labels),
        centre[:size],
        1 / weight[:size] + common_m2 / num_sightings,
        log_size / num_sightings[:, None],
        log_saliency / num_sightings,
        num_sightings,
    )


def relative_log_saliency(graph: SaliencyGraph) -> np.ndarray:
    """Return ln(saliency / average saliency of the panorama) of each node, (N,)."""
    return np.log(np.maximum(graph.saliency * len(graph), MIN_SALIENCY))


def sightings_of(number: int, graph: SaliencyGraph, T_common_pano: np.ndarray) -> Sightings:
    """Return the sightings of the graph of a panorama.

    Args:
        number: Number of the panorama.
        graph: The graph.
        T_common_pano: (4, 4) transform from the panorama frame to the common frame.
    """
    return Sightings(
        np.full(len(graph), number),
        np.array(graph.labels, object),
        transform_points(T_common_pano, graph.centroid_m),
        np.hypot(*graph.centroid_m[:, :2].T),
        np.log(graph.size_m),
        relative_log_saliency(graph),
        graph.variance_m2,
    )


def select_sightings(sightings: Sightings, rows: np.ndarray) -> Sightings:
    return Sightings(*(getattr(sightings, name)[rows] for name in Sightings.__dataclass_fields__))


def concatenate_sightings(parts: Sequence[Sightings]) -> Sightings:
    """Concatenate the sightings of all parts. At least one part is needed."""
    return Sightings(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in Sightings.__dataclass_fields__)
    )
