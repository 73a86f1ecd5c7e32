"""The table of the task `latency`: its rows and columns."""

from __future__ import annotations

from dataclasses import dataclass

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.tables.columns import INPUT, Column, bytes_column, cost_column, count_column


@dataclass(frozen=True, kw_only=True)
class LatencyRow(MethodRow):
    """The row of a method. The map is the saved map of the first fold (a map and its queries) of the data set.

    Attributes:
        queries: Number of queries.
        scenes: Number of reference frames of the map.
        bytes_per_scene: Size of the saved map with its index, divided by `scenes`.
        open_s: Time in seconds to open the map in a process that has only imported salframe.
        opened_mb: Memory (1e6 bytes) that opening the map takes; None on systems other than Linux.
        queried_mb: Memory (1e6 bytes) that opening the map and the first query take; None on systems other than Linux.
        first_ms: Time to describe and answer the first query. All times that end in _ms are in milliseconds.
        describe_ms: Median time to describe a later query.
        query_median_ms: Median time to answer a later query.
        query_p95_ms: 95th percentile of the time to answer a later query.
    """

    queries: int
    scenes: int | None = None
    bytes_per_scene: float | None = None
    open_s: float | None = None
    opened_mb: float | None = None
    queried_mb: float | None = None
    first_ms: float | None = None
    describe_ms: float | None = None
    query_median_ms: float | None = None
    query_p95_ms: float | None = None

    @property
    def measured(self) -> bool:
        return self.query_median_ms is not None


COLUMNS: dict[str, Column[LatencyRow]] = {
    "input": INPUT,
    "scenes": count_column("scenes", lambda row: row.scenes),
    "bytes": bytes_column("bytes with\nindex /panorama", lambda row: row.bytes_per_scene),
    "open": cost_column("open\nms", lambda row: None if row.open_s is None else row.open_s * 1e3),
    "opened": cost_column("memory after\nopening MB", lambda row: row.opened_mb, 0),
    "first": cost_column("first query\nms", lambda row: row.first_ms),
    "queried": cost_column("memory after\nfirst query MB", lambda row: row.queried_mb, 0),
    "describe": cost_column("describe\nms", lambda row: row.describe_ms),
    "median": cost_column("query\nmedian ms", lambda row: row.query_median_ms),
    "p95": cost_column("query\np95 ms", lambda row: row.query_p95_ms),
}
DEFAULT_COLUMNS = tuple(COLUMNS)
