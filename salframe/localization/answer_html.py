"""Answers of localizers as HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.markup import element, table, to_html
from salframe.panoramas.floor_outlines import draw_floor, floor_below
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.geometry import confidence_ellipse, pose_yaw

NUM_PLACES = 5
"""Maximum number of places in the table."""
POSE_COLOUR = "#1f4ea0"


def localization_html(
    summary: str,
    places: Sequence[tuple[str, str, float, float | None]],
    out_of_map_probability: float | None,
    T_world_query: np.ndarray | None,
    covariance: np.ndarray | None,
    notes: Sequence[str],
    floors: Sequence[FloorMasks],
) -> str:
    """Return an answer as HTML: its status, the first places, the pose, notes, and a plan of the floor of the pose.

    Args:
        summary: The status in one line.
        places: Frame, place, score and probability of each place, best first.
        out_of_map_probability: As in `Localization`.
        T_world_query: As in `Localization`.
        covariance: As in `Localization`. The plan shows its 95 % ellipse.
        notes: As in `Localization`.
        floors: Floors of the map; empty: there is no plan.
    """
    rows = [
        [place, frame, f"{score:.3g}" if probability is None else f"{probability:.1%}"]
        for frame, place, score, probability in places[:NUM_PLACES]
    ]
    if len(places) > NUM_PLACES:
        others = [probability for *_, probability in places[NUM_PLACES:] if probability is not None]
        rows.append([f"other places ({len(places) - NUM_PLACES})", "", f"{sum(others):.1%}" if others else ""])
    if out_of_map_probability is not None:
        rows.append(["out-of-map", "", f"{out_of_map_probability:.1%}"])
    has_probabilities = out_of_map_probability is not None
    parts = [element("p", f"status: {summary}")]
    if rows:
        parts.append(table(["place", "frame", "probability" if has_probabilities else "score"], rows))
    if T_world_query is not None:
        x_m, y_m, z_m = T_world_query[:3, 3]
        yaw_rad = pose_yaw(T_world_query)
        pose = f"pose: x {x_m:.2f} m, y {y_m:.2f} m, z {z_m:.2f} m, yaw {np.degrees(yaw_rad):.1f} deg"
        parts.append(element("p", pose))
        floor = floor_below(floors, T_world_query[:3, 3])
        if floor is not None:
            drawing = draw_floor(floor, T_world_query[None, :2, 3])
            if covariance is not None and np.isfinite(covariance[:2, :2]).all():
                ellipse_m = confidence_ellipse(covariance[:2, :2]) + T_world_query[:2, 3]
                drawing.fill_rings([ellipse_m], fill=POSE_COLOUR, fill_opacity="0.2", stroke=POSE_COLOUR)
            drawing.arrow(T_world_query[:2, 3], yaw_rad, POSE_COLOUR)
            parts.append(drawing.svg)
    return to_html(*parts, *(element("p", f"note: {note}") for note in notes))
