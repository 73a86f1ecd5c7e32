"""The row of the task `matching`: the matches of one pair of frames."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from salframe.evaluation.runs.rows import Count, PieceRow, PieceStatus


class PairRow(PieceRow):
    """Numbers of matches of a pair of frames.

    Attributes:
        fold: Id of the fold, which contains the map and its queries.
        query: Id of the query.
        kind: "points" or "nodes" (objects of graphs): what the method matches.
        matches: Number of matches.
        judged: For points, number of matches that can be judged.
        within_px: For points, number of judged matches with an error within each of THRESHOLDS_PX.
        correct: For nodes, number of matches of the same object.
        true: For nodes, number of objects that are in both graphs.
    """

    fold: str
    query: str
    kind: Literal["points", "nodes"] | None = None
    matches: Count | None = None
    judged: Count | None = None
    within_px: tuple[Count, ...] | None = None
    correct: Count | None = None
    true: Count | None = None

    @model_validator(mode="after")
    def _complete(self) -> PairRow:
        counted = (self.judged, self.within_px) if self.kind == "points" else (self.correct, self.true)
        if self.status == PieceStatus.OK and None in (self.kind, self.matches, *counted):
            raise ValueError(
                "a result row with the status ok lacks a field, expected `kind` and `matches`; for matches of points "
                "also `judged` and `within_px`; for matches of nodes also `correct` and `true`"
            )
        return self
