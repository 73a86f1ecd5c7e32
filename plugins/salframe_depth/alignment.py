"""Scale and shift of each view's depth, by what overlapping views show alike."""

from __future__ import annotations

from itertools import combinations

import numpy as np

ROUNDS = 10
"""Rounds of reweighting; the weights have settled by then."""
MIN_OVERLAP = 20
"""Views that share fewer known rays are not compared."""
OUTLIER = 2.0
"""Residuals beyond so many times the usual (1.48 medians) count less and less, as those at depth edges do."""
RIDGE = 1e-9
"""Draws views that overlap no other, and shifts that overlaps leave open, to scale 1 and shift 0: a share of the mean
curvature, far below what overlaps tell."""

TINY = 1e-9
"""Stands for 0 where networks say 0 everywhere, or agree to the last digit."""


def align(terms: np.ndarray) -> np.ndarray:
    """(V, K) float64 coefficients that bring V views to agree at P rays of the sphere; the first have a mean of 1.

    terms (V, P, K): what view v says of ray p is the sum over k of coefficient[v, k] * terms[v, p, k], NaN where the
    view does not show it. Least squares of relative differences between the views, with Cauchy weights against depth
    edges.
    """
    count, _, size = terms.shape
    known = np.isfinite(terms).all(-1)
    pairs = []
    for pair in combinations(range(count), 2):
        both = np.flatnonzero(known[list(pair)].all(0))
        if len(both) >= MIN_OVERLAP:
            pairs.append((list(pair), terms[pair[0], both], terms[pair[1], both]))
    found = np.zeros((count, size))
    found[:, 0] = 1
    for _ in range(ROUNDS if pairs else 0):
        said = [((a * found[u]).sum(1), (b * found[v]).sum(1)) for (u, v), a, b in pairs]
        # What is said may be close to 0, or less, while shifts are still off.
        typical = np.median(np.abs(np.concatenate([x + y for x, y in said]) / 2))
        level = [np.maximum(np.abs(x + y) / 2, max(typical / 4, TINY)) for x, y in said]
        off = [(x - y) / most for (x, y), most in zip(said, level, strict=True)]
        usual = 1.48 * np.median(np.abs(np.concatenate(off)))
        weight = [1 / most**2 / (1 + (o / (OUTLIER * usual + TINY)) ** 2) for most, o in zip(level, off, strict=True)]
        found = _solve(pairs, weight, count, size)
    return found


def _solve(pairs: list, weights: list[np.ndarray], count: int, size: int) -> np.ndarray:
    """(V, K) coefficients of the least weighted squares of the differences, the first with a mean of 1."""
    normal = np.zeros((count, size, count, size))
    for (views, one, other), weight in zip(pairs, weights, strict=True):
        row = np.stack([one, -other], 1).reshape(len(one), -1)
        normal[np.ix_(views, range(size), views, range(size))] += ((row * weight[:, None]).T @ row).reshape(
            2, size, 2, size
        )
    first = np.zeros((count, size))
    first[:, 0] = 1
    curvature, prior = normal.reshape(count * size, -1), first.ravel()
    ridge = max(RIDGE * np.trace(curvature) / len(curvature), TINY)
    # Two right-hand sides: the prior's pull, and the multiplier that holds the mean of the first coefficients at 1.
    pulled, lifted = np.linalg.solve(curvature + ridge * np.eye(len(curvature)), np.stack([ridge * prior, prior], 1)).T
    return (pulled + lifted * (count - pulled @ prior) / (lifted @ prior)).reshape(count, size)
