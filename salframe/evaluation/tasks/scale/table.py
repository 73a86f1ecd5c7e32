"""The table of the task `scale`: its rows and columns."""

from __future__ import annotations

from dataclasses import dataclass

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import INPUT, Column, bytes_column, cost_column, rate_column


@dataclass(frozen=True, kw_only=True)
class ScaleRow(MethodRow):
    """The row of a method. A scene is the saliency graph of one panorama in the map.

    Attributes:
        scenes: Number of scenes of the map.
        build_s: Time to save the map in seconds.
        build_memory_mb: Peak memory while saving (1e6 bytes); None if the process is shared.
        bytes_per_scene: Size of the saved map divided by the number of scenes.
        open_s: Time to open the map in seconds.
        query_median_ms: Median time of a query in milliseconds, including the pose in the best match.
        query_p95_ms: 95th percentile of the time of a query in milliseconds.
        recall_at_1: Share of queries whose scene is the best match, with Wilson's 95 % interval.
        recall_at_1_both: `recall_at_1` among the queries that were also matched with all scenes.
        recall_at_1_exhaustive: Share of these queries whose scene is the best match if all scenes are matched.
    """

    scenes: int
    build_s: float | None = None
    build_memory_mb: float | None = None
    bytes_per_scene: float | None = None
    open_s: float | None = None
    query_median_ms: float | None = None
    query_p95_ms: float | None = None
    recall_at_1: Estimate | None = None
    recall_at_1_both: Estimate | None = None
    recall_at_1_exhaustive: Estimate | None = None

    @property
    def measured(self) -> bool:
        return self.query_median_ms is not None


COLUMNS: dict[str, Column[ScaleRow]] = {
    "input": INPUT,
    "build": cost_column("build\ns", lambda row: row.build_s),
    "memory": cost_column("memory while\nbuilding MB", lambda row: row.build_memory_mb, 0),
    "bytes": bytes_column("bytes with\nindex /panorama", lambda row: row.bytes_per_scene),
    "open": cost_column("open\ns", lambda row: row.open_s),
    "median": cost_column("query\nmedian ms", lambda row: row.query_median_ms),
    "p95": cost_column("query\np95 ms", lambda row: row.query_p95_ms),
    "recall": rate_column("R@1 %\n(95 % CI)", lambda row: row.recall_at_1),
    "recall_both": rate_column("R@1 %\nof the first 50", lambda row: row.recall_at_1_both),
    "exhaustive": rate_column("R@1 % of the first 50,\nall scenes matched", lambda row: row.recall_at_1_exhaustive),
}
DEFAULT_COLUMNS = tuple(COLUMNS)
