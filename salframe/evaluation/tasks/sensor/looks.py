"""The detections and annotations of a panorama, as arrays and as the row of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from salframe.evaluation.runs.records import Record
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.tasks.sensor.fitting import SensorSample
from salframe.evaluation.tasks.sensor.rows import LookRow, ObjectsLine
from salframe.framework.errors import counted
from salframe.graphs.annotated import annotated_objects, as_detections
from salframe.graphs.detections import Detections
from salframe.graphs.visibility import ObjectVisibility, object_visibility
from salframe.panoramas.panorama import Panorama

PARTS: dict[str, tuple[int, ...]] = {
    "scores": (),
    "centroid_m": (3,),
    "size_m": (3,),
    "yaw_rad": (),
    "bearing": (3,),
    "solid_angle_sr": (),
}
"""Name of each array of Detections that a row holds -> shape of the array for one object."""


def annotated(panorama: Panorama) -> tuple[Detections, ObjectVisibility]:
    """Return the annotated objects of a panorama, and the visibility of each."""
    objects = annotated_objects(panorama)
    return as_detections(objects), object_visibility(panorama, objects)


def pack_look(look: SensorSample) -> Row:
    """Return the annotations and detections of a panorama as JSON, with None for unknown values."""
    sides = {"truth": look.truth, "detections": look.detections}
    packed: Row = {
        name: {"labels": list(side.labels), **{part: _listed(getattr(side, part)) for part in PARTS}}
        for name, side in sides.items()
    }
    return {
        **packed,
        "range_m": _listed(look.visibility.range_m),
        "hidden_share": _listed(look.visibility.hidden_share),
    }


def unpack_look(row: LookRow) -> SensorSample | None:
    """Return the annotations and detections in a row; None if the panorama could not be read."""
    if row.truth is None or row.detections is None:
        return None
    truth, detections = _unpack_objects(row.truth), _unpack_objects(row.detections)
    range_m, hidden_share = np.array(row.range_m, float), np.array(row.hidden_share, float)
    return SensorSample(truth, ObjectVisibility(truth.labels, truth.solid_angle_sr, range_m, hidden_share), detections)


def _unpack_objects(line: ObjectsLine) -> Detections:
    arrays: dict[str, Any] = {
        part: np.array(getattr(line, part), float).reshape(-1, *shape) for part, shape in PARTS.items()
    }
    return Detections(labels=line.labels, **arrays)


def _listed(values: np.ndarray) -> list[Any]:
    """Return an array as lists, with None in place of NaN."""
    objects = values.astype(object)
    objects[np.isnan(values)] = None
    as_list: list[Any] = objects.tolist()
    return as_list


def looks_of(records: Sequence[Record[LookRow]]) -> list[SensorSample | None]:
    """Return the annotations and detections of each panorama, in order; None if it could not be read."""
    rows = [row for record in records for row in record.rows]
    return [None if row is None else unpack_look(row) for row in rows]


def failures_of(records: Sequence[Record[LookRow]]) -> list[str]:
    """Return notes on panoramas that were left out, and on panoramas on which the detector failed."""
    failed = [row for record in records for row in record.rows if row is not None and row.status != PieceStatus.OK]
    unread, blind = ([row for row in failed if (row.truth is None) == lacking] for lacking in (True, False))
    words = {"left out": unread, "with an error of the detector (the objects count as missed)": blind}
    return [
        f"{counted(len(rows), 'panorama')} {what}, the first error: {rows[0].error}"
        for what, rows in words.items()
        if rows
    ]
