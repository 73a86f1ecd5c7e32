"""Calibrate the out-of-map probability with the reference frames of a map (docs/explanation/calibration.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError
from salframe.framework.validation import Settings
from salframe.localization.answers import Localization
from salframe.localization.hidden_frames import FrameAnswers, localize_frames
from salframe.localization.localizer import Description, Localizer
from salframe.localization.posterior import EvidenceTerm, Head, Posterior, absent_moments, log_loss, shift_probability
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import ReferenceFrame

ABSENT_PRIOR = 10.0
"""Weight of the mean and the deviation of the fitted posterior, as an equivalent number of out-of-map answers."""
ACCURACY_PRIOR = 4.0
"""Weight of the accuracy of the fitted posterior, as an equivalent number of answers."""
DISTANCE_EXPONENT = 0.3
"""The share of correct answers is proportional to d ** -DISTANCE_EXPONENT, with d the distance to the nearest reference
frame. Fitted on tuning data: ten buildings at half of their viewpoints, and `house-42` with the errors of two
detectors."""
FITTED_DISTANCE_M = 1.0
"""Distance in metres to the nearest reference frame at which the accuracy of a fitted posterior is valid: about the
mean distance in the tuning data."""
ACCURACY_LIMITS = (0.01, 0.99)
"""Minimum and maximum accuracy of a calibrated `Head`."""
BIAS_DEVIATION = 2.0
"""Standard deviation of the normal prior of the change of the bias. Like DISTANCE_SPREAD, it was fitted on the tuning
data of DISTANCE_EXPONENT."""
DISTANCE_SPREAD = 0.5
"""A correct answer at the distance d to the nearest reference frame has the weight exp(-x^2 / 2) in the change of the
bias, with x = ln(d / query_distance_m) / DISTANCE_SPREAD. Answers at other distances than those of queries have little
weight, because the contrast depends on the distance."""
MAX_BIAS_CHANGE = 4.0
"""Maximum magnitude of the change of the bias."""
REJECTED_SHARE = 0.05
"""Share of the correct answers below the estimated `min_log_ratio`. Like REJECTION_PRIOR, it was chosen on the ten real
buildings for tuning. The goal was that at most 10 % of the correct answers and at least 82 % of the out-of-map answers
are not accepted."""
REJECTION_PRIOR = 10.0
"""Weight of the value 0 in the estimate of `min_log_ratio`, as an equivalent number of correct answers."""
LOWEST_MIN_LOG_RATIO = -float(np.log(2))
"""Lower limit of `min_log_ratio`. There, an answer is half as likely to be correct as to be an out-of-map answer."""
PROBABILITY_DIGITS = 4
"""Number of decimals of the stored probabilities. Few decimals keep maps small."""
MIN_DISTANCE_M = 0.1
"""Minimum distance between frames in metres. Smaller distances are replaced by this value."""

_Moments = TypeVar("_Moments", Head, EvidenceTerm)


class ProbabilityScores(Settings):
    """Quality of the computed probabilities that frames are in the map.

    A present frame is localized in a map that contains its place, an absent frame in a map without its place. The two
    groups have equal total weights.

    Attributes:
        log_loss: Mean negative logarithm of the probability of the truth (in the map, or not), in nats.
        brier_score: Mean squared difference between the probability and the truth (1: in the map, 0: not).
    """

    log_loss: float
    brier_score: float


class MapCalibration(Settings):
    """The calibration of a map.

    Attributes:
        head: The calibrated head of the posterior. Its means, deviations, accuracy, bias, minimum log-ratio and number
            of objects are adapted to this map.
        present_frames: Number of frames that were localized in the map without the frame, but with its place.
        absent_in_map: Probabilities of being in the map, computed by `head`, of the frames whose places were hidden;
            ascending. Their answers are the out-of-map answers.
        before: Quality of the probabilities without calibration; None if there are no present or no absent frames.
        after: Quality with calibration, cross-validated: the frames of each place are evaluated with a calibration that
            was fitted to the frames of the other places.
    """

    head: Head
    present_frames: int = Field(ge=0)
    absent_in_map: tuple[float, ...]
    before: ProbabilityScores | None = None
    after: ProbabilityScores | None = None

    def max_out_of_map_probability(self, max_false_accept: float) -> float:
        """Return the maximum out-of-map probability at which an answer passes the conformal test.

        The p-value of an answer is (1 + k) / (1 + n) (Vovk, Gammerman, Shafer: Algorithmic Learning in a Random World,
        2005, section 2.2). n is the number of answers in `absent_in_map`: those of hidden frames, that is, of reference
        frames that were localized in the map without their place. k is the number of these answers whose probability of
        being in the map is at least the probability of the answer. An answer passes the test if its p-value is at most
        `max_false_accept`. If out-of-map queries are exchangeable with the hidden frames, at most a share
        `max_false_accept` of the out-of-map queries passes.

        Raises:
            DataError: There are fewer than 1 / max_false_accept out-of-map answers.
        """
        count = len(self.absent_in_map)
        if count * max_false_accept < 1:
            raise DataError(
                f"max_false_accept is {max_false_accept:g}, which needs at least "
                f"{np.ceil(1 / max_false_accept):.0f} calibration frames (reference frames that were localized while "
                f"the map did not contain their place), but the map has {count}: increase max_false_accept, or add "
                "places to the map"
            )
        num_above = int(np.floor(max_false_accept * (count + 1) + 1e-9)) - 1
        limit = 1 - self.absent_in_map[count - 1 - num_above]
        return float(np.nextafter(limit, 0))


def add_probabilities(
    answer: Localization, posterior: Posterior, calibration: MapCalibration | None, objects: int
) -> Localization:
    """Return an answer with the probabilities that a posterior computes.

    Args:
        answer: The answer without probabilities.
        posterior: The posterior.
        calibration: The calibration of the map, whose head replaces the head of the posterior; None: not calibrated.
        objects: Number of objects of the query; 0: unknown.

    Raises:
        DataError: As in `acceptance_limit`.
    """
    limit = acceptance_limit(posterior, calibration)
    if calibration is not None:
        posterior = posterior.model_copy(update={"head": calibration.head})
    return posterior.apply(answer, objects, limit)


def acceptance_limit(posterior: Posterior, calibration: MapCalibration | None) -> float:
    """Return the maximum out-of-map probability that the conformal test permits for an accepted answer; 1 if the
    posterior has no `max_false_accept`.

    Raises:
        DataError: The posterior has a `max_false_accept`, and the map is not calibrated or has too few frames.
    """
    level = posterior.max_false_accept
    if level is None:
        return 1.0
    if calibration is None:
        raise DataError(
            f"max_false_accept is {level:g}, but the map is not calibrated: run `salframe map calibrate MAP`, or omit "
            "max_false_accept"
        )
    return calibration.max_out_of_map_probability(level)


OTHER_CALIBRATION = (
    "the probabilities are not calibrated, because the map was calibrated with other settings or by another version of "
    "the method: run `salframe map calibrate MAP`, or build the map with the new settings"
)
"""Note of answers in a map whose calibration does not apply."""


def is_calibrated(localizer: Localizer) -> bool:
    """Return whether the maps of a localizer are calibrated. This requires a posterior whose setting `calibrate` is
    true."""
    return localizer.posterior is not None and localizer.posterior.calibrate


def calibrate_posterior(
    localizer: Localizer,
    descriptions: Sequence[Description],
    frames: Sequence[ReferenceFrame],
    floors: Sequence[FloorMasks],
) -> MapCalibration:
    """Calibrate the posterior of a localizer with the reference frames of a map.

    Some reference frames are hidden (removed from the map) and localized as queries. The localizer indexes the other
    frames at most PLACE_GROUPS times without whole places, and at most MAX_FRAMES_OF_PLACE times without single frames.
    Call its `index` for the whole map afterwards.

    Args:
        localizer: A localizer with a posterior.
        descriptions: The descriptions of the reference frames.
        frames: The reference frames.
        floors: Floors of the map.

    Raises:
        DataError: The localizer has no posterior.
    """
    posterior = localizer.posterior
    if posterior is None:
        raise DataError(
            f"the answers of the method {localizer.name!r} have no probabilities to calibrate: use another method, "
            "such as 'proposed', or set `posterior` to a file that `salframe fit` wrote"
        )
    answers = localize_frames(localizer, posterior, descriptions, frames, floors)
    head = calibrate_head(posterior, answers)
    absent = np.sort(answers.take(answers.is_absent).in_map(head))
    before, after = _cross_validate(posterior, answers)
    return MapCalibration(
        head=head,
        present_frames=int((~answers.is_absent).sum()),
        absent_in_map=tuple(absent.round(PROBABILITY_DIGITS).tolist()),
        before=before,
        after=after,
    )


def calibrate_head(posterior: Posterior, answers: FrameAnswers) -> Head:
    """Return the head of a posterior calibrated for a map, from the answers to frames of this map.

    The number of objects is the mean over the frames. The means and the deviations of the contrast and of the columns
    of evidence are computed from the absent frames. They are averaged with the values of the posterior, which have the
    weight of ABSENT_PRIOR answers. The accuracy is computed from the present frames, for the distance
    `query_distance_m`. The accuracy of the posterior has the weight of ACCURACY_PRIOR answers at FITTED_DISTANCE_M. The
    bias is changed by `_bias_change`, and `_min_log_ratio` sets the minimum log-ratio of an accepted answer.
    """
    head = posterior.head
    if head.objects and answers.objects.any():
        head = head.model_copy(update={"objects": float(answers.objects[answers.objects > 0].mean())})
    absent, present = answers.take(answers.is_absent), answers.take(~answers.is_absent)
    nu = head.relative_objects(absent.objects)
    terms = {
        name: _adapt_moments(term, absent.evidence[name], nu) if name in absent.evidence else term
        for name, term in head.evidence.items()
    }
    accuracy = _accuracy(present, head, posterior.query_distance_m)
    head = _adapt_moments(head, absent.contrast, nu).model_copy(update={"evidence": terms, "accuracy": accuracy})
    right = present.take(present.is_right)
    weight = _similarity_to_queries(right.distance_m, posterior.query_distance_m)
    head = head.model_copy(update={"bias": head.bias + _bias_change(right, weight, absent, head)})
    return head.model_copy(update={"min_log_ratio": _min_log_ratio(right.log_ratio(head), weight)})


def _adapt_moments(model: _Moments, value: np.ndarray, nu: np.ndarray) -> _Moments:
    """Return a head or a term whose mean and deviation are adapted to the values (N,) of absent answers; NaN: unknown.
    `nu` (N,) is described in `Head`."""
    known = np.isfinite(value)
    count = int(known.sum())
    if not count:
        return model
    map_mean, map_deviation = absent_moments(value[known], nu[known], model.mean_effect, model.deviation_effect)
    map_share = count / (count + ABSENT_PRIOR)
    mean = model.absent_mean + map_share * (map_mean - model.absent_mean)
    variance = map_share * map_deviation**2 + (1 - map_share) * model.absent_deviation**2
    return model.model_copy(update={"absent_mean": mean, "absent_deviation": float(np.sqrt(variance))})


def _similarity_to_queries(distance_m: np.ndarray, query_distance_m: float) -> np.ndarray:
    """Return the weights (N,) of answers at these distances (N,) to the nearest frame; see DISTANCE_SPREAD."""
    x = np.log(np.maximum(distance_m, MIN_DISTANCE_M) / query_distance_m) / DISTANCE_SPREAD
    return np.asarray(np.exp(-(x**2) / 2))


def _min_log_ratio(log_ratio: np.ndarray, weight: np.ndarray) -> float:
    """Return the minimum log-ratio of an accepted answer, between LOWEST_MIN_LOG_RATIO and 0.

    It is the log-ratio below which the share REJECTED_SHARE of the correct answers lies, averaged with 0
    (REJECTION_PRIOR). It is thus 0 if at most this share has a log-ratio below 0.

    Args:
        log_ratio: (N,) log-ratios of the correct answers.
        weight: (N,) weights of these answers.
    """
    total = float(weight.sum())
    if not total:
        return 0.0
    order = np.argsort(log_ratio)
    rank = np.searchsorted(np.cumsum(weight[order]), REJECTED_SHARE * total)
    estimate = float(log_ratio[order][rank]) * total / (total + REJECTION_PRIOR)
    return float(np.clip(estimate, LOWEST_MIN_LOG_RATIO, 0))


def _bias_change(right: FrameAnswers, weight: np.ndarray, absent: FrameAnswers, head: Head) -> float:
    """Return the change of the bias, estimated by maximum a posteriori.

    With the change, the log-ratio of the head separates the correct answers to present frames from the answers to
    absent frames by logistic regression. The correct answers have the weights (N,) `weight`, and the absent answers
    have the same total weight. The change is 0 if all present frames are much farther from each other than queries are
    from frames.
    """
    from scipy.optimize import minimize_scalar

    if not len(right.contrast) or not len(absent.contrast):
        return 0.0
    right_ratio, absent_ratio = right.log_ratio(head), absent.log_ratio(head)

    def loss(change: float) -> float:
        of_right = float(weight @ np.logaddexp(0, -right_ratio - change))
        of_absent = float(weight.sum() * np.logaddexp(0, absent_ratio + change).mean())
        return of_right + of_absent + (change / BIAS_DEVIATION) ** 2 / 2

    return float(minimize_scalar(loss, bounds=(-MAX_BIAS_CHANGE, MAX_BIAS_CHANGE), method="bounded").x)


def _accuracy(present: FrameAnswers, head: Head, query_distance_m: float) -> float:
    """Return the share of correct answers at the distance `query_distance_m`, estimated by maximum a posteriori."""
    from scipy.optimize import minimize_scalar

    low, high = ACCURACY_LIMITS
    factor = _distance_factor(np.maximum(present.distance_m, MIN_DISTANCE_M))
    shift = head.accuracy_effect * head.relative_objects(present.objects)

    def loss(accuracy: float) -> float:
        probability = shift_probability(np.minimum(accuracy * factor, high), shift)
        prior = head.accuracy * np.log(accuracy) + (1 - head.accuracy) * np.log(1 - accuracy)
        return log_loss(probability, present.is_right) * len(probability) - ACCURACY_PRIOR * float(prior)

    fitted = float(minimize_scalar(loss, bounds=(low, high), method="bounded").x) if len(factor) else head.accuracy
    return float(np.clip(fitted * _distance_factor(query_distance_m), low, high))


def _distance_factor(distance_m: np.ndarray | float) -> np.ndarray:
    """Return the expected share of correct answers at this distance of the query from the nearest reference frame of
    its place, relative to the share at FITTED_DISTANCE_M."""
    return np.asarray((distance_m / FITTED_DISTANCE_M) ** -DISTANCE_EXPONENT)


def _cross_validate(
    posterior: Posterior, answers: FrameAnswers
) -> tuple[ProbabilityScores, ProbabilityScores] | tuple[None, None]:
    """Return the quality of the probabilities without calibration, and with a calibration that uses only the frames of
    other places; (None, None) if there are no present or no absent frames."""
    if answers.is_absent.all() or not answers.is_absent.any():
        return None, None
    after = np.empty(len(answers.contrast))
    for place in np.unique(answers.place):
        is_held_out = answers.place == place
        head = calibrate_head(posterior, answers.take(~is_held_out))
        after[is_held_out] = answers.take(is_held_out).in_map(head)
    return _scores(answers.in_map(posterior.head), answers), _scores(after, answers)


def _scores(in_map: np.ndarray, answers: FrameAnswers) -> ProbabilityScores:
    sides = [(in_map[rows], 1.0 - answers.is_absent[rows]) for rows in (answers.is_absent, ~answers.is_absent)]
    return ProbabilityScores(
        log_loss=float(np.mean([log_loss(probability, outcome) for probability, outcome in sides])),
        brier_score=float(np.mean([((probability - outcome) ** 2).mean() for probability, outcome in sides])),
    )
