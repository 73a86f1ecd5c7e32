"""Join the pieces of one flat panel, such as a wall display that shows several windows, to one object."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from salframe.graphs.boxes import detections_where_known
from salframe.graphs.detections import Detections, unit_vectors
from salframe.graphs.vocabulary import object_label

PANELS = frozenset({"mirror", "monitor", "picture", "projection screen", "sign", "television", "whiteboard", "window"})
"""Labels of flat objects. A network often gives several of these labels to pieces of one panel."""
MAX_GAP_M = 0.15
"""Maximum distance in metres between the nearest points of two pieces of a panel."""
MAX_THICKNESS_M = 0.08
"""Maximum standard deviation in metres of the points of two pieces along the normal of their common plane."""
MAX_GAP_DEG = 1.5
"""Maximum angle in degrees between the nearest pixels of two pieces without range."""


def join_panels(detections: Detections) -> Detections:
    """Join panels that touch each other and lie on one plane.

    Pieces without range are joined if they touch in the image. A joined object gets the label with the largest sum of
    score times solid angle over its pieces. Its score is the mean score of the pieces with this label, weighted by
    solid angle.

    Args:
        detections: Detections with `rays` and `solid_angle_sr`.

    Returns:
        The detections. A joined object takes the index of its first piece. If nothing is joined, the input is returned.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    panels = [n for n, label in enumerate(detections.labels) if object_label(label) in PANELS]
    pairs = [pair for pair in combinations(panels, 2) if _is_one_panel(detections, *pair)]
    if not pairs:
        return detections
    first, second = np.array(pairs).T
    links = coo_array((np.ones(len(pairs)), (first, second)), shape=(len(detections), len(detections)))
    _, owner = connected_components(links, directed=False)
    _, starts = np.unique(owner, return_index=True)
    groups = [np.flatnonzero(owner == owner[start]) for start in np.sort(starts)]
    labels, scores = zip(*(_label(detections, group) for group in groups), strict=True)
    solid_angle_sr = detections.solid_angle_sr
    towards = np.array([solid_angle_sr[group] @ detections.bearing[group] for group in groups])
    return detections_where_known(
        labels,
        np.array(scores),
        None if detections.points_m is None else [_known_points(detections, group) for group in groups],
        unit_vectors(towards),
        np.array([solid_angle_sr[group].sum() for group in groups]),
        [np.concatenate([detections.rays[n] for n in group]) for group in groups],  # type: ignore[index]
    )


def _is_one_panel(detections: Detections, first: int, second: int) -> bool:
    """Return whether two panels touch each other and lie on one plane."""
    from scipy.spatial import cKDTree

    if np.isfinite(detections.centroid_m[[first, second]]).all():
        points_m = [_known_points(detections, [n]) for n in (first, second)]
        gap_m = np.maximum(points_m[0].min(0) - points_m[1].max(0), points_m[1].min(0) - points_m[0].max(0)).max()
        if gap_m > MAX_GAP_M or cKDTree(points_m[0]).query(points_m[1])[0].min() > MAX_GAP_M:
            return False
        variance = np.linalg.eigvalsh(np.cov(np.concatenate(points_m).T))[0]
        return bool(variance <= MAX_THICKNESS_M**2)
    rays = [detections.rays[n] for n in (first, second)]  # type: ignore[index]
    chord = cKDTree(rays[0]).query(rays[1])[0].min()
    return bool(2 * np.arcsin(min(chord / 2, 1.0)) <= np.radians(MAX_GAP_DEG))


def _known_points(detections: Detections, group: np.ndarray | list[int]) -> np.ndarray:
    """Return the points (n, 3) of a group of objects, without points of unknown position."""
    points_m = np.concatenate([detections.points_m[n] for n in group])  # type: ignore[index]
    return points_m[np.isfinite(points_m).all(1)]


def _label(detections: Detections, group: np.ndarray) -> tuple[str, float]:
    """Return the label and the score of the object that a group of pieces is joined to."""
    weight = detections.solid_angle_sr[group]
    labels = np.array([detections.labels[n] for n in group])
    names, name = np.unique(labels, return_inverse=True)
    best = int(np.bincount(name, weight * detections.scores[group]).argmax())
    members = name == best
    return str(names[best]), float(np.average(detections.scores[group][members], weights=weight[members]))
