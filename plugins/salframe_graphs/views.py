"""Functions that join several views of a query: their objects, outlines and sectors, in the frame of the last view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from salframe.framework.validation import Settings
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.geometry import pose_yaw, wrap_angle
from salframe.panoramas.view import OdometryNoise, motion_variance_m2
from salframe_graphs.sectors import BINS, MIDDLES_RAD, Sectors, azimuth_bins
from salframe_graphs.sightings import concatenate_sightings, merge_sightings, sightings_of


class ViewObjects(Settings):
    """Position errors of an object in one of several views of a query, along each axis."""

    position_error_m: float = Field(
        0.15,
        gt=0,
        description="standard deviation (m) of the position error of an object along each axis, at a range of 0. "
        "Objects in several views of a query are merged if their positions agree within the errors",
    )
    range_error_share: float = Field(
        0.05,
        ge=0,
        description="additional standard deviation of the position error of an object along each axis, divided by the "
        "range of the object",
    )


def join_objects(
    graphs: Sequence[SaliencyGraph], T_last_view: np.ndarray, odometry: OdometryNoise, errors: ViewObjects
) -> Detections:
    """Return the objects of several views in the frame of the last view. Sightings of the same object are merged.

    An object has the highest score of its sightings and the yaw of its nearest sighting. Its text is the text of the
    nearest sighting that has a text.

    Args:
        graphs: The graphs of V views, with positions.
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
        odometry: Expected errors of the motions.
        errors: Expected position errors of the objects in a view.
    """
    parts, variances = [], []
    for number, (graph, T) in enumerate(zip(graphs, T_last_view, strict=True)):
        sightings = sightings_of(number, graph, T)
        parts.append(sightings)
        drift_m2 = motion_variance_m2(T_last_view, odometry, sightings.range_m, number)
        ranged_m = errors.range_error_share * sightings.range_m
        variances.append(errors.position_error_m**2 + ranged_m**2 + drift_m2)
    sightings = concatenate_sightings(parts)
    merged = merge_sightings(sightings, np.concatenate(variances))
    count = len(merged.labels)
    scores, yaw_rad = np.zeros(count), np.zeros(count)
    np.maximum.at(scores, merged.owner, np.concatenate([graph.scores for graph in graphs]))
    yaws = np.concatenate([graph.yaw_rad + pose_yaw(T) for graph, T in zip(graphs, T_last_view, strict=True)])
    far_to_near = np.argsort(-sightings.range_m, kind="stable")
    yaw_rad[merged.owner[far_to_near]] = yaws[far_to_near] % np.pi  # the last assignment wins: the nearest sighting
    texts = np.full(count, "", object)
    of_sightings = np.array([text for graph in graphs for text in graph.texts], object)
    readable = far_to_near[of_sightings[far_to_near] != ""]
    texts[merged.owner[readable]] = of_sightings[readable]  # the text of the nearest sighting that has one
    return Detections(
        merged.labels, scores, merged.centroid_m, np.exp(merged.log_size), yaw_rad, texts=tuple(texts.tolist())
    )


def join_bearings(graphs: Sequence[SaliencyGraph], T_last_view: np.ndarray) -> SaliencyGraph:
    """Return the nodes without range of views as one graph in the frame of the last view.

    Sightings of one object in several views remain separate nodes. The origin of a node is the position of the camera
    of its view.

    Args:
        graphs: The graphs of V views.
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
    """
    labels: list[str] = []
    texts: list[str] = []
    scores, saliency, bearing, solid_angle_sr, origin_m = [], [], [], [], []
    for graph, T in zip(graphs, T_last_view, strict=True):
        rows = np.flatnonzero(np.isnan(graph.centroid_m).any(1))
        labels += [graph.labels[row] for row in rows]
        texts += [graph.texts[row] for row in rows]
        scores.append(graph.scores[rows])
        saliency.append(graph.saliency[rows])
        bearing.append(graph.bearing[rows] @ T[:3, :3].T)
        solid_angle_sr.append(graph.solid_angle_sr[rows])
        origin_m.append(np.tile(T[:3, 3], (len(rows), 1)))
    unknown = np.full((len(labels), 3), np.nan)
    shares = np.concatenate(saliency)
    return SaliencyGraph(
        tuple(labels),
        np.concatenate(scores),
        shares / max(shares.sum(), 1e-9),
        unknown,
        unknown,
        unknown[:, 0],
        np.zeros((0, 2), np.int64),
        np.concatenate(bearing),
        np.concatenate(solid_angle_sr),
        np.concatenate(origin_m),
        texts=tuple(texts),
    )


def join_outlines(outlines_m: Sequence[np.ndarray | None], T_last_view: np.ndarray) -> np.ndarray:
    """Return the outline of free space of views: the nearest point in each bin around the last view.

    Args:
        outlines_m: The outline (BINS,) of each view in metres; None for a view without an outline.
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.

    Returns:
        (BINS,) float32 in metres; NaN for a bin without points.
    """
    nearest_m = np.full(BINS, np.inf)
    directions = np.exp(1j * MIDDLES_RAD)
    for outline_m, T in zip(outlines_m, T_last_view, strict=True):
        if outline_m is None:
            continue
        points = outline_m * directions * np.exp(1j * pose_yaw(T)) + complex(*T[:2, 3])
        points = points[np.isfinite(points)]
        np.minimum.at(nearest_m, azimuth_bins(np.angle(points)), np.abs(points))
    return np.where(np.isfinite(nearest_m), nearest_m, np.nan).astype(np.float32)


def join_sectors(sectors: Sequence[Sectors], T_last_view: np.ndarray) -> Sectors:
    """Return the sectors of several views as one object, in the frame of the last view.

    Args:
        sectors: The sectors of each view, in the frame of this view.
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
    """
    reach_m, position_m = [], []
    for part, T in zip(sectors, T_last_view, strict=True):
        reach_m.append(part.reach_m[:, azimuth_bins(wrap_angle(MIDDLES_RAD - pose_yaw(T)))])
        position_m.append(part.position_m @ T[:2, :2].T + T[:2, 3])
    return Sectors(np.concatenate(reach_m), np.concatenate(position_m))


def sectors_to_arrays(sectors: Sectors) -> dict[str, np.ndarray]:
    """Return azimuth sectors of views as arrays of a description."""
    return {"reach_m": sectors.reach_m, "shown_from_m": sectors.position_m}


def sectors_from_arrays(arrays: Mapping[str, np.ndarray]) -> Sectors | None:
    """Return the sectors that `sectors_to_arrays` stored in a description; None if it has no sectors."""
    return Sectors(arrays["reach_m"], arrays["shown_from_m"]) if "reach_m" in arrays else None
