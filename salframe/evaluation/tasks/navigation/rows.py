"""The row of the task `navigation`: one episode of an agent."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from salframe.evaluation.runs.rows import Amount, Count, PieceRow

Position = Annotated[tuple[float, ...], Field(min_length=4, max_length=4)]


class EpisodeRow(PieceRow):
    """An episode of an agent: its metrics and its path.

    Attributes:
        episode: Number of the episode.
        world: Id of the building.
        goal: Id of the goal node.
        success: Whether the agent stopped near the goal.
        oracle: Whether the agent was near the goal at any time.
        spl: Success weighted by path length.
        success_1m: Whether the agent stopped within 1 m of the goal.
        success_3m: Whether the agent stopped within 3 m of the goal.
        shortest_m: Length of the shortest path in metres.
        path: Actual (x, y, z, yaw_rad) of the agent at each panorama; None if the episode crashed.
        believed: Estimated (x, y, z, yaw_rad) at each panorama; None where the agent has no estimate.
        left_m: Remaining distance to the goal at the end in metres.
        travelled_m: Length of the path in metres.
        panoramas: Number of panoramas that the agent localized or tried to localize.
        collisions: Number of moves that an obstacle stopped.
    """

    episode: Count
    world: str
    goal: str
    success: bool
    oracle: bool
    spl: float = Field(ge=0, le=1)
    success_1m: bool
    success_3m: bool
    shortest_m: Amount
    path: tuple[Position, ...] | None = None
    believed: tuple[Position | None, ...] | None = None
    left_m: float | None = None
    travelled_m: Amount | None = None
    panoramas: Count | None = None
    collisions: Count | None = None

    @model_validator(mode="after")
    def _complete(self) -> EpisodeRow:
        if self.path is not None and None in (self.travelled_m, self.panoramas, self.collisions):
            raise ValueError(
                "a result row lacks a field, expected `travelled_m`, `panoramas` and `collisions` in every row with "
                "`path`"
            )
        return self
