"""Conversion of the class probabilities of a network to scores."""

from __future__ import annotations

import math

from pydantic import Field

from salframe.framework.validation import Settings


class ScoreCalibration(Settings):
    """Conversion of the mean class probability p of an object to its score.

    The score is the probability that the label of the object is correct. It is the logistic function of
    slope * logit(p) + offset (Platt scaling). With the default values, the score is p.
    """

    slope: float = Field(1.0, gt=0)
    offset: float = 0.0

    def score(self, probability: float) -> float:
        """Return the score of an object whose class has this mean probability; both are in [0, 1]."""
        p = min(max(probability, 1e-6), 1 - 1e-6)
        return 1 / (1 + math.exp(-self.slope * math.log(p / (1 - p)) - self.offset))
