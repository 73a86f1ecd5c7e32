"""The row of the task `localization`: the answer to one query."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from salframe.evaluation.runs.rows import Amount, PieceRow
from salframe.localization.answers import LocalizationStatus, RankedPlace

PLACED = tuple(status for status in LocalizationStatus if status.names_a_place)
"""Statuses of answers that name a place."""
REJECTIONS = tuple(status for status in LocalizationStatus if status.is_rejection)
"""Statuses of answers which mean that the query is out of the map."""


class AnswerRow(PieceRow):
    """An answer to a query.

    Attributes:
        fold: Id of the fold, which contains the map and its queries.
        query: Id of the query.
        places: The best places, best first.
        pose: 16 numbers of T_world_query row by row; None without a pose.
        heading: Heading of the query in radians; None if it is unknown.
        probabilities: Probability of each of `places`; None if the method has none.
        out_of_map_probability: Probability that the query is out of the map; None if the method has none.
        accepted: Whether the answer is accepted; None if the method has no probabilities.
        covariance: Covariance of the pose, 3 x 3 or 6 x 6; None if it is unknown.
        query_ms: Time to answer the query in milliseconds.
        describe_ms: Time to describe the query in milliseconds.
        peak_memory_mb: Peak memory of the process so far (1e6 bytes); None if it is unknown.
    """

    fold: str
    query: str
    places: tuple[RankedPlace, ...]
    pose: Annotated[tuple[float, ...], Field(min_length=16, max_length=16)] | None
    heading: float | None = None
    probabilities: tuple[float, ...] | None = None
    out_of_map_probability: float | None = None
    accepted: bool | None = None
    covariance: tuple[tuple[float, ...], ...] | None = None
    query_ms: Amount | None
    describe_ms: Amount | None
    peak_memory_mb: Amount | None

    @property
    def pose_matrix(self) -> np.ndarray | None:
        """The pose (4, 4)."""
        return None if self.pose is None else np.reshape(self.pose, (4, 4))

    @model_validator(mode="after")
    def _complete(self) -> AnswerRow:
        if self.status in PLACED and not self.places:
            raise ValueError(f"an answer with the status {self.status} has no place, expected at least one place")
        if self.covariance is not None:
            sides = {len(self.covariance), *map(len, self.covariance)}
            if sides not in ({3}, {6}):
                raise ValueError(
                    f"the key `covariance` of an answer has {len(self.covariance)} rows of lengths "
                    f"{' and '.join(map(str, sorted(set(map(len, self.covariance)))))}, expected 3 x 3 or 6 x 6"
                )
        if len(self.probabilities or ()) != (0 if self.out_of_map_probability is None else len(self.places)):
            raise ValueError(
                f"an answer has {len(self.probabilities or ())} probabilities for {len(self.places)} places, and "
                f"out_of_map_probability is {self.out_of_map_probability}; expected one probability for each place "
                "and a number as out_of_map_probability, or no probabilities and the out_of_map_probability None"
            )
        return self
