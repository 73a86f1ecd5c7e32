"""Compute the table row of each method from its rows per query."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from salframe.evaluation.runs.records import Record, in_common
from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.statistics import Estimate, estimate_proportion
from salframe.evaluation.tasks.scale.rows import SceneRow
from salframe.evaluation.tasks.scale.table import ScaleRow


def summarize_queries(records: Sequence[Record[SceneRow]], scenes: int) -> ScaleRow:
    line = ScaleRow(**in_common(records), scenes=scenes)
    rows = [row for record in records for row in record.rows if row is not None and row.status == PieceStatus.OK]
    if not rows or not all(record.done for record in records):
        return line
    both = [row for row in rows if row.right_exhaustive is not None]
    failed = sum(len(record.rows) for record in records) - len(rows)  # counted as wrong
    median_ms, p95_ms = np.percentile([row.query_ms or 0.0 for row in rows], [50, 95])
    last = rows[-1]
    return replace(
        line,
        build_s=last.build_s,
        build_memory_mb=last.build_memory_mb,
        open_s=last.open_s,
        bytes_per_scene=None if last.bytes is None else last.bytes / scenes,
        query_median_ms=float(median_ms),
        query_p95_ms=float(p95_ms),
        recall_at_1=_recall([bool(row.right) for row in rows] + [False] * failed),
        recall_at_1_both=_recall([bool(row.right) for row in both]),
        recall_at_1_exhaustive=_recall([bool(row.right_exhaustive) for row in both]),
    )


def _recall(right: Sequence[bool]) -> Estimate | None:
    """Return the share of correct queries, each of a different scene; None without queries."""
    return estimate_proportion(np.array(right), [str(number) for number in range(len(right))]) if right else None
