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
    deviation. With z the contrast in units of these, the likelihood ratio of a right answer is r = exp(bias + slope z).
    If a is the accuracy, and queries in the map and out of it are equally frequent, the probability that the query is
    in the map is (a r + 1 - a) / (a r + 2 - a).

    Mean, deviation, bias, and accuracy depend on nu = ln(objects of the query / mean number of objects of the scene
    frames of the map): mean exp(mean_effect nu), deviation exp(deviation_effect nu), bias + bias_effect nu, and the
    log-odds of the accuracy + accuracy_effect nu.
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
    objects: float = Field(
        0.0,
        ge=0,
        description="mean number of objects of the scene frames of the map; 0: the number of objects has no effect",
    )
    mean_effect: float = Field(
        0.0, description="change of the logarithm of `absent_mean` per unit of ln(objects of the query / `objects`)"
    )
    deviation_effect: float = Field(0.0, description="as `mean_effect`, of the logarithm of `absent_deviation`")
    bias_effect: float = Field(0.0, description="as `mean_effect`, of `bias`")
    accuracy_effect: float = Field(0.0, description="as `mean_effect`, of the log-odds of `accuracy`")

    def relative_objects(self, objects: np.ndarray) -> np.ndarray:
        """Return nu of queries, from their numbers of objects (N,); 0 where either number is unknown (0)."""
        return relative_logarithm(objects, self.objects)

    def standardize(self, contrast: np.ndarray, nu: np.ndarray) -> np.ndarray:
        """Return contrasts (N,) minus the mean of out-of-map queries, in units of their deviation, (N,) float64.

        Args:
            contrast: (N,) contrasts.
            nu: (N,) numbers of objects as `relative_objects` returns them.
        """
        mean = self.absent_mean * np.exp(self.mean_effect * nu)
        return np.asarray((contrast - mean) / (self.absent_deviation * np.exp(self.deviation_effect * nu)))

    def in_map(self, contrast: np.ndarray, objects: np.ndarray) -> np.ndarray:
        """Return the probability that the query is in the map, (N,) float64.

        Args:
            contrast: (N,) contrasts of answers.
            objects: (N,) numbers of objects of the queries; 0: unknown.
        """
        nu = self.relative_objects(objects)
        log_ratio = self.bias + self.bias_effect * nu + self.slope * self.standardize(contrast, nu)
        accuracy = shift_probability(self.accuracy, self.accuracy_effect * nu)
        right = accuracy * np.exp(np.minimum(log_ratio, MAX_LOG_RATIO))
        wrong = 1 - accuracy
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

    def apply(
        self, localization: Localization, objects: int = 0, limit: float = MAX_OUT_OF_MAP_PROBABILITY
    ) -> Localization:
        """Return an answer with probabilities.

        If the out-of-map probability is larger than `max_out_of_map_probability`, the status becomes
        LocalizationStatus.OUT_OF_MAP and the pose is removed. An answer without places is returned unchanged.

        Args:
            localization: The answer.
            objects: Number of objects of the query; 0: unknown.
            limit: Maximum out-of-map probability of an accepted answer.
        """
        if not localization.places:
            return localization
        frames, names, place_scores, _ = zip(*localization.places, strict=True)
        scores = np.array(place_scores, np.float64)
        in_map = float(self.head.in_map(np.array(self.contrast(scores)), np.array(objects)))
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
        map: Name of the map. The contrast is standardized separately for each map.
        objects: Number of objects of the query; 0: unknown.
        map_objects: Mean number of objects of the scene frames of the map; 0: unknown.
    """

    scores: np.ndarray
    true_place: int | None
    here: bool
    map: str
    objects: int = 0
    map_objects: float = 0.0


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
    right answers against the out-of-map answers. The effects of the number of objects are fitted to its variation
    between queries to the same map. Each map has the same weight in the head.

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
    objects = np.array([answer.objects for answer in answers])
    base = in_map.mean()
    return Fit(
        posterior,
        len(answers),
        len(ranked),
        _place_nll(ranked, 1.0),
        _place_nll(ranked, temperature),
        -float(base * np.log(base) + (1 - base) * np.log(1 - base)),
        log_loss(posterior.head.in_map(contrasts, objects), in_map),
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
        accuracy=0,
        other_score=float(np.mean(others)) if others else 0.0,
    )
    neutral = Posterior(temperature=temperature, head=head)
    contrast = np.array([neutral.contrast(answer.scores) for answer in answers])
    here = np.array([answer.here for answer in answers])
    right = here & np.array([answer.true_place == 0 for answer in answers])
    map_objects = np.array([answer.map_objects for answer in answers])
    nu = relative_logarithm(np.array([answer.objects for answer in answers]), map_objects)
    _, map_number = np.unique([answer.map for answer in answers], return_inverse=True)

    mean_effect, deviation_effect = _fit_effects(contrast[~here], nu[~here], map_number[~here])
    moments = {
        number: absent_moments(contrast[rows], nu[rows], mean_effect, deviation_effect)
        for number in np.unique(map_number)
        if (rows := (map_number == number) & ~here).any()
    }
    mean, deviation = np.mean([m for m, _ in moments.values()]), np.sqrt(np.mean([s**2 for _, s in moments.values()]))
    if deviation == 0:
        raise DataError("all out-of-map answers have the same scores, expected scores that differ between queries")
    accuracy_effect, accuracies = _fit_accuracy(right[here], nu[here], map_number[here])
    accuracy = float(np.mean([*accuracies.values()]))
    head = head.model_copy(
        update={
            "absent_mean": float(mean),
            "absent_deviation": float(deviation),
            "accuracy": accuracy,
            "objects": float(np.mean([map_objects[map_number == number].mean() for number in np.unique(map_number)])),
            "mean_effect": mean_effect,
            "deviation_effect": deviation_effect,
            "accuracy_effect": accuracy_effect,
        }
    )
    used = right | ~here
    if not right.any():
        return head
    z = np.empty(len(answers))
    for number in np.unique(map_number):
        map_mean, map_deviation = moments.get(number, (mean, deviation))
        own = {"absent_mean": map_mean, "absent_deviation": map_deviation or deviation}
        rows = map_number == number
        z[rows] = head.model_copy(update=own).standardize(contrast[rows], nu[rows])
    # Given the number of objects, right answers are a (present / absent) times as frequent as out-of-map answers, with
    # a the accuracy. The ratio of their likelihoods does not depend on this.
    map_accuracy = np.array([accuracies.get(number, accuracy) for number in map_number])
    frequency = np.maximum(shift_probability(map_accuracy, accuracy_effect * nu), _MIN_ACCURACY)
    weight = _equal_weights(map_number)
    offset = np.log(frequency * weight[here].sum() / weight[~here].sum())
    weight = weight[used] / weight[used].sum()
    features = np.stack([z, nu], 1)[used]
    bias, (slope, bias_effect) = _fit_logistic(features, right[used], weight, offset[used])
    return head.model_copy(update={"bias": bias, "slope": max(float(slope), 0.0), "bias_effect": float(bias_effect)})


_MIN_ACCURACY = 1e-6
"""Minimum accuracy, whose logarithm is finite."""


def _fit_effects(contrast: np.ndarray, nu: np.ndarray, map_number: np.ndarray) -> tuple[float, float]:
    """Return `mean_effect` and `deviation_effect` of the contrasts of out-of-map answers, by maximum likelihood of
    normal distributions whose mean and deviation at nu = 0 are those of each map; 0 where nu does not vary within the
    maps."""
    groups = [(contrast[map_number == number], nu[map_number == number]) for number in np.unique(map_number)]
    groups = [(values, own) for values, own in groups if np.ptp(own) > 0]
    if not groups:
        return 0.0, 0.0
    from scipy.optimize import minimize

    def loss(effects: np.ndarray) -> float:
        total = RIDGE * float(effects @ effects)
        for values, own in groups:
            deviation = absent_moments(values, own, *effects)[1]
            total += float(np.log(max(deviation, _MIN_DEVIATION)) + effects[1] * own.mean()) / len(groups)
        return total

    result = minimize(loss, np.zeros(2), method="Nelder-Mead", options={"initial_simplex": _FIRST_EFFECTS})
    return float(result.x[0]), float(result.x[1])


_MIN_DEVIATION = 1e-6
"""Minimum standard deviation of contrasts, whose logarithm is finite."""
_FIRST_EFFECTS = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]])
"""The effects that the search starts with."""


def absent_moments(
    contrast: np.ndarray, nu: np.ndarray, mean_effect: float, deviation_effect: float
) -> tuple[float, float]:
    """Return the mean and the standard deviation at nu = 0 of contrasts (N,), at least one, by maximum likelihood."""
    scale, spread = np.exp(mean_effect * nu), np.exp(deviation_effect * nu)
    mean = float((contrast * scale / spread**2).sum() / (scale**2 / spread**2).sum())
    return mean, float(np.sqrt(np.mean(((contrast - mean * scale) / spread) ** 2)))


def _fit_accuracy(right: np.ndarray, nu: np.ndarray, map_number: np.ndarray) -> tuple[float, dict[int, float]]:
    """Return `accuracy_effect`, and the accuracy at nu = 0 of each map, from a logistic regression with one bias per
    map."""
    names, number = np.unique(map_number, return_inverse=True)
    if not np.ptp(nu):
        return 0.0, {name: float(right[number == i].mean()) for i, name in enumerate(names)}
    is_map = np.eye(len(names))[number]
    bias, (effect, *shifts) = _fit_logistic(np.column_stack([nu, is_map]), right, _equal_weights(number))
    return float(effect), dict(zip(names, _logistic(bias + np.array(shifts)).tolist(), strict=True))


def _equal_weights(map_number: np.ndarray) -> np.ndarray:
    """Return weights (N,) with the sum 1, with which each map has the same weight."""
    weight = 1 / np.bincount(map_number)[map_number]
    return np.asarray(weight / weight.sum())


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


def _fit_logistic(
    features: np.ndarray, outcome: np.ndarray, weight: np.ndarray, offset: np.ndarray | float = 0.0
) -> tuple[float, np.ndarray]:
    """Fit a logistic regression with a ridge penalty; return the bias, and the coefficients (F,).

    Args:
        features: (N, F) features.
        outcome: (N,) bool outcomes.
        weight: (N,) weights of the outcomes, with the sum 1.
        offset: (N,) known terms of the log-odds.
    """
    from scipy.optimize import minimize

    mean = weight @ features
    spread = np.sqrt(weight @ (features - mean) ** 2)
    spread[spread == 0] = 1.0
    standardized = (features - mean) / spread

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        logit = offset + parameters[0] + standardized @ parameters[1:]
        residual = weight * (_logistic(logit) - outcome)
        value = float(weight @ (np.logaddexp(0, logit) - outcome * logit)) + RIDGE * float((parameters[1:] ** 2).sum())
        return value, np.array([residual.sum(), *(residual @ standardized + 2 * RIDGE * parameters[1:])])

    result = minimize(loss, np.zeros(1 + features.shape[1]), jac=True, method="L-BFGS-B", options={"gtol": 1e-8})
    coefficients = result.x[1:] / spread
    return float(result.x[0] - mean @ coefficients), coefficients


def relative_logarithm(objects: np.ndarray, map_objects: np.ndarray | float) -> np.ndarray:
    """Return ln(objects / map_objects), (N,) float64; 0 where either number is 0, which means unknown."""
    is_known = (np.asarray(objects) > 0) & (np.asarray(map_objects) > 0)
    return np.asarray(np.log(np.where(is_known, objects, 1) / np.where(is_known, map_objects, 1)))


def shift_probability(probability: np.ndarray | float, shift: np.ndarray) -> np.ndarray:
    """Return a probability, or probabilities (N,), whose log-odds are increased by shifts (N,)."""
    odds = probability * np.exp(np.minimum(shift, MAX_LOG_RATIO))
    return np.asarray(odds / (odds + 1 - probability))


def _logistic(values: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (1 + np.tanh(0.5 * values)))
