"""Compute the table row of each method from its rows per query."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from salframe.evaluation.runs.records import Record, in_common
from salframe.evaluation.statistics import Estimate, estimate_proportion
from salframe.evaluation.tasks.turning.rows import TurnLine, TurnRow
from salframe.evaluation.tasks.turning.table import TurnsRow

_FAILED = TurnLine(accepted=False, right=False)
"""The answer to a query that crashed."""


def summarize_turns(records: Sequence[Record[TurnRow]]) -> TurnsRow:
    """Return the table row of a method, over one data set or several."""
    line = TurnsRow(**in_common(records), queries=sum(len(record.rows) for record in records))
    if not all(record.done for record in records):
        return line
    rows = [(f"{part}/{row.place}", row) for part, record in enumerate(records) for row in record.rows if row]
    if not rows:
        return line
    first = [(cluster, row.first or _FAILED) for cluster, row in rows]
    open_rows = [(cluster, row) for cluster, row in rows if not (row.first or _FAILED).accepted]
    line = replace(line, unaccepted=len(open_rows), resolved_first=_share(first, _resolves))
    if not open_rows:
        return line
    before = [(cluster, row.first or _FAILED) for cluster, row in open_rows]
    suggested = [(cluster, row.suggested or row.first or _FAILED) for cluster, row in open_rows]
    last_view = [(cluster, row.last_view or row.first or _FAILED) for cluster, row in open_rows]
    random = [(cluster, row.random or row.first or _FAILED) for cluster, row in open_rows]
    return replace(
        line,
        resolved=_share(suggested, _resolves),
        resolved_last_view=_share(last_view, _resolves),
        resolved_random=_share(random, _resolves),
        right_first=_share(before, _is_right),
        right=_share(suggested, _is_right),
        right_last_view=_share(last_view, _is_right),
        right_random=_share(random, _is_right),
        wrong=_share(suggested, _misleads),
        wrong_last_view=_share(last_view, _misleads),
        wrong_random=_share(random, _misleads),
    )


def _share(lines: Sequence[tuple[str, TurnLine]], holds: Callable[[TurnLine], bool]) -> Estimate:
    """Return the share of the answers (cluster, answer) for which a condition holds."""
    return estimate_proportion(np.array([holds(line) for _, line in lines]), [cluster for cluster, _ in lines])


def _resolves(line: TurnLine) -> bool:
    return line.accepted and line.right


def _is_right(line: TurnLine) -> bool:
    return line.right


def _misleads(line: TurnLine) -> bool:
    return line.accepted and not line.right
