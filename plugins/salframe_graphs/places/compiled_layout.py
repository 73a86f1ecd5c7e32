"""Query, index and rates laid out for what is compiled, in arrays of one type and order: for others it would be
compiled again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from salframe_graphs.places import hypotheses
from salframe_graphs.places import likelihood as scoring
from salframe_graphs.places.place_index import PlaceIndex, QueryObjects
from salframe_graphs.places.rates import Likelihood, Rates

X, Y, VARIANCE, FOUND, Z, LENGTH, HEIGHT = range(7)
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
    """Of PlaceIndex what is searched: size (K,), how many objects each place has, label (K, m), cameras_m (K, F, 2),
    and of (K, 7, m), a row each: x, y, variance, found_logit, height, log length and log box height."""

    size: np.ndarray
    label: np.ndarray
    cameras_m: np.ndarray
    of: np.ndarray


class Numbers(NamedTuple):
    """Of Rates and Likelihood what is searched with, of clutter and area the logarithms. Constants of other modules are
    handed over: what is kept compiled does not see them change."""

    position_variance: float
    per_distance: float
    clutter: float
    area: float
    unplaced_share: float
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
    look = index.z_m, index.log_size[..., 0], index.log_size[..., 2]
    of = np.stack([*np.moveaxis(index.xy_m, 2, 0), index.variance_m2, index.found_logit, *look], 1, dtype=np.float64)
    return Searched(index.size, np.array(index.label, order="C"), np.array(index.cameras_m, order="C"), of)


def asked(query: QueryObjects, index: PlaceIndex, rates: Rates, taken: Likelihood) -> Asked:
    """A query laid out."""
    variance = np.empty((len(query), 3))
    variance[:, 0] = 2 * (rates.height_error_m**2 + (rates.range_error_share * query.z_m) ** 2)
    variance[:, 1:] = 2 * rates.length_error_log**2, 2 * rates.box_height_error_log**2
    span = np.array([taken.height_span_m, taken.size_span_log, taken.size_span_log])
    sure = np.log(np.maximum(query.score, scoring.LEAST_SCORE))
    alike = sure + np.log(span / np.sqrt(2 * np.pi * variance)).sum(1)
    return Asked(
        query.label,
        np.array(query.xy_m),
        query.ray,
        np.column_stack([query.z_m, query.log_size[:, 0], query.log_size[:, 2]]),
        -0.5 / variance,
        alike + np.log(rates.label_agreement / index.frequency[query.label]),
        alike + np.log(1 - rates.label_agreement),
        (rates.range_error_share * query.range_m) ** 2,
    )


def numbers(rates: Rates, taken: Likelihood) -> Numbers:
    """Rates and what is taken for granted."""
    return Numbers(
        rates.position_error_m**2,
        rates.found_per_distance,
        float(np.log(rates.clutter)),
        float(np.log(taken.area_m2 / (2 * np.pi))),
        taken.unplaced_share,
    )
