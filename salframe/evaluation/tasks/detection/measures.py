"""Compute the table row of each detector from its rows per panorama."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from salframe.evaluation.runs.records import Record, in_common
from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.statistics import estimate_mean, median
from salframe.evaluation.tasks.detection.rows import PanoramaRow
from salframe.evaluation.tasks.detection.table import Counts, DetectionRow
from salframe.framework.errors import counted


def summarize_detector(
    records: Sequence[Record[PanoramaRow]], panoramas: int, places: Sequence[str], seed: int
) -> DetectionRow:
    """Return the row of a detector in the table. `places` (P,) are the places of the panoramas."""
    line = DetectionRow(**in_common(records), panoramas=panoramas)
    if not all(record.done for record in records):
        return line
    all_rows = [row for record in records for row in record.rows]
    rows = [row for row in all_rows if row is not None]
    good = [row for row in rows if row.status == PieceStatus.OK]
    if len(good) < panoramas:
        first = next(iter(line.errors.values()), "no answer")
        line = replace(line, reason=f"{counted(panoramas - len(good), 'panorama')} failed, the first error: {first}")
    if not good:
        return line
    # The objects of a failed panorama count as missed; a panorama that could not be read is left out.
    readable = [
        (row, place)
        for row, place in zip(all_rows, places, strict=True)
        if row is not None and row.annotated is not None
    ]
    readable_rows, places = [row for row, _ in readable], [place for _, place in readable]
    annotated, detected, right = (
        sum((Counter(objects) for objects in of_rows), Counter[str]())
        for of_rows in zip(*((row.annotated, row.detections, row.right) for row in readable_rows), strict=True)
    )
    num_annotated, num_detected, num_right = np.array(
        [
            [sum((objects or {}).values()) for objects in (row.annotated, row.detections, row.right)]
            for row in readable_rows
        ]
    ).T
    classes = {
        label: Counts.of(annotated[label], detected[label], right[label]) for label in sorted({*annotated, *detected})
    }
    overall = Counts.of(annotated.total(), detected.total(), right.total())
    joined = {label: name for row in readable_rows for label, name in sorted((row.joined or {}).items())}
    return replace(
        line,
        overall=overall,
        precision=estimate_mean(num_right, places, seed, num_detected) if num_detected.any() else None,
        recall=estimate_mean(num_right, places, seed, num_annotated) if num_annotated.any() else None,
        classes=classes,
        joined=joined,
        ms=median([row.ms for row in good if row.ms is not None]),
    )
