"""The row of the task `latency`: the cost of one query and of its map."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from salframe.evaluation.runs.rows import Amount, Count, PieceRow, PieceStatus


class ProgramRow(PieceRow):
    """Time and memory of a query to a saved map, and of the map.

    Attributes:
        query: Id of the query.
        first: Whether the query is the first one in its process.
        describe_ms: Time to describe the query in milliseconds.
        query_ms: Time to answer the described query in milliseconds.
        scenes: Number of reference frames of the map.
        bytes: Size of the saved map with its index.
        open_s: Time to open the map in seconds.
        opened_mb: Memory (1e6 bytes) that opening the map takes; None if it is unknown.
        queried_mb: Memory (1e6 bytes) that opening the map and the first query take; None for later queries.
    """

    query: str
    first: bool | None = None
    describe_ms: Amount | None = None
    query_ms: Amount | None = None
    scenes: Annotated[int, Field(gt=0)] | None = None
    bytes: Count | None = None
    open_s: Amount | None = None
    opened_mb: Amount | None = None
    queried_mb: Amount | None = None

    @model_validator(mode="after")
    def _complete(self) -> ProgramRow:
        needed = (self.first, self.describe_ms, self.query_ms, self.scenes, self.bytes, self.open_s)
        if self.status == PieceStatus.OK and None in needed:
            raise ValueError(
                "a result row with the status ok lacks a field, expected `first`, `describe_ms`, `query_ms`, "
                "`scenes`, `bytes` and `open_s`"
            )
        return self
