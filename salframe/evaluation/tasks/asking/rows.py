"""The row of the task `asking`: one description of a room, and the rank of the room."""

from __future__ import annotations

from pydantic import Field, model_validator

from salframe.evaluation.runs.rows import Count, PieceRow


class DescriptionRow(PieceRow):
    """A description of the room of a query.

    Attributes:
        query: Id of the query.
        place: True place.
        text: The description; None if the query shows too few different objects.
        rank: Rank of the true place by the whole description, from 1.
        rank_counts: Rank of the true place by labels and numbers of objects, without their order.
        rank_labels: Rank of the true place by labels alone.
        places: Number of places of the map.
        probability: Probability of the first place by the whole description.
    """

    query: str
    place: str
    text: str | None = None
    rank: Count | None = None
    rank_counts: Count | None = None
    rank_labels: Count | None = None
    places: Count | None = None
    probability: float | None = Field(None, ge=0, le=1)

    @model_validator(mode="after")
    def _complete(self) -> DescriptionRow:
        if self.text is not None and None in (self.rank, self.rank_counts, self.rank_labels, self.places):
            raise ValueError(
                "a result row lacks a field, expected `rank`, `rank_counts`, `rank_labels` and `places` in every row "
                "with `text`"
            )
        return self
