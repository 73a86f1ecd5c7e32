"""What a score is worth: the logistic fit of `Calibration` in a model card, and how well it does on views left out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

EDGES = (0.0, 0.3, 0.5, 0.7, 0.85, 1.0)
"""Of the bins of a calibration curve."""
RESAMPLES = 2000


def logit(p: np.ndarray) -> np.ndarray:
    """Of probabilities, kept off 0 and 1 as `Calibration.score` does."""
    p = np.clip(p, 1e-6, 1 - 1e-6)
    return np.log(p / (1 - p))


def fit(p: np.ndarray, right: np.ndarray) -> tuple[float, float]:
    """slope and offset of most likelihood: mean probabilities (n,) of objects and whether each is what it is called."""
    from scipy.optimize import minimize

    x = logit(p)

    def loss(parameters: np.ndarray) -> float:
        z = parameters[0] * x + parameters[1]
        return float(np.logaddexp(0, np.where(right, -z, z)).sum())

    slope, offset = minimize(loss, (1.0, 0.0), bounds=((0.05, 5.0), (-5.0, 5.0))).x
    return float(slope), float(offset)


def apply(p: np.ndarray, slope: float, offset: float) -> np.ndarray:
    """The scores."""
    return 1 / (1 + np.exp(-slope * logit(p) - offset))


def left_out_scores(p: Sequence[np.ndarray], right: Sequence[np.ndarray]) -> list[np.ndarray]:
    """For each view the scores of its objects by what the other views say."""
    scores = []
    for i in range(len(p)):
        others = [j for j in range(len(p)) if j != i]
        fitted = fit(np.concatenate([p[j] for j in others]), np.concatenate([right[j] for j in others]))
        scores.append(apply(p[i], *fitted))
    return scores


def brier(scores: Sequence[np.ndarray], right: Sequence[np.ndarray]) -> float:
    """The mean squared difference of score and truth."""
    return float(((np.concatenate(scores) - np.concatenate(right)) ** 2).mean())


def curve(scores: Sequence[np.ndarray], right: Sequence[np.ndarray]) -> list[dict[str, float]]:
    """Bins of scores: how many objects, their mean score, the share that is what it is called, and its 95 % interval
    (bootstrap over views)."""
    rows = []
    for low, high in pairwise(EDGES):
        inside = [(one >= low) & (one < high + (high == 1)) for one in scores]
        number = np.array([own.sum() for own in inside])
        named = np.array([truth[own].sum() for truth, own in zip(right, inside, strict=True)])
        if number.sum():
            mean = np.concatenate([one[own] for one, own in zip(scores, inside, strict=True)]).mean()
            left, top = interval(named, number)
            share = named.sum() / number.sum()
            rows.append({"objects": int(number.sum()), "score": mean, "named": share, "low": left, "high": top})
    return rows


def interval(right: np.ndarray, number: np.ndarray) -> tuple[float, float]:
    """95 % of a share, sum(right) / sum(number), with views (V,) drawn with replacement."""
    drawn = np.random.default_rng(0).integers(0, len(right), (RESAMPLES, len(right)))
    total = number[drawn].sum(1)
    share = right[drawn].sum(1)[total > 0] / total[total > 0]
    low, high = np.percentile(share, (2.5, 97.5))
    return float(low), float(high)
