"""The row of the task `turning`: one query, and the answers after a turn on the spot."""

from __future__ import annotations

from pydantic import model_validator

from salframe.evaluation.runs.rows import Line, PieceRow


class TurnLine(Line):
    """Whether an answer is accepted and correct.

    Attributes:
        accepted: Whether the answer is accepted.
        right: Whether its first place is the true place.
        turn_deg: Angle in degrees of the turn from the first to the last view; 0 if there is only one view.
    """

    accepted: bool
    right: bool
    turn_deg: float = 0.0


class TurnRow(PieceRow):
    """The answers to one query.

    Attributes:
        query: Id of the query.
        place: True place.
        first: The answer to the query alone.
        suggested: The answer to the query and the views of the suggested turn; None if the first answer is accepted, or
            suggests no turn.
        last_view: As `suggested`, with only the last view of the turn.
        random: As `suggested`, with the views of a random turn.
    """

    query: str
    place: str
    first: TurnLine | None = None
    suggested: TurnLine | None = None
    last_view: TurnLine | None = None
    random: TurnLine | None = None

    @model_validator(mode="after")
    def _complete(self) -> TurnRow:
        if self.error is None and self.first is None:
            raise ValueError(
                "the result row of a query has neither `error` nor `first` (the first answer), expected one of them"
            )
        return self
