"""What tells the places of a map apart, in parts, and the weights of these parts, fitted on tuning data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.framework.errors import DataError

RIDGE = 1e-3
"""Weight of the squared weights, per answer and in units of a part's spread: without it parts that tell the places
apart without an error have no best weights."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """H hypotheses of where a query was taken, several of which may name one place: places, H names; values (H, F)
    float64, a column each of what speaks for them."""

    places: Sequence[str]
    values: np.ndarray

    def scores(self, weights: np.ndarray) -> dict[str, float]:
        """The score of each place, of weights (F,): the logarithm of the summed exponentials of its hypotheses."""
        found: dict[str, float] = {}
        for place, score in zip(self.places, (self.values @ weights).tolist(), strict=True):
            found[place] = float(np.logaddexp(found[place], score)) if place in found else score
        return found


def fit_weights(asked: Sequence[tuple[Evidence, str]]) -> tuple[np.ndarray, float, float]:
    """Weights (F,) with which the softmax over the hypotheses of each query gives the true place most (maximal
    likelihood, with a ridge), and the mean negative logarithm of its share with all hypotheses alike and with these.

    asked: evidence, and the query's place; queries whose place no hypothesis names are left out. Raises DataError where
    none is left.
    """
    from scipy.optimize import minimize

    known = [(one.values, np.array(one.places) == place) for one, place in asked if place in one.places]
    if not known:
        raise DataError(f"received {len(asked)} answers, none of which ranks the query's place, expected some")
    spread = np.concatenate([values - values.mean(0) for values, _ in known]).std(0)
    scale = np.where(spread > 0, spread, 1.0)
    plain = [(values / scale, true) for values, true in known]

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        total, slope = 0.0, np.zeros(len(weights))
        for values, true in plain:
            score = values @ weights
            share, of_true = (np.exp(part - np.logaddexp.reduce(part)) for part in (score, score[true]))
            total += np.logaddexp.reduce(score) - np.logaddexp.reduce(score[true])
            slope += share @ values - of_true @ values[true]
        return total / len(plain) + RIDGE * weights @ weights, slope / len(plain) + 2 * RIDGE * weights

    start = np.zeros(len(scale))
    found = minimize(loss, start, jac=True, method="L-BFGS-B", options={"gtol": 1e-8})
    after = loss(found.x)[0] - RIDGE * found.x @ found.x
    return found.x / scale, float(loss(start)[0]), float(after)
