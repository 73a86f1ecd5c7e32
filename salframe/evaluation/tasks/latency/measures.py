"""Compute the table row of each method from its rows per query."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from salframe.evaluation.runs.records import Record, in_common
from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.statistics import median
from salframe.evaluation.tasks.latency.rows import ProgramRow
from salframe.evaluation.tasks.latency.table import LatencyRow


def summarize_program(records: Sequence[Record[ProgramRow]], queries: int) -> LatencyRow:
    line = LatencyRow(**in_common(records), queries=queries)
    rows = [row for record in records for row in record.rows if row is not None and row.status == PieceStatus.OK]
    if not rows or not all(record.done for record in records):
        return line
    if len(rows) < queries:
        first = next(iter(line.errors.values()), "no answer")
        line = replace(line, reason=f"{queries - len(rows)} of {queries} queries failed, the first error: {first}")
    later = [row for row in rows if not row.first] or rows
    query_ms = [row.query_ms for row in later if row.query_ms is not None]
    firsts = [row for row in rows if row.first]
    scenes, size = rows[0].scenes, rows[0].bytes
    return replace(
        line,
        scenes=scenes,
        bytes_per_scene=size / scenes if size is not None and scenes else None,
        open_s=median([row.open_s for row in firsts if row.open_s is not None]),
        opened_mb=median([row.opened_mb for row in firsts if row.opened_mb is not None]),
        queried_mb=median([row.queried_mb for row in firsts if row.queried_mb is not None]),
        first_ms=median([(row.describe_ms or 0.0) + (row.query_ms or 0.0) for row in firsts]),
        describe_ms=median([row.describe_ms for row in later if row.describe_ms is not None]),
        query_median_ms=median(query_ms),
        query_p95_ms=float(np.percentile(query_ms, 95)),
    )
