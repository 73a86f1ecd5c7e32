"""What tells the places of a map apart, as named columns, and the weights of these columns, fitted on tuning data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from salframe.framework.errors import DataError

RIDGE = 1e-3
"""Weight of the squared weights, per answer and in units of a column's spread: without it columns that tell the places
apart without an error have no best weights."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """H hypotheses of where a query was taken, several of which may name the same place.

    places: H names. values: (H,) float64 for each named column, larger where it supports a hypothesis more.
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
        """Return the score of each place: the logarithm of the summed exponentials of its hypotheses."""
        scores: dict[str, float] = {}
        for place, score in zip(self.places, self.scores(weights).tolist(), strict=True):
            scores[place] = float(np.logaddexp(scores[place], score)) if place in scores else score
        return scores


def fit_weights(samples: Sequence[tuple[Evidence, str]]) -> tuple[dict[str, float], float, float]:
    """Fit the weights that maximize the softmax probability of the true place.

    Maximum likelihood with a ridge. Samples whose place no hypothesis names are left out.

    Args:
        samples: the evidence of each query, and the query's place. All have the same columns.

    Returns:
        The weight of each column, and the mean negative logarithm of the true place's share with equal hypotheses and
        with these weights.

    Raises:
        DataError: no sample is left.
    """
    from scipy.optimize import minimize

    known = [(one, np.array(one.places) == place) for one, place in samples if place in one.places]
    if not known:
        raise DataError(f"received {len(samples)} answers, none of which ranks the query's place, expected some")
    names = list(known[0][0].values)
    columns = [(np.column_stack([one.values[name] for name in names]), is_true) for one, is_true in known]
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
