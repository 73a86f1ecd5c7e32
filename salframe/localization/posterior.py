"""Convert scores of places to probabilities, including the out-of-map probability, with parameters fitted on tuning
data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.config import merge, read_yaml
from salframe.framework.errors import DataError
from salframe.framework.validation import Settings
from salframe.localization.answers import MAX_OUT_OF_MAP_PROBABILITY, Localization, LocalizationStatus, ranked_places

NUM_OTHERS = 5
"""Maximum number of places after the first whose mean score the first is compared with."""
TEMPERATURES = (1e-4, 1e4)
"""Minimum and maximum temperature, relative to the spread of the scores."""
RIDGE = 1e-3
"""Ridge penalty: factor of the squared slope of the head, per answer, in units of the spread of the contrast. Without
it, answers that can be separated without an error have no optimal slope."""
MAX_LOG_RATIO = 30.0
"""Maximum logarithm of the likelihood ratio of an answer, which keeps exponentials finite."""


class Head(Settings):
    """A model of the contrast of an answer: how much the first place exceeds the others.

    Answers to out-of-map queries, and wrong answers to queries in the map, have a contrast with the same mean and
    deviation. With z the contrast in units of these, the likelihood ratio of a right answer is
    r = exp(bias + slope z). If a is the accuracy, and queries in the map and out of it are equally frequent, the
    probability that the query is in the map is (a r + 1 - a) / (a r + 2 - a).
    """

    absent_mean: float = Field(description="mean contrast of the answers to out-of-map queries")
    absent_deviation: float = Field(
        gt=0, description="standard deviation of the contrast of the answers to out-of-map queries"
    )
    bias: float = Field(
        description="logarithm of the likelihood ratio of a right answer to an answer to an out-of-map query, at the "
        "mean contrast of the latter"
    )
    slope: float = Field(
        ge=0, description="change of this logarithm per standard deviation of the contrast of out-of-map queries"
    )
    accuracy: float = Field(
        ge=0, le=1, description="probability that the first place is the true one, if the query is in the map"
    )
    other_score: float = Field(
        description="mean score of the other places, in temperatures; the first place is compared with it where an "
        "answer has no other place"
    )

    def in_map(self, contrast: np.ndarray) -> np.ndarray:
        """Return the probability that the query is in the map, from the contrasts (N,) of answers, (N,) float64."""
        z = (contrast - self.absent_mean) / self.absent_deviation
        right = self.accuracy * np.exp(np.minimum(self.bias + self.slope * z, MAX_LOG_RATIO))
        wrong = 1 - self.accuracy
        return np.asarray((right + wrong) / (right + wrong + 1))


class Posterior(Settings):
    """A model of probabilities from scores.

    The share of a place is softmax(score / temperature) over the ranked places. The head gives the probability that the
    query is in one of them. The probability of a place is the product.
    """

    temperature: float = Field(
        gt=0, description="difference between the scores of two places at which one is e times as probable as the other"
    )
    head: Head
    max_out_of_map_probability: float = Field(
        MAX_OUT_OF_MAP_PROBABILITY,
        ge=0,
        le=1,
        description="maximum out-of-map probability of an answer; above it, the status of the answer is out-of-map",
    )
    calibrate: bool = Field(
        True, description="whether the head of a map is calibrated with the reference frames of the map"
    )
    query_distance_m: float = Field(
        1.0,
        gt=0,
        description="typical distance (m) of a query from the nearest reference frame of its place; only for the "
        "calibration",
    )
    max_false_accept: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="maximum false accept rate: accept only answers that pass a conformal test at this level, made "
        "from the reference frames of the map; null: no test",
    )

    def contrast(self, scores: np.ndarray) -> float:
        """Return the contrast of an answer: the first score minus the mean of the next NUM_OTHERS, in temperatures.

        Args:
            scores: (P,) scores of the places, best first, at least one.
        """
        others = float(np.mean(scores[1 : 1 + NUM_OTHERS])) / self.temperature if len(scores) > 1 else None
        return float(scores[0]) / self.temperature - (self.head.other_score if others is None else others)

    def apply(self, localization: Localization, limit: float = MAX_OUT_OF_MAP_PROBABILITY) -> Localization:
        """Return an answer with probabilities.

        If the out-of-map probability is larger than `max_out_of_map_probability`, the status becomes
        LocalizationStatus.OUT_OF_MAP and the pose is removed. An answer without places is returned unchanged.

        Args:
            localization: The answer.
            limit: Maximum out-of-map probability of an accepted answer.
        """
        if not localization.places:
            return localization
        frames, names, place_scores, _ = zip(*localization.places, strict=True)
        scores = np.array(place_scores, np.float64)
        in_map = float(self.head.in_map(np.array(self.contrast(scores))))
        places = ranked_places(frames, names, place_scores, (in_map * shares(scores, self.temperature)).tolist())
        known = replace(localization, places=places, out_of_map_probability=1 - in_map, max_accepted_probability=limit)
        if localization.status.names_a_place and 1 - in_map > self.max_out_of_map_probability:
            return replace(
                known, T_world_query=None, covariance=None, heading_rad=None, status=LocalizationStatus.OUT_OF_MAP
            )
        return known


def read_fitted(part: str, value: Any) -> Any:
    """Return the value of a setting whose parameters `salframe fit` computes.

    Args:
        part: Name of the mapping with the parameters in a file of `salframe fit`.
        value: The path of such a file, or a mapping of parameters. The key `kind` of a mapping names a file; the other
            keys replace parameters of the file.

    Returns:
        The mapping of parameters; another value unchanged.

    Raises:
        ConfigError: The file cannot be read.
        ValueError: The key `kind` is not text, or the file has no mapping `part`.
    """
    if isinstance(value, str | Path):
        value = {"kind": str(value)}
    if not isinstance(value, Mapping) or "kind" not in value:
        return value
    if not isinstance(value["kind"], str) or not value["kind"]:
        raise ValueError(f"received the kind {value['kind']!r}, expected the name of a file that `salframe fit` wrote")
    content = read_yaml(Path(value["kind"])).get(part)
    if not isinstance(content, Mapping):
        raise ValueError(f"{value['kind']} has no mapping `{part}`, expected a file that `salframe fit` wrote")
    rest = {key: number for key, number in value.items() if key != "kind"}
    # A complete mapping comes from a preset: the file replaces it. An incomplete one replaces parameters of the file.
    return content if content.keys() <= rest.keys() else merge(content, rest)


def shares(scores: np.ndarray, temperature: float) -> np.ndarray:
    """Return softmax(scores / temperature), (P,)."""
    power = np.exp((scores - scores.max()) / temperature)
    return np.asarray(power / power.sum())


@dataclass(frozen=True, eq=False)
class ScoredAnswer:
    """An answer with its truth.

    Attributes:
        scores: (P,) float64 scores of the places, best first, at least one.
        true_place: Index of the query's place among them; None if it is not ranked.
        here: Whether the query's place is in the map.
        data: Name of the tuning data. The contrast is standardized separately for each name.
    """

    scores: np.ndarray
    true_place: int | None
    here: bool
    data: str


@dataclass(frozen=True)
class Fit:
    """A fitted posterior, and its mean negative log-likelihoods in nats.

    Attributes:
        posterior: The posterior.
        answers: Number of answers.
        place_answers: Number of answers that rank the true place.
        place_nll_before: Mean negative log-likelihood of the true place in these answers, with temperature 1.
        place_nll_after: Mean negative log-likelihood of the true place in these answers, with the fitted temperature.
        here_nll_before: Mean negative log-likelihood of whether the query is in the map, in all answers, with one
            probability for all of them: the share of queries in the map.
        here_nll_after: Mean negative log-likelihood of whether the query is in the map, in all answers, with the fitted
            head.
    """

    posterior: Posterior
    answers: int
    place_answers: int
    place_nll_before: float
    place_nll_after: float
    here_nll_before: float
    here_nll_after: float


def fit_posterior(answers: Sequence[ScoredAnswer]) -> Fit:
    """Fit temperature and head by maximum likelihood. The result is deterministic.

    Mean and deviation of the head are those of the out-of-map answers. Bias and slope are a logistic regression of the
    right answers against the out-of-map answers. Each tuning data set has the same weight in the head.

    Raises:
        DataError: All places of each answer have equal scores; there are no queries in the map that are answered
            correctly, or no out-of-map queries; or the scores of all out-of-map answers are equal.
    """
    ranked = [answer for answer in answers if answer.here and answer.true_place is not None]
    num_out_of_map = sum(not answer.here for answer in answers)
    if not ranked or not num_out_of_map:
        raise DataError(
            f"received {len(ranked)} answers to queries in the map, with the true place among the ranked places, and "
            f"{num_out_of_map} answers to out-of-map queries, expected at least 1 of each"
        )
    spread = float(np.std(np.concatenate([answer.scores for answer in answers])))
    if spread == 0 or all(np.ptp(answer.scores) == 0 for answer in ranked):
        raise DataError("all places of each answer have the same score, expected scores that differ between places")
    temperature = _fit_temperature(ranked, spread)
    posterior = Posterior(temperature=temperature, head=_fit_head(answers, temperature))
    in_map = np.array([answer.here for answer in answers], float)
    contrasts = np.array([posterior.contrast(answer.scores) for answer in answers])
    base = in_map.mean()
    return Fit(
        posterior,
        len(answers),
        len(ranked),
        _place_nll(ranked, 1.0),
        _place_nll(ranked, temperature),
        -float(base * np.log(base) + (1 - base) * np.log(1 - base)),
        log_loss(posterior.head.in_map(contrasts), in_map),
    )


def log_loss(probability: np.ndarray, outcome: np.ndarray) -> float:
    """Return the mean negative logarithm of the probability (N,) of outcomes (N,), 0 or 1."""
    return float(-np.mean(np.log(np.where(outcome > 0, probability, 1 - probability))))


def _fit_head(answers: Sequence[ScoredAnswer], temperature: float) -> Head:
    """Fit the head of a posterior with a temperature."""
    others = [answer.scores[1 : 1 + NUM_OTHERS].mean() / temperature for answer in answers if len(answer.scores) > 1]
    head = Head(
        absent_mean=0,
        absent_deviation=1,
        bias=0,
        slope=0,
        accuracy=0.0,
        other_score=float(np.mean(others)) if others else 0.0,
    )
    neutral = Posterior(temperature=temperature, head=head)
    data = np.array([answer.data for answer in answers])
    here = np.array([answer.here for answer in answers])
    right = here & np.array([answer.true_place == 0 for answer in answers])
    names = list(dict.fromkeys(data.tolist()))
    accuracy = float(np.mean([right[rows].mean() for name in names if (rows := (data == name) & here).any()]))
    contrast = np.array([neutral.contrast(answer.scores) for answer in answers])
    moments = {
        name: (contrast[rows].mean(), contrast[rows].std()) for name in names if (rows := (data == name) & ~here).any()
    }
    mean, deviation = (
        float(np.mean([mean for mean, _ in moments.values()])),
        float(np.sqrt(np.mean([deviation**2 for _, deviation in moments.values()]))),
    )
    if deviation == 0:
        raise DataError("all out-of-map answers have the same scores, expected scores that differ between queries")
    head = head.model_copy(update={"absent_mean": mean, "absent_deviation": deviation, "accuracy": accuracy})
    if not right.any():
        return head
    z = np.array(
        [
            (value - moments.get(name, (mean, deviation))[0]) / (moments.get(name, (mean, deviation))[1] or deviation)
            for value, name in zip(contrast, data.tolist(), strict=True)
        ]
    )
    used = right | ~here
    weight = np.array([1 / (used & (data == name)).sum() for name in data[used].tolist()])
    bias, slope = _fit_logistic(z[used], right[used].astype(float), weight / weight.sum())
    # The ratio of the likelihoods does not depend on how frequent right and out-of-map answers are.
    bias -= float(np.log(weight[right[used]].sum() / weight[~right[used]].sum()))
    return head.model_copy(update={"bias": bias, "slope": max(slope, 0.0)})


def _fit_temperature(ranked: Sequence[ScoredAnswer], spread: float) -> float:
    from scipy.optimize import minimize_scalar

    min_log, max_log = np.log(np.array(TEMPERATURES) * spread)
    result = minimize_scalar(
        lambda log_t: _place_nll(ranked, float(np.exp(log_t))), bounds=(min_log, max_log), method="bounded"
    )
    return float(np.exp(result.x))


def _place_nll(ranked: Sequence[ScoredAnswer], temperature: float) -> float:
    """Return the mean negative logarithm of the share of the true place."""
    total = 0.0
    for answer in ranked:
        power = answer.scores / temperature
        total += np.logaddexp.reduce(power) - power[answer.true_place]
    return float(total / len(ranked))


def _fit_logistic(values: np.ndarray, outcome: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Fit a logistic regression with a ridge penalty; return the bias and the slope.

    Args:
        values: (N,) values.
        outcome: (N,) outcomes, 0 or 1.
        weight: (N,) weights of the values, with the sum 1.
    """
    from scipy.optimize import minimize

    mean = weight @ values
    spread = np.sqrt(weight @ (values - mean) ** 2) or 1.0
    standardized = (values - mean) / spread

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        logit = parameters[0] + standardized * parameters[1]
        residual = weight * (0.5 * (1 + np.tanh(0.5 * logit)) - outcome)
        value = float(weight @ (np.logaddexp(0, logit) - outcome * logit)) + RIDGE * parameters[1] ** 2
        return value, np.array([residual.sum(), standardized @ residual + 2 * RIDGE * parameters[1]])

    result = minimize(loss, np.zeros(2), jac=True, method="L-BFGS-B", options={"gtol": 1e-8})
    slope = float(result.x[1] / spread)
    return float(result.x[0] - mean * slope), slope
