"""From the rows of detectors to their lines in the table."""

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


def summarize_detector(
    records: Sequence[Record[PanoramaRow]], panoramas: int, places: Sequence[str], seed: int
) -> DetectionRow:
    """A detector's line; places (P,): where each panorama was taken."""
    line = DetectionRow(**in_common(records), panoramas=panoramas)
    if not all(record.done for record in records):
        return line
    all_rows = [row for record in records for row in record.rows]
    rows = [row for row in all_rows if row is not None]
    good = [row for row in rows if row.status == PieceStatus.OK]
    if len(good) < panoramas:
        first = next(iter(line.errors.values()), "no answer")
        line = replace(line, reason=f"{panoramas - len(good)} panorama(s) failed, the first: {first}")
    if not good:
        return line
    # What a failure had to find was not found; a panorama that nobody could read tells nothing.
    told = [
        (row, place)
        for row, place in zip(all_rows, places, strict=True)
        if row is not None and row.annotated is not None
    ]
    counted, places = [row for row, _ in told], [place for _, place in told]
    annotated, found, right = (
        sum((Counter(objects) for objects in of_rows), Counter[str]())
        for of_rows in zip(*((row.annotated, row.found, row.right) for row in counted), strict=True)
    )
    num_annotated, num_found, num_right = np.array(
        [[sum((objects or {}).values()) for objects in (row.annotated, row.found, row.right)] for row in counted]
    ).T
    classes = {label: Counts.of(annotated[label], found[label], right[label]) for label in sorted({*annotated, *found})}
    overall = Counts.of(annotated.total(), found.total(), right.total())
    joined = {label: name for row in counted for label, name in sorted((row.joined or {}).items())}
    return replace(
        line,
        overall=overall,
        precision=estimate_mean(num_right, places, seed, num_found) if num_found.any() else None,
        recall=estimate_mean(num_right, places, seed, num_annotated) if num_annotated.any() else None,
        classes=classes,
        joined=joined,
        ms=median([row.ms for row in good if row.ms is not None]),
    )
