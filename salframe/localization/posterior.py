"""Convert scores of places to probabilities, including the out-of-map probability. The parameters are fitted on tuning
data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.config import merge, read_yaml
from salframe.framework.validation import Settings
from salframe.localization.answers import MAX_OUT_OF_MAP_PROBABILITY, Localization, LocalizationStatus, ranked_places

NUM_OTHERS = 5
"""Maximum number of places after the first place. The contrast compares the score of the first place with the mean
score of these places."""
MAX_LOG_RATIO = 30.0
"""Maximum logarithm of the likelihood ratio of an answer. It keeps exponentials finite."""


class EvidenceTerm(Settings):
    """The effect of a column of evidence on the probability that a query is in the map.

    x is the value of the column for the first place of an answer. Like the contrast (see `Head`), x is standardized
    with its mean and standard deviation among out-of-map queries, which depend on the number of objects. With the
    standardized value z, the term adds bias + slope z to ln(r), the logarithm of the likelihood ratio of a correct
    answer. If an answer lacks the column, the term adds nothing.
    """

    absent_mean: float = Field(description="mean of the column in the answers to out-of-map queries")
    absent_deviation: float = Field(
        gt=0, description="standard deviation of the column in the answers to out-of-map queries"
    )
    mean_effect: float = Field(
        0.0,
        description="increase of `absent_mean`, divided by `absent_deviation`, if ln(n / n0) increases by 1. n is the "
        "number of objects of the query, and n0 is `posterior.head.objects`",
    )
    deviation_effect: float = Field(0.0, description="change of ln(`absent_deviation`) if ln(n / n0) increases by 1")
    bias: float = Field(description="change of ln(p / q) (see `posterior.head.bias`) if the column is `absent_mean`")
    slope: float = Field(
        ge=0,
        description="further change of ln(p / q) (see `posterior.head.bias`) if the column increases by "
        "`absent_deviation`",
    )

    def standardize(self, value: np.ndarray, nu: np.ndarray) -> np.ndarray:
        """Return standardized values (N,).

        The mean of the column for out-of-map queries is subtracted from each value. The difference is divided by the
        standard deviation of the column for out-of-map queries. Mean and deviation depend on `nu` (N,), see `Head`.
        """
        moments = self.absent_mean, self.absent_deviation
        return standardize(value, nu, *moments, self.mean_effect, self.deviation_effect)


class Head(Settings):
    """A model that computes the probability that a query is in the map from the contrast of its answer.

    The contrast is the difference between the score of the first place and the other scores (`Posterior.contrast`).
    The model assumes that the contrast has the same mean and standard deviation for out-of-map queries and for wrong
    answers to queries in the map. z is the contrast minus this mean, divided by this deviation. The likelihood ratio of
    a correct answer is r = exp(bias + slope z). With the accuracy a, and if queries in the map and out-of-map queries
    are equally frequent, the probability that the query is in the map is (a r + 1 - a) / (a r + 2 - a).

    Mean, deviation, bias and accuracy depend on the number of objects of the query, by nu = ln(number of objects of the
    query / mean number of objects of the scene frames of the map). mean_effect deviation nu is added to the mean, and
    the deviation is then multiplied by exp(deviation_effect nu). bias_effect nu is added to the bias, and
    accuracy_effect nu to the log-odds of the accuracy.

    The contrast is relative to other places. Each term in `evidence` adds the effect of a value of the first place
    itself to ln(r), such as the likelihood ratio of its outline.
    """

    absent_mean: float = Field(description="mean contrast of the answers to out-of-map queries")
    absent_deviation: float = Field(
        gt=0, description="standard deviation of the contrast of the answers to out-of-map queries"
    )
    bias: float = Field(
        description="value of ln(p / q) at the contrast `absent_mean`. p is the probability density of a contrast for "
        "correct answers, and q the density for answers to out-of-map queries"
    )
    slope: float = Field(
        ge=0,
        description="change of ln(p / q) (see `posterior.head.bias`) if the contrast increases by `absent_deviation`",
    )
    accuracy: float = Field(
        ge=0, le=1, description="probability (0 to 1) that the first place is correct, if the query is in the map"
    )
    other_score: float = Field(
        description="mean score of the places after the first one, divided by `temperature`. It is used if an answer "
        "has only one place"
    )
    objects: float = Field(
        0.0,
        ge=0,
        description="mean number of objects n0 of the reference frames in rooms. The four settings whose names end in "
        "`_effect` use it; 0: they have no effect",
    )
    mean_effect: float = Field(
        0.0,
        description="increase of `absent_mean`, divided by `absent_deviation`, if ln(n / n0) increases by 1. n is the "
        "number of objects of the query, and n0 is `posterior.head.objects`",
    )
    deviation_effect: float = Field(0.0, description="change of ln(`absent_deviation`) if ln(n / n0) increases by 1")
    bias_effect: float = Field(0.0, description="change of `bias` if ln(n / n0) increases by 1")
    accuracy_effect: float = Field(0.0, description="change of the log-odds of `accuracy` if ln(n / n0) increases by 1")
    min_log_ratio: float = Field(
        0.0,
        le=0,
        description="minimum ln(p / q) (see `posterior.head.bias`) of an accepted answer. The calibration of a map "
        "replaces this value",
    )
    evidence: Mapping[str, EvidenceTerm] = Field(
        {},
        description="mapping from the name of a column of the evidence, such as `likelihood`, to the parameters of a "
        "term. The term is computed from the value of the column in the same way as ln(p / q) from the contrast, and "
        "is added to ln(p / q) (see `posterior.head.bias`). The parameters have the names of the settings of "
        "`posterior.head`. Only for methods with evidence",
    )

    def relative_objects(self, objects: np.ndarray) -> np.ndarray:
        """Return nu (see the class) of queries from their numbers of objects (N,). A number of 0 means unknown, and
        gives nu = 0."""
        return relative_logarithm(objects, self.objects)

    def standardize(self, contrast: np.ndarray, nu: np.ndarray) -> np.ndarray:
        """Return standardized contrasts z = (contrast - mean) / deviation, (N,) float64.

        `mean` and `deviation` are the mean and the standard deviation of the contrasts of out-of-map queries. They
        depend on nu.

        Args:
            contrast: (N,) contrasts.
            nu: (N,) values of nu (see the class), as returned by `relative_objects`.
        """
        moments = self.absent_mean, self.absent_deviation
        return standardize(contrast, nu, *moments, self.mean_effect, self.deviation_effect)

    def log_ratio(
        self, contrast: np.ndarray, objects: np.ndarray, evidence: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Return ln(r) (see the class), the logarithm of the likelihood ratio of a correct answer, (N,) float64.
        Arguments are those of `in_map`."""
        nu = self.relative_objects(objects)
        ratio = self.bias + self.bias_effect * nu + self.slope * self.standardize(contrast, nu)
        for name in self.evidence.keys() & (evidence or {}).keys():
            term = self.evidence[name]
            ratio = ratio + np.nan_to_num(term.bias + term.slope * term.standardize((evidence or {})[name], nu))
        return np.asarray(ratio)

    def in_map(
        self, contrast: np.ndarray, objects: np.ndarray, evidence: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Return the probability that the query is in the map, (N,) float64.

        Args:
            contrast: (N,) contrasts of answers (score differences, see the class).
            objects: (N,) numbers of objects of the queries; 0: unknown.
            evidence: Mapping from the name of a column of evidence to its values for the first places, (N,) float64;
                NaN if an answer lacks the column. None: no columns.
        """
        return self._in_map(self.log_ratio(contrast, objects, evidence), objects)

    def min_in_map(self, objects: np.ndarray) -> np.ndarray:
        """Return the minimum probability of being in the map of an accepted answer, (N,) float64: the probability at
        which ln(r) is `min_log_ratio`. It is 0.5 if `min_log_ratio` is 0.

        Args:
            objects: As in `in_map`.
        """
        return self._in_map(np.full(np.shape(objects), self.min_log_ratio), objects)

    def _in_map(self, log_ratio: np.ndarray, objects: np.ndarray) -> np.ndarray:
        accuracy = shift_probability(self.accuracy, self.accuracy_effect * self.relative_objects(objects))
        right = accuracy * np.exp(np.minimum(log_ratio, MAX_LOG_RATIO))
        wrong = 1 - accuracy
        return np.asarray((right + wrong) / (right + wrong + 1))


class Posterior(Settings):
    """A model that converts the scores of places to probabilities.

    The share of a place is softmax(score / temperature) over the ranked places. The head gives the probability that the
    query is in one of the ranked places. The probability of a place is the product of its share and this probability.
    """

    temperature: float = Field(
        gt=0,
        description="difference between the scores of two places at which one place is e times as probable as the "
        "other",
    )
    head: Head
    max_out_of_map_probability: float = Field(
        MAX_OUT_OF_MAP_PROBABILITY,
        ge=0,
        le=1,
        description="maximum out-of-map probability (0 to 1) of an answer that names a place. Above this value, the "
        "answer has the status out-of-map and no pose; 1: answers never have this status",
    )
    calibrate: bool = Field(
        True,
        description="true: the out-of-map probability is calibrated with the reference frames of each map; false: it "
        "depends only on the parameters in `posterior`",
    )
    query_distance_m: float = Field(
        1.0,
        gt=0,
        description="expected distance (m) between a query and the nearest reference frame of its place. Only used if "
        "the map is calibrated (see `posterior.calibrate`)",
    )
    max_false_accept: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="maximum false accept rate (0 to 1): the share of out-of-map queries whose answers are accepted. "
        "A conformal test limits this share. For the test, each reference frame is localized like a query, in the map "
        "without the place of this frame; null: no test",
    )

    def contrast(self, scores: np.ndarray) -> float:
        """Return the contrast of an answer: the first score minus the mean of the next NUM_OTHERS scores, divided by
        the temperature.

        Args:
            scores: (P,) scores of the places, best first, at least one.
        """
        others = float(np.mean(scores[1 : 1 + NUM_OTHERS])) / self.temperature if len(scores) > 1 else None
        return float(scores[0]) / self.temperature - (self.head.other_score if others is None else others)

    def apply(self, localization: Localization, objects: int = 0, limit: float = 1.0) -> Localization:
        """Return an answer with probabilities.

        If the out-of-map probability is larger than `max_out_of_map_probability`, the status becomes
        LocalizationStatus.OUT_OF_MAP and the pose is removed. An answer without places is returned unchanged.

        Args:
            localization: The answer.
            objects: Number of objects of the query; 0: unknown.
            limit: Maximum out-of-map probability of an accepted answer. The head may set a smaller maximum.
        """
        if not localization.places:
            return localization
        frames, names, place_scores, _ = zip(*localization.places, strict=True)
        scores = np.array(place_scores, np.float64)
        evidence = {name: np.array(value) for name, value in localization.evidence.items()}
        in_map = float(self.head.in_map(np.array(self.contrast(scores)), np.array(objects), evidence))
        limit = min(limit, 1 - float(self.head.min_in_map(np.array(objects))))
        places = ranked_places(frames, names, place_scores, (in_map * shares(scores, self.temperature)).tolist())
        answer = replace(localization, places=places, out_of_map_probability=1 - in_map, max_accepted_probability=limit)
        if localization.status.names_a_place and 1 - in_map > self.max_out_of_map_probability:
            return replace(
                answer, T_world_query=None, covariance=None, heading_rad=None, status=LocalizationStatus.OUT_OF_MAP
            )
        return answer


def read_fitted(part: str, value: Any) -> Any:
    """Return the value of a setting whose parameters may come from a file written by `salframe fit`.

    Args:
        part: Name of the mapping with the parameters in a file of `salframe fit`.
        value: The path of such a file, or a mapping of parameters. The mapping may contain the path of such a file, in
            the key `kind`. Its other keys then replace parameters of the file.

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
        raise ValueError(f"received {value['kind']!r}, expected the path of a YAML file that `salframe fit` wrote")
    content = read_yaml(Path(value["kind"])).get(part)
    if not isinstance(content, Mapping):
        raise ValueError(f"the file {value['kind']} has no mapping `{part}`, expected a file that `salframe fit` wrote")
    rest = {key: number for key, number in value.items() if key != "kind"}
    # A complete mapping comes from a preset: the file replaces it. Otherwise it changes parameters of the file.
    return content if content.keys() <= rest.keys() else merge(content, rest)


def shares(scores: np.ndarray, temperature: float) -> np.ndarray:
    """Return softmax(scores / temperature) of the scores (P,) of places, (P,) float64."""
    power = np.exp((scores - scores.max()) / temperature)
    return np.asarray(power / power.sum())


def log_loss(probability: np.ndarray, outcome: np.ndarray) -> float:
    """Return the mean negative log-likelihood of outcomes (N,), 0 or 1. `probability` (N,) is the probability of 1."""
    return float(-np.mean(np.log(np.where(outcome > 0, probability, 1 - probability))))


def evidence_columns(evidence: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
    """Return the columns of evidence of N answers, (N,) float64 each; NaN if an answer lacks the column."""
    names = sorted({name for values in evidence for name in values})
    return {name: np.array([values.get(name, np.nan) for values in evidence], np.float64) for name in names}


def standardize(
    value: np.ndarray, nu: np.ndarray, mean: float, deviation: float, mean_effect: float, deviation_effect: float
) -> np.ndarray:
    """Return standardized values (N,): (value - m) / s, with m = mean + mean_effect deviation nu and
    s = deviation exp(deviation_effect nu).

    Args:
        value: (N,) values.
        nu: (N,) logarithms of relative numbers of objects, see `Head`.
        mean: Mean of out-of-map answers at nu = 0.
        deviation: Standard deviation of out-of-map answers at nu = 0.
        mean_effect: As in `Head`.
        deviation_effect: As in `Head`.
    """
    return np.asarray(((value - mean) / deviation - mean_effect * nu) / np.exp(deviation_effect * nu))


def absent_moments(
    value: np.ndarray, nu: np.ndarray, mean_effect: float, deviation_effect: float
) -> tuple[float, float]:
    """Fit a normal distribution to values of out-of-map answers by maximum likelihood, and return its mean and standard
    deviation at nu = 0.

    Args:
        value: (N,) contrasts, or another column of the evidence; N is at least 1.
        nu, mean_effect, deviation_effect: As in `Head`.
    """
    weight = np.exp(-2 * deviation_effect * nu)
    center, nu_center = float(np.average(value, weights=weight)), float(np.average(nu, weights=weight))
    # For a deviation s, the most likely mean is center - mean_effect s nu_center. The most likely s is then a root of
    # N s^2 + linear s - squares.
    x, v = value - center, nu - nu_center
    squares, linear = float(weight @ x**2), mean_effect * float(weight @ (x * v))
    deviation = float((np.sqrt(linear**2 + 4 * len(x) * squares) - linear) / (2 * len(x)))
    return center - mean_effect * deviation * nu_center, deviation


def relative_logarithm(objects: np.ndarray, map_objects: np.ndarray | float) -> np.ndarray:
    """Return ln(objects / map_objects) for the numbers of objects of queries (N,) and the mean numbers of objects of
    their maps, (N,) float64; 0 if one of the numbers is 0, which means unknown."""
    is_known = (np.asarray(objects) > 0) & (np.asarray(map_objects) > 0)
    return np.asarray(np.log(np.where(is_known, objects, 1) / np.where(is_known, map_objects, 1)))


def shift_probability(probability: np.ndarray | float, shift: np.ndarray) -> np.ndarray:
    """Return the probabilities (N,) that result if shifts (N,) are added to the log-odds of `probability` (one number,
    or (N,))."""
    odds = probability * np.exp(np.minimum(shift, MAX_LOG_RATIO))
    return np.asarray(odds / (odds + 1 - probability))
