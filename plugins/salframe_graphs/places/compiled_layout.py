"""Query, index and rates laid out for what is compiled, in arrays of one type and order: for others it would be
compiled again."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from salframe_graphs.places import hypotheses
from salframe_graphs.places import likelihood as scoring
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.rates import Likelihood, Rates

X, Y, VARIANCE, FOUND = range(4)
"""The rows of Searched.of."""


class Asked(NamedTuple):
    """A query's n objects: label (n,); xy_m, ray (n, 2); look (n, 3), height, log length and log box height, and
    sharpness (n, 3), -0.5 / the variance of what these are off by; known, unknown (n,), the log ratio of an object that
    looks alike and bears this label or another; range_variance (n,)."""

    label: np.ndarray
    xy_m: np.ndarray
    ray: np.ndarray
    look: np.ndarray
    sharpness: np.ndarray
    known: np.ndarray
    unknown: np.ndarray
    range_variance: np.ndarray


class Searched(NamedTuple):
    """Of PlaceIndex what is searched: size (K,), how many objects each place has, label (K, m), cameras_m (K, F, 2), of
    (K, 4, m), x, y, variance and found_logit, and in single precision look (K, 3, m), as of Asked."""

    size: np.ndarray
    label: np.ndarray
    cameras_m: np.ndarray
    of: np.ndarray
    look: np.ndarray


class Numbers(NamedTuple):
    """Of Rates and Likelihood what is searched with, of clutter and area the logarithms. Constants of other modules are
    handed over: what is kept compiled does not see them change."""

    position_variance: float
    per_distance: float
    clutter: float
    area: float
    unplaced_share: float
    label_agreement: float
    range_error_share: float
    height_error_m: float
    length_error_log: float
    box_height_error_log: float
    height_span_m: float
    size_span_log: float
    least_score: float = scoring.LEAST_SCORE
    nearest_m: float = scoring.NEAREST_M
    reference_m: float = scoring.REFERENCE_M
    most_logit: float = scoring.MOST_LOGIT
    most_log: float = scoring.MOST_LOG
    far_nats: float = scoring.FAR_NATS
    steps: int = scoring.STEPS
    most_pairs: int = hypotheses.MOST_PAIRS
    most_hypotheses: int = hypotheses.MOST_HYPOTHESES
    least_alike: float = hypotheses.LEAST_ALIKE
    least_base_m: float = hypotheses.LEAST_BASE_M
    longest_base_m: float = hypotheses.LONGEST_BASE_M
    base_worth: float = hypotheses.BASE_WORTH
    largest_shift_m: float = hypotheses.LARGEST_SHIFT_M
    slack_sigmas: float = hypotheses.SLACK_SIGMAS


def searched(index: PlaceIndex) -> Searched:
    """An index laid out."""
    of = np.stack([*np.moveaxis(index.xy_m, 2, 0), index.variance_m2, index.found_logit], 1, dtype=np.float64)
    looks = index.z_m, index.log_size[..., 0], index.log_size[..., 2]
    look = np.stack(looks, 1).astype(np.float32)
    return Searched(index.size, np.array(index.label, order="C"), np.array(index.cameras_m, order="C"), of, look)


@numba.njit(nogil=True, error_model="numpy")
def asked(query, frequency, numbers):  # type: ignore[no-untyped-def]
    """A query laid out: label, xy_m, z_m, range_m, ray, log_size and score of QueryObjects, beside the frequency of
    PlaceIndex."""
    label, xy_m, z_m, range_m, ray, log_size, score = query
    look, sharpness = np.empty((len(label), 3)), np.empty((len(label), 3))
    known, unknown, range_variance = np.empty(len(label)), np.empty(len(label)), np.empty(len(label))
    span = numbers.height_span_m, numbers.size_span_log, numbers.size_span_log
    for i in range(len(label)):
        look[i, 0], look[i, 1], look[i, 2] = z_m[i], log_size[i, 0], log_size[i, 2]
        height_variance = numbers.height_error_m**2 + (numbers.range_error_share * z_m[i]) ** 2
        variance = 2 * height_variance, 2 * numbers.length_error_log**2, 2 * numbers.box_height_error_log**2
        alike = np.log(max(score[i], numbers.least_score))
        for part in range(3):
            sharpness[i, part] = -0.5 / variance[part]
            alike += np.log(span[part] / np.sqrt(2 * np.pi * variance[part]))
        known[i] = alike + np.log(numbers.label_agreement / frequency[label[i]])
        unknown[i] = alike + np.log(1 - numbers.label_agreement)
        range_variance[i] = (numbers.range_error_share * range_m[i]) ** 2
    return Asked(label, xy_m, ray, look, sharpness, known, unknown, range_variance)


def numbers(rates: Rates, taken: Likelihood) -> Numbers:
    """Rates and what is taken for granted."""
    return Numbers(
        rates.position_error_m**2,
        rates.found_per_distance,
        float(np.log(rates.clutter)),
        float(np.log(taken.area_m2 / (2 * np.pi))),
        taken.unplaced_share,
        rates.label_agreement,
        rates.range_error_share,
        rates.height_error_m,
        rates.length_error_log,
        rates.box_height_error_log,
        taken.height_span_m,
        taken.size_span_log,
    )
