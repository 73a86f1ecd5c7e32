"""Compute the table rows of each method from its walks, one row for each belief (estimate of the camera's pose)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from salframe.evaluation.runs.records import Part, by_method, in_common
from salframe.evaluation.statistics import estimate_proportion, estimate_statistic, median, roc_area
from salframe.evaluation.tasks.tracking.rows import BeliefLine, BeliefRow, WalkRow
from salframe.evaluation.tasks.tracking.survey import TrackingSurvey
from salframe.evaluation.tasks.tracking.table import AFTER, NEAR_M, TrackingRow


def summarize_beliefs(
    parts: Sequence[Part[TrackingSurvey, WalkRow]], beliefs: Sequence[str], seed: int
) -> tuple[TrackingRow, ...]:
    """Return the rows of all beliefs of each method, over one data set or several."""
    count = sum(len(survey.pieces) for survey, _ in parts)
    lines: list[TrackingRow] = []
    for records in by_method(parts):
        for belief in beliefs:
            line = TrackingRow(**in_common(records), belief=belief, walks=count)
            if all(record.done for record in records):
                rows = [(part, row) for part, record in enumerate(records) for row in record.rows if row is not None]
                line = replace(line, **_measure(rows, belief, seed))
                if len(records) > 1:
                    by_part = [[row for number, row in rows if number == part] for part in range(len(records))]
                    line = replace(line, by_part=tuple(float(np.mean(_right(part, belief, 12))) for part in by_part))
            lines.append(line)
    return tuple(lines)


def _measure(rows: Sequence[tuple[int, WalkRow]], belief: str, seed: int) -> dict[str, Any]:
    """Return the measured fields of a belief from all walks (data set, row), clustered by the place of the start."""
    clusters = [f"{part}/{row.start}" for part, row in rows]
    walks = [row for _, row in rows]
    beliefs = [None if row.beliefs is None else row.beliefs[belief] for row in walks]
    known = [one for one in beliefs if one is not None]
    last = [None if one is None else one.walk[-1] for one in beliefs]
    error_m = np.array([np.inf if one is None or one.position_m is None else one.position_m for one in last])
    headings = [one.heading_deg for one in last if one is not None and one.heading_deg is not None]
    nees = [one.nees for one in last if one is not None and one.nees is not None and _is_near(one)]
    elsewhere = [one.elsewhere[-1] for one in known if one.elsewhere]
    support = np.array([one.walk[-1].support for one in known])
    return {
        "right": tuple(float(np.mean(_right(walks, belief, count))) for count in AFTER),
        "right_12": estimate_proportion(_right(walks, belief, AFTER[-1]), clusters),
        "near": estimate_proportion(error_m <= NEAR_M, clusters),
        "position_m": estimate_statistic(lambda index: _finite_median(error_m[index]), clusters, seed),
        "heading_deg": median(headings),
        "recovered": estimate_proportion(np.array([one is not None and _recovers(one) for one in beliefs]), clusters),
        "right_later": estimate_proportion(
            np.array([one is not None and one.kidnapped[-1].right for one in beliefs]), clusters
        ),
        "tracking": estimate_proportion(np.array([one is not None and one.tracking for one in last]), clusters),
        "nees": float(np.mean(nees)) if nees else None,
        **(_measure_elsewhere(support, elsewhere, clusters, seed) if len(elsewhere) == len(walks) else {}),
    }


def _measure_elsewhere(
    support: np.ndarray, elsewhere: Sequence[BeliefLine], clusters: Sequence[str], seed: int
) -> dict[str, Any]:
    """Return the fields that compare the walks with those in the map of another building."""
    absent = np.array([one.support for one in elsewhere])
    tracking = np.array([one.tracking for one in elsewhere])
    return {
        "roc_area": estimate_statistic(lambda index: roc_area(support[index], absent[index]), clusters, seed),
        "tracking_elsewhere": estimate_proportion(tracking, clusters),
    }


def _right(walks: Sequence[WalkRow], belief: str, count: int) -> np.ndarray:
    """Return whether the place is correct after a number of views, (N,) bool."""
    return np.array([row.beliefs is not None and row.beliefs[belief].walk[count - 1].right for row in walks], bool)


def _finite_median(errors_m: np.ndarray) -> float | None:
    """Return the median of errors (N,), in which inf is a missing pose. None if half of the poses are missing."""
    middle = np.sort(errors_m)[[(len(errors_m) - 1) // 2, len(errors_m) // 2]]
    return float(middle.mean()) if np.isfinite(middle).all() else None


def _is_near(line: BeliefLine) -> bool:
    return line.position_m is not None and line.position_m <= NEAR_M


def _recovers(belief: BeliefRow) -> bool:
    """Return whether the place is correct after at least one view that follows a move without odometry."""
    return any(line.right for line in belief.kidnapped)
