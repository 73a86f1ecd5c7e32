"""Calibrate the out-of-map probability with the reference frames of a map (docs/explanation/calibration.md)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError
from salframe.framework.validation import Settings
from salframe.localization.answers import MAX_OUT_OF_MAP_PROBABILITY, Localization
from salframe.localization.localizer import Description, Localizer
from salframe.localization.posterior import Head, Posterior, absent_moments, log_loss, shift_probability
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.hidden_places import hide_places

MAX_FRAMES = 200
"""Maximum number of reference frames that are localized in a map without them, and in a map without their places."""
MAX_FRAMES_OF_PLACE = 4
"""Maximum number of frames of one place that are localized in a map without them."""
PLACE_GROUPS = 10
"""Maximum number of groups of places. All places of a group are hidden at once, so that the map is indexed once for
each group."""
ABSENT_PRIOR = 10.0
"""Number of out-of-map answers that the mean and the deviation of the posterior count as."""
ACCURACY_PRIOR = 4.0
"""Number of answers that the accuracy of the posterior counts as."""
DISTANCE_EXPONENT = 0.3
"""The share of right answers is proportional to the distance to the nearest reference frame to the power of minus this.
Fitted on tuning data: ten buildings at half of their viewpoints, and `house-42` with the errors of two detectors."""
FITTED_DISTANCE_M = 1.0
"""Distance to the nearest reference frame that the accuracy of a posterior applies to: about the mean of the tuning
data."""
ACCURACY_LIMITS = (0.01, 0.99)
"""Minimum and maximum accuracy of a calibrated head."""
PROBABILITY_DIGITS = 4
"""Number of decimals of the stored probabilities, which keeps maps small."""
MIN_DISTANCE_M = 0.1
"""Smaller distances between frames count as this."""


@dataclass(frozen=True, eq=False)
class FrameAnswers:
    """The answers to scene frames of a map, in the map without them or without their places.

    Attributes:
        contrast: (N,) float64 contrast of each answer, see `Posterior.contrast`.
        is_right: (N,) bool, whether the first place is that of the frame; False where the place was hidden.
        is_absent: (N,) bool, whether all frames of the place were hidden.
        objects: (N,) int64 number of objects of each frame; 0: unknown.
        distance_m: (N,) float64 distance to the nearest other scene frame of the place; NaN where it was hidden.
        place: (N,) int64 number of the place of each frame.
    """

    contrast: np.ndarray
    objects: np.ndarray
    is_right: np.ndarray
    is_absent: np.ndarray
    distance_m: np.ndarray
    place: np.ndarray

    def take(self, rows: np.ndarray) -> FrameAnswers:
        """Return some of the answers."""
        columns = (self.contrast, self.objects, self.is_right, self.is_absent, self.distance_m, self.place)
        return FrameAnswers(*(column[rows] for column in columns))


class ProbabilityScores(Settings):
    """Quality of the probability that a frame is in the map. Present and absent frames have equal weights.

    Attributes:
        log_loss: Mean negative logarithm of the probability of the true case, in nats.
        brier_score: Mean squared difference between the probability and the true case (0 or 1).
    """

    log_loss: float
    brier_score: float


class MapCalibration(Settings):
    """The calibration of a map.

    Attributes:
        head: The head of the posterior, with the mean, the deviation, the accuracy, and the number of objects of this
            map.
        present_frames: Number of frames that were localized in the map without them.
        absent_in_map: Probabilities, by this head, that frames are in the map, although it is without their places;
            ascending.
        before: Quality of the posterior without calibration on these frames; None if frames of either kind are missing.
        after: Quality with calibration, where the frames of each place are left out of their own calibration.
    """

    head: Head
    present_frames: int = Field(ge=0)
    absent_in_map: tuple[float, ...]
    before: ProbabilityScores | None = None
    after: ProbabilityScores | None = None

    def max_out_of_map_probability(self, max_false_accept: float) -> float:
        """Return the maximum out-of-map probability at which an answer passes the conformal test, at most
        MAX_OUT_OF_MAP_PROBABILITY.

        The p-value of an answer is (1 + k) / (1 + n), where k of the n out-of-map answers of the map are in the map
        with at least its probability (Vovk, Gammerman, Shafer: Algorithmic Learning in a Random World, 2005,
        section 2.2). If out-of-map queries are exchangeable with these frames, at most a share `max_false_accept` of
        them has a smaller or equal p-value.

        Raises:
            DataError: There are fewer than 1 / max_false_accept out-of-map answers.
        """
        count = len(self.absent_in_map)
        if count * max_false_accept < 1:
            raise DataError(
                f"max_false_accept is {max_false_accept:g}, which needs at least "
                f"{np.ceil(1 / max_false_accept):.0f} out-of-map answers, but the map has {count}: raise "
                "max_false_accept, or add places to the map"
            )
        num_above = int(np.floor(max_false_accept * (count + 1) + 1e-9)) - 1
        limit = 1 - self.absent_in_map[count - 1 - num_above]
        return min(float(np.nextafter(limit, 0)), MAX_OUT_OF_MAP_PROBABILITY)


def add_probabilities(
    answer: Localization, posterior: Posterior, calibration: MapCalibration | None, objects: int
) -> Localization:
    """Return an answer to a query with `objects` objects (0: unknown) with the probabilities of a posterior, calibrated
    where there is a calibration.

    Raises DataError as `acceptance_limit`.
    """
    limit = acceptance_limit(posterior, calibration)
    if calibration is not None:
        posterior = posterior.model_copy(update={"head": calibration.head})
    return posterior.apply(answer, objects, limit)


def acceptance_limit(posterior: Posterior, calibration: MapCalibration | None) -> float:
    """Return the maximum out-of-map probability of an accepted answer.

    It is MAX_OUT_OF_MAP_PROBABILITY, or less where the posterior has a `max_false_accept`.

    Raises:
        DataError: The posterior has a `max_false_accept`, and the map is not calibrated or has too few frames.
    """
    level = posterior.max_false_accept
    if level is None:
        return MAX_OUT_OF_MAP_PROBABILITY
    if calibration is None:
        raise DataError(
            f"max_false_accept is {level:g} and the map is not calibrated, expected a calibrated map: run "
            "salframe map calibrate, or omit max_false_accept"
        )
    return calibration.max_out_of_map_probability(level)


def is_calibrated(localizer: Localizer) -> bool:
    """Return whether the maps of a localizer are calibrated: it has a posterior whose setting `calibrate` is true."""
    return localizer.posterior is not None and localizer.posterior.calibrate


def calibrate_posterior(
    localizer: Localizer,
    descriptions: Sequence[Description],
    frames: Sequence[ReferenceFrame],
    floors: Sequence[FloorMasks],
) -> MapCalibration:
    """Calibrate the posterior of a localizer with the reference frames of a map.

    The localizer indexes parts of the map, at most PLACE_GROUPS + MAX_FRAMES_OF_PLACE times. It must index the map
    again afterwards.

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
            f"{localizer.name} has no posterior, so that its answers have no probabilities to calibrate: use a method "
            "with probabilities, such as proposed, or set `posterior`"
        )
    answers = localize_frames(localizer, posterior, descriptions, frames, floors)
    head = calibrate_head(posterior, answers)
    absent = np.sort(head.in_map(answers.contrast[answers.is_absent], answers.objects[answers.is_absent]))
    before, after = _cross_validate(posterior, answers)
    return MapCalibration(
        head=head,
        present_frames=int((~answers.is_absent).sum()),
        absent_in_map=tuple(absent.round(PROBABILITY_DIGITS).tolist()),
        before=before,
        after=after,
    )


def localize_frames(
    localizer: Localizer,
    posterior: Posterior,
    descriptions: Sequence[Description],
    frames: Sequence[ReferenceFrame],
    floors: Sequence[FloorMasks],
) -> FrameAnswers:
    """Localize scene frames in the map without them, and in the map without their places.

    Answers without a place are left out, and so are frames that the localizer fails on. Arguments are those of
    `calibrate_posterior`.
    """
    number = {place: i for i, place in enumerate(dict.fromkeys(frame.place for frame in frames))}
    scenes: dict[str, list[int]] = {}
    for row, frame in enumerate(frames):
        if frame.kind is FrameKind.SCENE:
            scenes.setdefault(frame.place, []).append(row)
    rows: list[tuple[float, int, bool, bool, float, int]] = []
    for shown, queries, is_absent in _hide(frames, scenes, floors):
        localizer.index([descriptions[row] for row in shown], [frames[row] for row in shown])
        positions_m: dict[str, list[np.ndarray]] = {}
        for row in shown:
            if frames[row].kind is FrameKind.SCENE:
                positions_m.setdefault(frames[row].place, []).append(frames[row].T_world_pano[:3, 3])
        for row in queries:
            try:
                places = localizer.match(descriptions[row]).places
            except Exception:  # a frame that the localizer fails on costs its own answer only, like a query
                continue
            if not places:
                continue
            place, distance_m = frames[row].place, np.nan
            if not is_absent:
                shift_m = np.array(positions_m[place]) - frames[row].T_world_pano[:3, 3]
                distance_m = float(np.linalg.norm(shift_m, axis=1).min())
            contrast = posterior.contrast(np.array([ranked.score for ranked in places], np.float64))
            is_right = not is_absent and places[0].place == place
            objects = localizer.count_objects(descriptions[row])
            rows.append((contrast, objects, is_right, is_absent, distance_m, number[place]))
    columns = zip(*rows, strict=True) if rows else [()] * 6
    kinds = (np.float64, np.int64, np.bool_, np.bool_, np.float64, np.int64)
    return FrameAnswers(*(np.array(column, kind) for column, kind in zip(columns, kinds, strict=True)))


def calibrate_head(posterior: Posterior, answers: FrameAnswers) -> Head:
    """Return the head of a posterior for a map, from the answers to its frames.

    The number of objects is the mean over the frames. Mean and deviation are those of the absent frames, averaged with
    those of the posterior, which count as ABSENT_PRIOR answers. The accuracy is that of the present frames at the
    distance `query_distance_m`. The accuracy of the posterior counts as ACCURACY_PRIOR answers at FITTED_DISTANCE_M.
    """
    head = posterior.head
    if head.objects and answers.objects.any():
        head = head.model_copy(update={"objects": float(answers.objects[answers.objects > 0].mean())})
    absent, present = answers.take(answers.is_absent), answers.take(~answers.is_absent)
    mean, deviation = head.absent_mean, head.absent_deviation
    if count := len(absent.contrast):
        nu = head.relative_objects(absent.objects)
        map_mean, map_deviation = absent_moments(absent.contrast, nu, head.mean_effect, head.deviation_effect)
        map_share = count / (count + ABSENT_PRIOR)
        mean += map_share * (map_mean - mean)
        deviation = float(np.sqrt(map_share * map_deviation**2 + (1 - map_share) * deviation**2))
    changes = {"absent_mean": mean, "absent_deviation": deviation}
    accuracy = _accuracy(present, head, posterior.query_distance_m)
    return head.model_copy(update={**changes, "accuracy": accuracy})


def _accuracy(present: FrameAnswers, head: Head, query_distance_m: float) -> float:
    """Return the accuracy at a distance, by maximum a posteriori."""
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
    """Return the share of right answers at a distance, relative to that at FITTED_DISTANCE_M."""
    return np.asarray((distance_m / FITTED_DISTANCE_M) ** -DISTANCE_EXPONENT)


def _hide(
    frames: Sequence[ReferenceFrame], scenes: dict[str, list[int]], floors: Sequence[FloorMasks]
) -> Iterator[tuple[list[int], list[int], bool]]:
    """Yield parts of a map: the rows of the frames that it shows, the rows of the hidden frames to localize in it, and
    whether the places of these were hidden.

    First, one frame of each place with several scene frames is hidden, MAX_FRAMES_OF_PLACE times. Then groups of places
    are hidden.
    """
    num_left = MAX_FRAMES
    for round in range(MAX_FRAMES_OF_PLACE):
        hidden = [rows[round] for rows in scenes.values() if len(rows) > max(round, 1)]
        queries = _spread(hidden, num_left)
        num_left -= len(queries)
        if queries:
            chosen = set(queries)
            yield [row for row in range(len(frames)) if row not in chosen], queries, False
    num_groups = min(PLACE_GROUPS, len(scenes))
    for group in range(num_groups):
        places = list(scenes)[group::num_groups]
        remaining = {frame.id for frame in hide_places(frames, places, floors)}
        shown = [row for row, frame in enumerate(frames) if frame.id in remaining]
        if shown:
            yield shown, _spread([row for place in places for row in scenes[place]], MAX_FRAMES // num_groups), True


def _spread(rows: list[int], count: int) -> list[int]:
    """Return at most `count` of the rows, evenly spread."""
    if len(rows) <= count:
        return rows
    return [rows[i] for i in np.linspace(0, len(rows) - 1, count).round().astype(int)]


def _cross_validate(
    posterior: Posterior, answers: FrameAnswers
) -> tuple[ProbabilityScores, ProbabilityScores] | tuple[None, None]:
    """Return the quality of the probabilities without calibration, and with a calibration from the frames of all other
    places; None without frames of either kind."""
    if answers.is_absent.all() or not answers.is_absent.any():
        return None, None
    after = np.empty(len(answers.contrast))
    for place in np.unique(answers.place):
        is_own = answers.place == place
        head = calibrate_head(posterior, answers.take(~is_own))
        after[is_own] = head.in_map(answers.contrast[is_own], answers.objects[is_own])
    return _scores(posterior.head.in_map(answers.contrast, answers.objects), answers), _scores(after, answers)


def _scores(in_map: np.ndarray, answers: FrameAnswers) -> ProbabilityScores:
    sides = [(in_map[rows], 1.0 - answers.is_absent[rows]) for rows in (answers.is_absent, ~answers.is_absent)]
    return ProbabilityScores(
        log_loss=float(np.mean([log_loss(probability, outcome) for probability, outcome in sides])),
        brier_score=float(np.mean([((probability - outcome) ** 2).mean() for probability, outcome in sides])),
    )
