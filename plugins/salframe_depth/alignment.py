"""Estimation of the scale and the shift of the depth of each view, from the overlaps of views."""

from __future__ import annotations

from itertools import combinations

import numpy as np

ROUNDS = 10
"""Number of reweighting iterations; the weights have converged by then."""
MIN_OVERLAP = 20
"""Minimum number of common rays of two views. Views with fewer are not compared."""
OUTLIER = 2.0
"""Residual, in units of sigma (1.48 medians), beyond which weights decrease. Residuals at depth edges are larger."""
RIDGE = 1e-9
"""Strength of the prior (scale 1, shift 0) relative to the mean curvature. The prior determines the coefficients that
overlaps do not determine. The prior is far weaker than the overlaps."""

TINY = 1e-9
"""Lower bound of divisors, for networks that return 0 everywhere or agree exactly."""


def align(terms: np.ndarray) -> np.ndarray:
    """Estimate the coefficients with which V views agree on P rays of the sphere.

    The value of view v at ray p is the sum over k of coefficient[v, k] * terms[v, p, k]. The relative differences
    between views are minimised by least squares. Cauchy weights reduce the influence of depth edges.

    Args:
        terms: Terms (V, P, K), NaN where the view does not show the ray.

    Returns:
        Coefficients (V, K) float64. The mean of the first coefficients [:, 0] is 1.
    """
    count, _, size = terms.shape
    known = np.isfinite(terms).all(-1)
    pairs = []
    for pair in combinations(range(count), 2):
        both = np.flatnonzero(known[list(pair)].all(0))
        if len(both) >= MIN_OVERLAP:
            pairs.append((list(pair), terms[pair[0], both], terms[pair[1], both]))
    coefficients = np.zeros((count, size))
    coefficients[:, 0] = 1
    for _ in range(ROUNDS if pairs else 0):
        values = [((a * coefficients[u]).sum(1), (b * coefficients[v]).sum(1)) for (u, v), a, b in pairs]
        # Values may be close to 0 or negative while shifts are not yet correct.
        typical = np.median(np.abs(np.concatenate([x + y for x, y in values]) / 2))
        scales = [np.maximum(np.abs(x + y) / 2, max(typical / 4, TINY)) for x, y in values]
        residuals = [(x - y) / scale for (x, y), scale in zip(values, scales, strict=True)]
        sigma = 1.48 * np.median(np.abs(np.concatenate(residuals)))
        weight = [
            1 / scale**2 / (1 + (residual / (OUTLIER * sigma + TINY)) ** 2)
            for scale, residual in zip(scales, residuals, strict=True)
        ]
        coefficients = _solve(pairs, weight, count, size)
    return coefficients


def _solve(pairs: list, weights: list[np.ndarray], count: int, size: int) -> np.ndarray:
    """Return the coefficients (V, K) that minimise the weighted squared differences. The mean of [:, 0] is 1."""
    normal = np.zeros((count, size, count, size))
    for (views, terms_a, terms_b), weight in zip(pairs, weights, strict=True):
        row = np.stack([terms_a, -terms_b], 1).reshape(len(terms_a), -1)
        normal[np.ix_(views, range(size), views, range(size))] += ((row * weight[:, None]).T @ row).reshape(
            2, size, 2, size
        )
    first = np.zeros((count, size))
    first[:, 0] = 1
    curvature, prior = normal.reshape(count * size, -1), first.ravel()
    ridge = max(RIDGE * np.trace(curvature) / len(curvature), TINY)
    # Two right-hand sides: the prior, and the multiplier that constrains the mean of the first coefficients to 1.
    prior_solution, mean_solution = np.linalg.solve(
        curvature + ridge * np.eye(len(curvature)), np.stack([ridge * prior, prior], 1)
    ).T
    return (prior_solution + mean_solution * (count - prior_solution @ prior) / (mean_solution @ prior)).reshape(
        count, size
    )
