"""The row of the task `scale`: one query and the costs of its map."""

from __future__ import annotations

from salframe.evaluation.runs.rows import Count, PieceRow


class SceneRow(PieceRow):
    """Whether the best match of a query is its scene, and the costs of the map.

    `right_exhaustive` is the same for matching with all scenes; None if the query was not matched with all scenes.
    """

    query: Count
    right: bool | None = None
    right_exhaustive: bool | None = None
    query_ms: float | None = None
    build_s: float | None = None
    build_memory_mb: float | None = None
    bytes: Count | None = None
    open_s: float | None = None
