"""Localize the query of a request, and write the answer and the objects of the query as JSON."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from salframe.drawing.object_picture import find_lines
from salframe.graphs.detections import Detections
from salframe.localization.answer_json import answer_json
from salframe.localization.answers import Localization
from salframe.localization.described_objects import described_objects
from salframe.localization.described_query import DescribedView
from salframe.localization.map import LocalizationMap
from salframe.localization.matched_objects import find_matched_objects
from salframe.serving.served_map import ServedMap
from salframe.serving.uploads import ServedQuery

MAX_PICTURE_WIDTH = 1280
"""Maximum width of the picture in an answer, in pixels."""
_JPEG_QUALITY = 80


@dataclass(frozen=True, eq=False)
class ServedView:
    """A view of a query, with the description (features) that the localizer computed from it.

    Attributes:
        query: The query, without its panorama.
        view: The described view.
        notes: Notes on the images, and warnings, one line each.
    """

    query: ServedQuery
    view: DescribedView
    notes: tuple[str, ...]


def describe_view(localization: LocalizationMap, query: ServedQuery) -> ServedView:
    """Compute the description (features) of a query.

    Raises:
        InputMissing: The query lacks a part that the localizer requires.
        DataError: An image is malformed.
    """
    notes = list(query.notes)
    if query.panorama is not None:
        view = localization.describe_panorama(query.panorama, warn=lambda note: notes.append(str(note)))
    else:
        view = localization.describe_detections(query.detections or Detections.empty())
    turned = localization.describe_query([view], warn=lambda note: notes.append(str(note))).turned
    description = turned[0] if turned else view.description
    # Replace the function that describes the rotated panorama by its result, so that the panorama can be freed.
    view = replace(view, describe_turned=lambda: (description, 0.0))
    return ServedView(replace(query, panorama=None), view, tuple(dict.fromkeys(notes)))


def localize_view(localization: LocalizationMap, described: ServedView) -> Localization:
    """Return the answer to one view. If the query states the position of the camera on a robot, the pose of the answer
    is the pose of the base of the robot."""
    answer = localization.answer_query(localization.describe_query([described.view]))
    return answer.moved(described.query.position_m)


def describe_answer(
    served: ServedMap,
    described: ServedView,
    answer: Localization,
    seconds: float,
    *,
    with_objects: bool = False,
    with_picture: bool = False,
) -> dict[str, Any]:
    """Return an answer as JSON.

    Args:
        served: The map.
        described: The view.
        answer: The answer.
        seconds: Computing time of the answer.
        with_objects: Whether to list the objects of the view, and the objects of the map that they were matched with.
        with_picture: Whether to include the image as the server read it.
    """
    content = answer_json(answer)
    content["notes"] = [*described.notes, *content["notes"]]
    content |= {"map_version": served.version, "seconds": seconds}
    if with_objects:
        content |= _objects(served.localization, described, answer)
    if with_picture and described.query.rgb is not None:
        content["picture"] = _picture(described.query.rgb)
    return content


def _objects(localization: LocalizationMap, described: ServedView, answer: Localization) -> dict[str, Any]:
    """Return the objects of a view and the edges between them, as JSON. Both are empty if the description of the view
    is not a saliency graph."""
    query = described.query
    description = described.view.describe_turned()[0]
    objects = described_objects(description)
    if objects is None:
        return {"objects": [], "edges": []}
    graph, detections = objects
    lines: list[list[np.ndarray]] = [[] for _ in graph.labels]
    size = np.ones(2)
    if query.rgb is not None:
        height, width = query.rgb.shape[:2]
        lines, size = find_lines(height, detections, query.camera), np.array([width, height])
    matched = find_matched_objects(localization, description, answer)
    rows = []
    for i, label in enumerate(graph.labels):
        x, y, z = detections.bearing[i]
        has_range = bool(np.isfinite(graph.centroid_m[i]).all())
        rows.append(
            {
                "label": label,
                "score": float(graph.scores[i]),
                "saliency": float(graph.saliency[i]),
                "azimuth_deg": float(np.degrees(np.arctan2(y, x))),
                "elevation_deg": float(np.degrees(np.arctan2(z, np.hypot(x, y)))),
                "centroid_m": detections.centroid_m[i].tolist() if has_range else None,
                "size_m": graph.size_m[i].tolist() if has_range else None,
                "yaw_deg": float(np.degrees(graph.yaw_rad[i])) if has_range else None,
                "outline": [(line / size).round(5).tolist() for line in lines[i]],
                "matched": {"label": matched[i].label, "xyz_m": matched[i].xyz_m.tolist()} if i in matched else None,
            }
        )
    return {"objects": rows, "edges": graph.edges.tolist()}


def _picture(rgb: np.ndarray) -> str:
    """Return an image (H, W, 3) uint8 as the data URL of a JPEG, with a width of at most MAX_PICTURE_WIDTH."""
    import cv2

    height, width = rgb.shape[:2]
    if width > MAX_PICTURE_WIDTH:
        size = MAX_PICTURE_WIDTH, max(1, round(height * MAX_PICTURE_WIDTH / width))
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(content.tobytes()).decode()
