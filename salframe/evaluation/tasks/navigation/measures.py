"""Compute the table row of each method from the episodes of its agent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from salframe.evaluation.runs.records import Part, Record, by_method, in_common
from salframe.evaluation.statistics import estimate_mean, estimate_proportion, holm, paired_test
from salframe.evaluation.tasks.navigation.rows import EpisodeRow
from salframe.evaluation.tasks.navigation.survey import NavigationSurvey
from salframe.evaluation.tasks.navigation.table import NavigationRow

RATES: Mapping[str, Callable[[EpisodeRow], float]] = {
    "success_rate": lambda row: row.success,
    "oracle_success_rate": lambda row: row.oracle,
    "spl": lambda row: row.spl,
    "success_rate_1m": lambda row: row.success_1m,
    "success_rate_3m": lambda row: row.success_3m,
}
"""Field of NavigationRow -> function of an episode. The field is the mean of the function over all episodes."""
MEANS: Mapping[str, Callable[[EpisodeRow], float | None]] = {
    "path_m": lambda row: row.travelled_m,
    "panoramas": lambda row: row.panoramas,
    "collisions": lambda row: row.collisions,
}
"""Field of NavigationRow -> function of an episode. The field is the mean over the episodes that did not crash."""


Scores = Callable[[Sequence[Part[NavigationSurvey, EpisodeRow]], Sequence[Record[EpisodeRow]]], Mapping[str, float]]
"""Function that returns the metrics of a benchmark by name, for the records of one method."""


def summarize_agents(
    parts: Sequence[Part[NavigationSurvey, EpisodeRow]], seed: int, scores: Scores
) -> tuple[NavigationRow, ...]:
    """Return the row of each method in the table, over one data set or several."""
    episodes = sum(len(survey.pieces) for survey, _ in parts)
    lines: list[NavigationRow] = []
    first: np.ndarray | None = None
    for records in by_method(parts):
        line = NavigationRow(**in_common(records), episodes=episodes)
        if all(record.done for record in records):
            walked = [_in_order(record) for record in records]
            rows = [row for part in walked for row in part]
            goals = [f"{number}/{row.world}/{row.goal}" for number, part in enumerate(walked) for row in part]
            success = np.array([row.success for row in rows], bool)
            p_value = None if first is None else paired_test(first, success, goals)
            line = replace(line, **_measure(rows, goals, seed), p_value=p_value, scores=scores(parts, records))
            if len(walked) > 1:
                line = replace(line, by_part=tuple(float(np.mean([row.success for row in part])) for part in walked))
            first = success if first is None else first
        lines.append(line)
    adjusted = holm([line.p_value for line in lines])
    return tuple(replace(line, p_adjusted=p) for line, p in zip(lines, adjusted, strict=True))


def _in_order(record: Record[EpisodeRow]) -> list[EpisodeRow]:
    """Return the episodes of a method in the order of their numbers."""
    return sorted((row for row in record.rows if row is not None), key=lambda row: row.episode)


def _measure(rows: Sequence[EpisodeRow], goals: Sequence[str], seed: int) -> dict[str, Any]:
    """Return the measured fields of a method from all of its episodes, clustered by goal."""
    summary: dict[str, Any] = {}
    for name, get in RATES.items():
        values = np.array([get(row) for row in rows])
        summary[name] = (
            estimate_proportion(values, goals) if values.dtype == bool else estimate_mean(values, goals, seed)
        )
    ended = [row for row in rows if row.path is not None]
    for name, amount in MEANS.items():
        summary[name] = float(np.mean([amount(row) for row in ended])) if ended else None
    return summary
