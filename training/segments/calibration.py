"""Calibration of scores: the logistic fit of `Calibration` in a model card, and its cross-validation over views."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

EDGES = (0.0, 0.3, 0.5, 0.7, 0.85, 1.0)
"""Edges of the bins of a calibration curve."""
RESAMPLES = 2000
"""Number of bootstrap samples."""


def logit(p: np.ndarray) -> np.ndarray:
    """Return the logit of probabilities, clipped like in `Calibration.score`."""
    p = np.clip(p, 1e-6, 1 - 1e-6)
    return np.log(p / (1 - p))


def fit(p: np.ndarray, right: np.ndarray) -> tuple[float, float]:
    """Fit slope and offset of a logistic calibration by maximum likelihood.

    Args:
        p: (n,) mean probabilities of objects.
        right: (n,) bool, whether the label of each is correct.
    """
    from scipy.optimize import minimize

    x = logit(p)

    def loss(parameters: np.ndarray) -> float:
        z = parameters[0] * x + parameters[1]
        return float(np.logaddexp(0, np.where(right, -z, z)).sum())

    slope, offset = minimize(loss, (1.0, 0.0), bounds=((0.05, 5.0), (-5.0, 5.0))).x
    return float(slope), float(offset)


def apply(p: np.ndarray, slope: float, offset: float) -> np.ndarray:
    """Return calibrated scores: a logistic function of the log-odds of the scores `p`."""
    return 1 / (1 + np.exp(-slope * logit(p) - offset))


def undo(scores: np.ndarray, slope: float, offset: float) -> np.ndarray:
    """Return the scores without calibration: the inverse of `apply`."""
    return apply(scores, 1 / slope, -offset / slope)


def left_out_scores(p: Sequence[np.ndarray], right: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the scores of the objects of each view with a calibration that is fitted on the other views."""
    scores = []
    for i in range(len(p)):
        others = [j for j in range(len(p)) if j != i]
        fitted = fit(np.concatenate([p[j] for j in others]), np.concatenate([right[j] for j in others]))
        scores.append(apply(p[i], *fitted))
    return scores


def brier(scores: Sequence[np.ndarray], right: Sequence[np.ndarray]) -> float:
    """Return the Brier score, the mean squared difference of score and truth."""
    return float(((np.concatenate(scores) - np.concatenate(right)) ** 2).mean())


def curve(scores: Sequence[np.ndarray], right: Sequence[np.ndarray]) -> list[dict[str, float]]:
    """Return the bins of a calibration curve.

    Each bin has the number of objects, their mean score, the share with a correct label, and its 95 % CI (bootstrap
    over views).
    """
    rows = []
    for low, high in pairwise(EDGES):
        inside = [(view >= low) & (view < high + (high == 1)) for view in scores]
        number = np.array([mask.sum() for mask in inside])
        named = np.array([truth[mask].sum() for truth, mask in zip(right, inside, strict=True)])
        if number.sum():
            mean = np.concatenate([view[mask] for view, mask in zip(scores, inside, strict=True)]).mean()
            lower, upper = interval(named, number)
            share = named.sum() / number.sum()
            rows.append({"objects": int(number.sum()), "score": mean, "named": share, "low": lower, "high": upper})
    return rows


def interval(right: np.ndarray, number: np.ndarray) -> tuple[float, float]:
    """Return the 95 % CI of sum(right) / sum(number), by a bootstrap over views (V,)."""
    drawn = np.random.default_rng(0).integers(0, len(right), (RESAMPLES, len(right)))
    total = number[drawn].sum(1)
    share = right[drawn].sum(1)[total > 0] / total[total > 0]
    low, high = np.percentile(share, (2.5, 97.5))
    return float(low), float(high)
