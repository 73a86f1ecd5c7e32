"""From the scores of places to probabilities, with one for 'in none of them': a few parameters, fitted on tuning
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
from salframe.localization.answers import Localization, LocalizationStatus, ranked_places

FEATURES = ("top_score", "top_probability", "margin", "log_objects")
"""What the head weighs, in the order of `head_features`."""
TEMPERATURES = (1e-4, 1e4)
"""Between these, times the spread of the scores, a temperature is looked for."""
RIDGE = 1e-3
"""Weight of the squared weights of the head, per answer and in units of a feature's spread: without it answers that can
be told apart without an error have no best weights."""


class Head(Settings):
    """A logistic model of 'here': log-odds that the query is in a place of the map, a sum of weighted features."""

    bias: float = Field(description="log-odds where all features are 0")
    top_score: float = Field(description="log-odds for each unit of the best score")
    top_probability: float = Field(description="log-odds for a share of 1 that the best place has among the places")
    margin: float = Field(description="log-odds for each unit that the best score leads by; over 0 where it is alone")
    log_objects: float = Field(description="log-odds for each unit of ln(1 + number of objects of the query)")


class Posterior(Settings):
    """What scores of places are worth. The share of a place is softmax(score / temperature) over the ranked places; the
    head says how probable it is that the query is in one of them at all, and the product is a place's probability."""

    temperature: float = Field(gt=0, description="difference of scores that makes a place e times as probable")
    head: Head
    max_out_of_map_probability: float = Field(
        0.5, ge=0, le=1, description="above this probability of being in no place of the map the answer is out-of-map"
    )

    def apply(self, localization: Localization, objects: int = 0) -> Localization:
        """The same answer with probabilities, of the query's number of objects; `out-of-map` and without a pose where
        that is more probable than `max_out_of_map_probability`. An answer without places stays as it is."""
        if not localization.places:
            return localization
        frames, names, told, _ = zip(*localization.places, strict=True)
        scores = np.array(told, np.float64)
        share = shares(scores, self.temperature)
        weights = np.array([getattr(self.head, name) for name in FEATURES])
        here = float(_logistic(self.head.bias + head_features(scores, share, objects) @ weights))
        places = ranked_places(frames, names, told, (here * share).tolist())
        denied = localization.status.names_a_place and 1 - here > self.max_out_of_map_probability
        if denied:
            return Localization(places, None, LocalizationStatus.OUT_OF_MAP, out_of_map_probability=1 - here)
        return replace(localization, places=places, out_of_map_probability=1 - here)


def read_fitted(part: str, value: Any) -> Any:
    """What a setting stands for whose numbers `salframe fit` finds: of a file that it wrote, its mapping `part`, with
    those laid on top that were set one by one, or a mapping of them. Raises ConfigError on a file that cannot be read,
    ValueError on one that holds no such part."""
    if isinstance(value, str | Path):
        value = {"kind": str(value)}
    if not isinstance(value, Mapping) or "kind" not in value:
        return value
    content = read_yaml(Path(value["kind"])).get(part)
    if not isinstance(content, Mapping):
        raise ValueError(f"{value['kind']} has no mapping `{part}`, expected a file that `salframe fit` wrote")
    rest = {key: number for key, number in value.items() if key != "kind"}
    # A preset's own numbers, which are complete, lie below the file; what was set of the file's is not.
    return content if content.keys() <= rest.keys() else merge(content, rest)


def shares(scores: np.ndarray, temperature: float) -> np.ndarray:
    """softmax(scores / temperature) (P,)."""
    power = np.exp((scores - scores.max()) / temperature)
    return np.asarray(power / power.sum())


def head_features(scores: np.ndarray, share: np.ndarray, objects: int) -> np.ndarray:
    """(4,) float64, see FEATURES; scores (P,), best first, at least one, with their `shares`."""
    second = scores[1] if len(scores) > 1 else 0.0
    return np.array([scores[0], share[0], scores[0] - second, np.log1p(objects)])


@dataclass(frozen=True, eq=False)
class ScoredAnswer:
    """An answer and what is true of it: scores (P,) float64 of its places, best first, at least one; true_place, the
    position of the query's place among them, None where it is not; here, whether that place is in the map; objects, how
    many the query shows."""

    scores: np.ndarray
    true_place: int | None
    here: bool
    objects: int


@dataclass(frozen=True)
class Fit:
    """A fitted posterior, and what it gains: mean negative logarithms, in nats, of the share of the true place
    (`place`, of `place_answers` answers that rank it) and of the probability that the query is here or not (`here`, of
    all `answers`), before (temperature 1; the share of queries that are here) and after."""

    posterior: Posterior
    answers: int
    place_answers: int
    place_nll_before: float
    place_nll_after: float
    here_nll_before: float
    here_nll_after: float


def fit_posterior(answers: Sequence[ScoredAnswer]) -> Fit:
    """The temperature and the head of maximal likelihood; the same for the same answers.

    Raises DataError where the scores tell nothing, or where queries that are here or queries that are not are missing.
    """
    ranked = [answer for answer in answers if answer.here and answer.true_place is not None]
    absent = sum(not answer.here for answer in answers)
    if not ranked or not absent:
        raise DataError(
            f"received {len(ranked)} answers that rank the query's place and {absent} whose map lacks it, "
            "expected some of both"
        )
    spread = float(np.std(np.concatenate([answer.scores for answer in answers])))
    if spread == 0 or all(np.ptp(answer.scores) == 0 for answer in ranked):
        raise DataError("the places of each answer have one and the same score, expected scores that tell places apart")
    temperature = _fit_temperature(ranked, spread)
    here = np.array([answer.here for answer in answers], float)
    features = np.stack(
        [head_features(answer.scores, shares(answer.scores, temperature), answer.objects) for answer in answers]
    )
    bias, weights = _fit_logistic(features, here)
    head = Head(bias=bias, **dict(zip(FEATURES, weights, strict=True)))
    base = here.mean()
    return Fit(
        Posterior(temperature=temperature, head=head, max_out_of_map_probability=0.5),
        len(answers),
        len(ranked),
        _place_nll(ranked, 1.0),
        _place_nll(ranked, temperature),
        -float(base * np.log(base) + (1 - base) * np.log(1 - base)),
        _here_nll(bias + features @ np.array(weights), here),
    )


def _fit_temperature(ranked: Sequence[ScoredAnswer], spread: float) -> float:
    from scipy.optimize import minimize_scalar

    low, high = np.log(np.array(TEMPERATURES) * spread)
    found = minimize_scalar(
        lambda log_t: _place_nll(ranked, float(np.exp(log_t))), bounds=(low, high), method="bounded"
    )
    return float(np.exp(found.x))


def _place_nll(ranked: Sequence[ScoredAnswer], temperature: float) -> float:
    """Mean negative logarithm of the true places' shares."""
    total = 0.0
    for answer in ranked:
        power = answer.scores / temperature
        total += np.logaddexp.reduce(power) - power[answer.true_place]
    return float(total / len(ranked))


def _fit_logistic(features: np.ndarray, outcome: np.ndarray) -> tuple[float, list[float]]:
    """Bias and weights (F,) of logistic regression with a ridge, of features (N, F) and outcomes (N,) 0 or 1. A feature
    that never varies weighs nothing."""
    from scipy.optimize import minimize

    mean, spread = features.mean(0), features.std(0)
    varies = spread > 1e-9 * np.maximum(np.abs(mean), 1)
    scale = np.where(varies, spread, 1.0)
    plain = (features - mean) / scale * varies

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        logit = parameters[0] + plain @ parameters[1:]
        off = (_logistic(logit) - outcome) / len(outcome)
        value = _here_nll(logit, outcome) + RIDGE * (parameters[1:] @ parameters[1:])
        return value, np.concatenate([[off.sum()], plain.T @ off + 2 * RIDGE * parameters[1:]])

    found = minimize(loss, np.zeros(1 + features.shape[1]), jac=True, method="L-BFGS-B", options={"gtol": 1e-8})
    weights = found.x[1:] / scale * varies
    return float(found.x[0] - mean @ weights), [float(weight) for weight in weights]


def _here_nll(logit: np.ndarray, outcome: np.ndarray) -> float:
    """Mean negative logarithm of the probability of the outcomes (N,) 0 or 1 at these log-odds."""
    return float(np.mean(np.logaddexp(0, logit) - outcome * logit))


def _logistic(logit: Any) -> Any:
    return 0.5 * (1 + np.tanh(0.5 * logit))  # which does not overflow
