"""The row of the task `localization`: the answer to one query."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from salframe.evaluation.runs.rows import Amount, PieceRow
from salframe.localization.answers import LocalizationStatus, RankedPlace

PLACED = tuple(status for status in LocalizationStatus if status.names_a_place)
DENIALS = tuple(status for status in LocalizationStatus if status.denies_the_map)


class AnswerRow(PieceRow):
    """An answer to a query."""

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
                    f"the covariance of a pose has {len(self.covariance)} rows of lengths "
                    f"{sorted(set(map(len, self.covariance)))}, expected 3 x 3 or 6 x 6"
                )
        if len(self.probabilities or ()) != (0 if self.out_of_map_probability is None else len(self.places)):
            raise ValueError(
                f"an answer has {len(self.probabilities or ())} probabilities, {len(self.places)} places "
                f"and out_of_map_probability {self.out_of_map_probability}, expected "
                "out_of_map_probability and one probability for each place, or no probabilities"
            )
        return self
