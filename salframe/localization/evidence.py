"""Evidence: numbers that support places of a map as the place of a query, in named columns. The weights of the columns
are fitted on tuning data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from salframe.framework.errors import DataError

RIDGE = 1e-3
"""Ridge penalty: factor of the squared weights, per answer. A weight is in units of the inverse spread of its column.
Without the penalty, the optimal weights are infinite if the columns always rank the true place first."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence for H hypotheses of the place of a query. Several hypotheses may have the same place.

    Attributes:
        places: The place names of the H hypotheses.
        values: Mapping from the name of each column to its values, (H,) float64. A larger value supports a hypothesis
            more.
    """

    places: Sequence[str]
    values: Mapping[str, np.ndarray]

    def scores(self, weights: Mapping[str, float]) -> np.ndarray:
        """Return the score of each hypothesis, (H,): the weighted sum of its columns."""
        total = np.zeros(len(self.places))
        for name, values in self.values.items():
            total += weights[name] * values
        return total

    def place_scores(self, weights: Mapping[str, float]) -> dict[str, float]:
        """Return the score of each place: the log-sum-exp of the scores of its hypotheses."""
        scores: dict[str, float] = {}
        for place, score in zip(self.places, self.scores(weights).tolist(), strict=True):
            scores[place] = float(np.logaddexp(scores[place], score)) if place in scores else score
        return scores


def fit_weights(samples: Sequence[tuple[Evidence, str]]) -> tuple[dict[str, float], float, float]:
    """Fit the weights that maximize the softmax probability of the true place.

    The method is maximum likelihood with a ridge penalty. Samples without a hypothesis for the true place are ignored.

    Args:
        samples: The evidence and the true place of each query. All samples have the same columns.

    Returns:
        The weight of each column; the mean negative logarithm of the probability of the true place if all hypotheses
        are equally probable; and the same mean with the fitted weights.

    Raises:
        DataError: No sample has a hypothesis for the true place.
    """
    from scipy.optimize import minimize

    usable = [(evidence, np.array(evidence.places) == place) for evidence, place in samples if place in evidence.places]
    if not usable:
        raise DataError(
            f"none of the {len(samples)} answers to the tuning data contains the true place of its query, expected at "
            "least one: use tuning data whose maps contain the places of the queries"
        )
    names = list(usable[0][0].values)
    columns = [(np.column_stack([evidence.values[name] for name in names]), is_true) for evidence, is_true in usable]
    spread = np.concatenate([values - values.mean(0) for values, _ in columns]).std(0)
    scale = np.where(spread > 0, spread, 1.0)
    scaled = [(values / scale, is_true) for values, is_true in columns]

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        total, slope = 0.0, np.zeros(len(weights))
        for values, is_true in scaled:
            score = values @ weights
            share, of_true = (np.exp(part - np.logaddexp.reduce(part)) for part in (score, score[is_true]))
            total += np.logaddexp.reduce(score) - np.logaddexp.reduce(score[is_true])
            slope += share @ values - of_true @ values[is_true]
        return total / len(scaled) + RIDGE * weights @ weights, slope / len(scaled) + 2 * RIDGE * weights

    start = np.zeros(len(scale))
    result = minimize(loss, start, jac=True, method="L-BFGS-B", options={"gtol": 1e-8})
    after = loss(result.x)[0] - RIDGE * result.x @ result.x
    weights = dict(zip(names, (result.x / scale).tolist(), strict=True))
    return weights, float(loss(start)[0]), float(after)
