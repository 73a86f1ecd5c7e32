"""From the rows of episodes to the numbers of a table (method.md, Metrics)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from salframe.evaluation.metrics import RESAMPLES, mcnemar_exact
from salframe.navigation.walk import Row

INTERVALS = {"success": "success_rate", "oracle": "oracle_success_rate", "spl": "spl", "success_3m": "success_rate_3m"}
"""Columns with a mean and a 95 % interval (`_low`, `_high`) by the key of an episode's row."""
MEANS = {"travelled_m": "path_m", "panoramas": "panoramas", "collisions": "collisions"}
"""Columns with a mean alone."""
COLUMNS = (
    "method",
    "episodes",
    *(f"{column}{end}" for column in INTERVALS.values() for end in ("", "_low", "_high")),
    *MEANS.values(),
    "p_value",
    "available",
    "reason",
    "status",
)


def bootstrap_interval(values: np.ndarray, seed: int) -> tuple[float, float]:
    """95 % interval of the mean of (N,) values over draws of N of them with replacement."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(len(values), size=(RESAMPLES, len(values)))].mean(1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def summarize(rows: Sequence[Row], seed: int) -> dict[str, Any]:
    """The measured columns of a method from all its rows. A crashed episode is a failure; lengths and counts are of
    those that ended."""
    summary: dict[str, Any] = {}
    for key, column in INTERVALS.items():
        values = np.array([row[key] for row in rows], float)
        low, high = bootstrap_interval(values, seed)
        summary |= {column: float(values.mean()), f"{column}_low": low, f"{column}_high": high}
    ended = [row for row in rows if row["status"] != "crashed"]
    for key, column in MEANS.items():
        summary[column] = float(np.mean([row[key] for row in ended])) if ended else None
    return summary


def success_p_value(first: Sequence[Row], second: Sequence[Row]) -> float:
    """Exact McNemar test of two methods' successes on the same episodes, in the same order."""
    a, b = (np.array([row["success"] for row in rows], bool) for rows in (first, second))
    return mcnemar_exact(a, b)
