"""Fit the posterior of a localizer to answers whose true places are known (docs/explanation/calibration.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from salframe.framework.errors import DataError
from salframe.localization.posterior import (
    NUM_OTHERS,
    EvidenceTerm,
    Head,
    Posterior,
    absent_moments,
    evidence_columns,
    log_loss,
    relative_logarithm,
    shift_probability,
    standardize,
)

TEMPERATURES = (1e-4, 1e4)
"""Minimum and maximum temperature, divided by the standard deviation of the scores."""
RIDGE = 1e-3
"""Ridge penalty: factor of the squared coefficients of standardized features, per answer. Without the penalty, the
optimal slope is infinite if the contrast (score difference between the first place and the others) separates correct
answers from out-of-map answers without error."""


@dataclass(frozen=True, eq=False)
class ScoredAnswer:
    """An answer to a query whose true place is known.

    Attributes:
        scores: (P,) float64 scores of the places, best first, at least one.
        true_place: Index of the true place in `scores`; None if the answer does not rank the true place.
        here: Whether the true place is in the map.
        map: Name of the map. The contrast (see `Posterior.contrast`) is standardized separately for each map.
        objects: Number of objects of the query; 0: unknown.
        map_objects: Mean number of objects of the reference frames in rooms; 0: unknown.
        evidence: As in `Localization`.
    """

    scores: np.ndarray
    true_place: int | None
    here: bool
    map: str
    objects: int = 0
    map_objects: float = 0.0
    evidence: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Fit:
    """A fitted posterior, and its mean negative log-likelihoods in nats.

    Attributes:
        posterior: The posterior.
        answers: Number of answers.
        place_answers: Number of answers that rank the true place.
        place_nll_before: Mean negative log-likelihood of the true place in the `place_answers`, with temperature 1.
        place_nll_after: Mean negative log-likelihood of the true place in the `place_answers`, with the fitted
            temperature.
        here_nll_before: Mean negative log-likelihood of the truth (query in the map, or not), over all answers. The
            probability is the same for all answers: the share of queries in the map.
        here_nll_after: The same mean, with the probabilities of the fitted head.
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

    The means and the deviations of the head are computed from the out-of-map answers. Biases and slopes are fitted by a
    logistic regression that separates correct answers from out-of-map answers. The effects of the number of objects are
    fitted to differences between queries to the same map. Each map has the same weight in the head.

    Raises:
        DataError: In any of these cases: no answer ranks the true place of its query; there are no answers to
            out-of-map queries; in each answer, all places have the same score; all out-of-map answers have the same
            contrast.
    """
    ranked = [answer for answer in answers if answer.here and answer.true_place is not None]
    num_out_of_map = sum(not answer.here for answer in answers)
    if not ranked or not num_out_of_map:
        raise DataError(
            f"on the tuning data, the method gave {len(ranked)} answers that contain the true place, and "
            f"{num_out_of_map} answers to queries from places outside of the map, expected at least one of each: use "
            "tuning data with more queries and places"
        )
    spread = float(np.std(np.concatenate([answer.scores for answer in answers])))
    if spread == 0 or all(np.ptp(answer.scores) == 0 for answer in ranked):
        raise DataError(
            "in each answer, all places have the same score, expected different scores: use tuning data with more "
            "places, or another method"
        )
    temperature = _fit_temperature(ranked, spread)
    posterior = Posterior(temperature=temperature, head=_fit_head(answers, temperature))
    in_map = np.array([answer.here for answer in answers], float)
    contrasts = np.array([posterior.contrast(answer.scores) for answer in answers])
    objects = np.array([answer.objects for answer in answers])
    evidence = evidence_columns([answer.evidence for answer in answers])
    base = in_map.mean()
    return Fit(
        posterior,
        len(answers),
        len(ranked),
        _place_nll(ranked, 1.0),
        _place_nll(ranked, temperature),
        -float(base * np.log(base) + (1 - base) * np.log(1 - base)),
        log_loss(posterior.head.in_map(contrasts, objects, evidence), in_map),
    )


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

    of_contrast = _fit_moments(contrast, nu, map_number, ~here)
    if of_contrast.deviation == 0:
        raise DataError(
            "the answers to all out-of-map queries have the same scores, expected different scores: use tuning data "
            "with more queries"
        )
    accuracy_effect, accuracies = _fit_accuracy(right[here], nu[here], map_number[here])
    accuracy = float(np.mean([*accuracies.values()]))
    head = head.model_copy(
        update={
            **of_contrast.settings(),
            "accuracy": accuracy,
            "objects": float(np.mean([map_objects[map_number == number].mean() for number in np.unique(map_number)])),
            "accuracy_effect": accuracy_effect,
        }
    )
    used = right | ~here
    if not right.any():
        return head
    columns = evidence_columns([answer.evidence for answer in answers])
    terms = {
        name: moments
        for name, value in columns.items()
        if (moments := _fit_moments(value, nu, map_number, ~here & np.isfinite(value))).deviation > 0
    }
    features = [of_contrast.standardize(contrast, nu, map_number), nu]
    for name, moments in terms.items():
        features += [np.isfinite(columns[name]), np.nan_to_num(moments.standardize(columns[name], nu, map_number))]
    # For a given number of objects, correct answers are a * (present / absent) times as frequent as out-of-map answers,
    # where a is the accuracy. The likelihood ratio does not include this factor, which is therefore an offset.
    map_accuracy = np.array([accuracies.get(number, accuracy) for number in map_number])
    frequency = np.maximum(shift_probability(map_accuracy, accuracy_effect * nu), _MIN_ACCURACY)
    weight = _equal_weights(map_number)
    offset = np.log(frequency * weight[here].sum() / weight[~here].sum())
    weight = weight[used] / weight[used].sum()
    bias, (slope, bias_effect, *rest) = _fit_logistic(np.stack(features, 1)[used], right[used], weight, offset[used])
    evidence = {
        name: EvidenceTerm(**terms[name].settings(), bias=float(term_bias), slope=max(float(term_slope), 0.0))
        for name, term_bias, term_slope in zip(terms, rest[::2], rest[1::2], strict=True)
    }
    coefficients = {"bias": bias, "slope": max(float(slope), 0.0), "bias_effect": float(bias_effect)}
    return head.model_copy(update={**coefficients, "evidence": evidence})


_MIN_ACCURACY = 1e-6
"""Lower bound of an accuracy, so that its logarithm is finite."""


@dataclass(frozen=True)
class _Moments:
    """Moments of a value of out-of-map answers, such as the contrast.

    Attributes:
        by_map: Mean and standard deviation at nu = 0 for each map with out-of-map answers, by the number of the map.
        mean_effect: As in `Head`.
        deviation_effect: As in `Head`.
    """

    by_map: Mapping[int, tuple[float, float]]
    mean_effect: float
    deviation_effect: float

    @property
    def mean(self) -> float:
        """Mean of the means in `by_map`; 0 without maps."""
        return float(np.mean([mean for mean, _ in self.by_map.values()])) if self.by_map else 0.0

    @property
    def deviation(self) -> float:
        """Root mean square of the standard deviations in `by_map`; 0 without maps."""
        return float(np.sqrt(np.mean([s**2 for _, s in self.by_map.values()]))) if self.by_map else 0.0

    def settings(self) -> dict[str, float]:
        """Return the moments as settings of `Head` or `EvidenceTerm`: mean, standard deviation, and the effects of the
        number of objects on them."""
        moments = {"absent_mean": self.mean, "absent_deviation": self.deviation}
        return {**moments, "mean_effect": self.mean_effect, "deviation_effect": self.deviation_effect}

    def standardize(self, value: np.ndarray, nu: np.ndarray, map_number: np.ndarray) -> np.ndarray:
        """Return (value - mean) / deviation, (N,).

        Mean and deviation were fitted to the map of each value, and depend on nu.

        Args:
            value: (N,) values.
            nu: (N,) logarithms of relative numbers of objects, see `Head`.
            map_number: (N,) number of the map of each value.
        """
        z = np.empty(len(value))
        for number in np.unique(map_number):
            rows = map_number == number
            mean, deviation = self.by_map.get(int(number), (self.mean, self.deviation))
            moments = mean, deviation or self.deviation, self.mean_effect, self.deviation_effect
            z[rows] = standardize(value[rows], nu[rows], *moments)
        return z


def _fit_moments(value: np.ndarray, nu: np.ndarray, map_number: np.ndarray, is_used: np.ndarray) -> _Moments:
    """Return the moments of the values (N,) of those answers that are used (N,): out-of-map answers with a known
    value."""
    effects = _fit_effects(value[is_used], nu[is_used], map_number[is_used])
    moments = {
        int(number): absent_moments(value[rows], nu[rows], *effects)
        for number in np.unique(map_number)
        if (rows := (map_number == number) & is_used).any()
    }
    return _Moments(moments, *effects)


def _fit_effects(contrast: np.ndarray, nu: np.ndarray, map_number: np.ndarray) -> tuple[float, float]:
    """Return `mean_effect` and `deviation_effect` of the contrasts of out-of-map answers, by maximum likelihood.

    The contrasts are modelled by normal distributions. Each map has its own mean and deviation at nu = 0. Both effects
    are 0 if nu does not vary within any map.
    """
    groups = [(contrast[map_number == number], nu[map_number == number]) for number in np.unique(map_number)]
    groups = [(values, map_nu) for values, map_nu in groups if np.ptp(map_nu) > 0]
    if not groups:
        return 0.0, 0.0
    from scipy.optimize import minimize

    def loss(effects: np.ndarray) -> float:
        total = RIDGE * float(effects @ effects)
        for values, map_nu in groups:
            mean, deviation = absent_moments(values, map_nu, *effects)
            deviation = max(deviation, _MIN_DEVIATION)
            z = standardize(values, map_nu, mean, deviation, *effects)
            total += float(np.log(deviation) + effects[1] * map_nu.mean() + np.mean(z**2) / 2) / len(groups)
        return total

    result = minimize(loss, np.zeros(2), method="Nelder-Mead", options={"initial_simplex": _FIRST_EFFECTS})
    return float(result.x[0]), float(result.x[1])


_MIN_DEVIATION = 1e-6
"""Lower bound of the standard deviation of contrasts, so that its logarithm is finite."""
_FIRST_EFFECTS = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]])
"""Start simplex of the search for `mean_effect` and `deviation_effect`."""


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
    """Return weights (N,) of answers that sum to 1. The weights of the answers of each map have the same sum."""
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
    """Return the mean negative logarithm of the share of the true place, see `Posterior`."""
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
    spread[spread < _MIN_DEVIATION] = 1.0  # a constant feature has no effect
    standardized = (features - mean) / spread

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        logit = offset + parameters[0] + standardized @ parameters[1:]
        residual = weight * (_logistic(logit) - outcome)
        value = float(weight @ (np.logaddexp(0, logit) - outcome * logit)) + RIDGE * float((parameters[1:] ** 2).sum())
        return value, np.array([residual.sum(), *(residual @ standardized + 2 * RIDGE * parameters[1:])])

    result = minimize(loss, np.zeros(1 + features.shape[1]), jac=True, method="L-BFGS-B", options={"gtol": 1e-8})
    coefficients = result.x[1:] / spread
    return float(result.x[0] - mean @ coefficients), coefficients


def _logistic(values: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (1 + np.tanh(0.5 * values)))
