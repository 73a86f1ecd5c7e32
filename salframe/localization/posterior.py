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

FEATURES = ("top_score", "top_probability", "margin", "log_objects")
"""Features of the head, in the order of `head_features`."""
TEMPERATURES = (1e-4, 1e4)
"""Minimum and maximum temperature, relative to the spread of the scores."""
RIDGE = 1e-3
"""Ridge penalty: factor of the squared weights of the head, per answer, in units of the spread of a feature. Without
it, answers that can be separated without an error have no optimal weights."""


class Head(Settings):
    """A logistic model: the log-odds that the query is in a place of the map, a weighted sum of features."""

    bias: float = Field(description="log-odds that the query is in the map, if all features are 0")
    top_score: float = Field(
        description="change of the log-odds that the query is in the map, per unit of the best score"
    )
    top_probability: float = Field(
        description="change of the log-odds that the query is in the map, per unit of the probability of the best "
        "place. This probability assumes that the query is in the map"
    )
    margin: float = Field(
        description="change of the log-odds that the query is in the map, per unit of the difference between the "
        "two best scores; a single score is compared with 0"
    )
    log_objects: float = Field(
        description="change of the log-odds that the query is in the map, per unit of ln(1 + number of objects of "
        "the query)"
    )


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

    def apply(self, localization: Localization, objects: int = 0) -> Localization:
        """Return an answer with probabilities.

        If the out-of-map probability is larger than `max_out_of_map_probability`, the status becomes
        LocalizationStatus.OUT_OF_MAP and the pose is removed. An answer without places is returned unchanged.

        Args:
            localization: The answer.
            objects: Number of objects of the query.
        """
        if not localization.places:
            return localization
        frames, names, place_scores, _ = zip(*localization.places, strict=True)
        scores = np.array(place_scores, np.float64)
        share = shares(scores, self.temperature)
        weights = np.array([getattr(self.head, name) for name in FEATURES])
        in_map = float(_logistic(self.head.bias + head_features(scores, share, objects) @ weights))
        places = ranked_places(frames, names, place_scores, (in_map * share).tolist())
        is_rejected = localization.status.names_a_place and 1 - in_map > self.max_out_of_map_probability
        if is_rejected:
            return Localization(
                places, None, LocalizationStatus.OUT_OF_MAP, out_of_map_probability=1 - in_map, notes=localization.notes
            )
        return replace(localization, places=places, out_of_map_probability=1 - in_map)


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


def head_features(scores: np.ndarray, share: np.ndarray, objects: int) -> np.ndarray:
    """Return the features of the head in the order of FEATURES, (4,) float64.

    Args:
        scores: (P,) scores of the places, best first, at least one.
        share: (P,) `shares` of the scores.
        objects: Number of objects of the query.
    """
    second = scores[1] if len(scores) > 1 else 0.0
    return np.array([scores[0], share[0], scores[0] - second, np.log1p(objects)])


@dataclass(frozen=True, eq=False)
class ScoredAnswer:
    """An answer with its truth.

    Attributes:
        scores: (P,) float64 scores of the places, best first, at least one.
        true_place: Index of the query's place among them; None if it is not ranked.
        here: Whether the query's place is in the map.
        objects: Number of objects of the query.
    """

    scores: np.ndarray
    true_place: int | None
    here: bool
    objects: int


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

    Raises:
        DataError: All places of each answer have equal scores; or there are no queries in the map, or no out-of-map
            queries.
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
    in_map = np.array([answer.here for answer in answers], float)
    features = np.stack(
        [head_features(answer.scores, shares(answer.scores, temperature), answer.objects) for answer in answers]
    )
    bias, weights = _fit_logistic(features, in_map)
    head = Head(bias=bias, **dict(zip(FEATURES, weights, strict=True)))
    base = in_map.mean()
    return Fit(
        Posterior(temperature=temperature, head=head, max_out_of_map_probability=MAX_OUT_OF_MAP_PROBABILITY),
        len(answers),
        len(ranked),
        _place_nll(ranked, 1.0),
        _place_nll(ranked, temperature),
        -float(base * np.log(base) + (1 - base) * np.log(1 - base)),
        _logistic_nll(bias + features @ np.array(weights), in_map),
    )


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


def _fit_logistic(features: np.ndarray, outcome: np.ndarray) -> tuple[float, list[float]]:
    """Fit a logistic regression with a ridge penalty; return the bias and the weights (F,).

    A constant feature has the weight 0.

    Args:
        features: (N, F) features.
        outcome: (N,) outcomes, 0 or 1.
    """
    from scipy.optimize import minimize

    mean, spread = features.mean(0), features.std(0)
    varies = spread > 1e-9 * np.maximum(np.abs(mean), 1)
    scale = np.where(varies, spread, 1.0)
    standardized = (features - mean) / scale * varies

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        logit = parameters[0] + standardized @ parameters[1:]
        residual = (_logistic(logit) - outcome) / len(outcome)
        value = _logistic_nll(logit, outcome) + RIDGE * (parameters[1:] @ parameters[1:])
        return value, np.concatenate([[residual.sum()], standardized.T @ residual + 2 * RIDGE * parameters[1:]])

    result = minimize(loss, np.zeros(1 + features.shape[1]), jac=True, method="L-BFGS-B", options={"gtol": 1e-8})
    weights = result.x[1:] / scale * varies
    return float(result.x[0] - mean @ weights), [float(weight) for weight in weights]


def _logistic_nll(logit: np.ndarray, outcome: np.ndarray) -> float:
    """Return the mean negative logarithm of the probability of outcomes (N,), 0 or 1, with log-odds (N,)."""
    return float(np.mean(np.logaddexp(0, logit) - outcome * logit))


def _logistic(logit: Any) -> Any:
    return 0.5 * (1 + np.tanh(0.5 * logit))  # does not overflow, unlike 1 / (1 + exp(-logit))
