"""The row of the task `scale`: one query and the costs of its map."""

from __future__ import annotations

from salframe.evaluation.runs.rows import Count, PieceRow


class SceneRow(PieceRow):
    """Whether the best match of a query is its scene, and the costs of the map. A scene is the graph of one panorama.

    Attributes:
        query: Index of the scene that the query shows.
        right: Whether the best match is this scene.
        right_exhaustive: The same for matching with all scenes; None if the query was not matched with all scenes.
        query_ms: Time of the query in milliseconds, including the pose in the best match.
        build_s: Time to save the map in seconds.
        build_memory_mb: Peak memory of the process that saved the map (1e6 bytes); None if it is unknown.
        bytes: Size of the saved map.
        open_s: Time to open the map in seconds.
    """

    query: Count
    right: bool | None = None
    right_exhaustive: bool | None = None
    query_ms: float | None = None
    build_s: float | None = None
    build_memory_mb: float | None = None
    bytes: Count | None = None
    open_s: float | None = None
