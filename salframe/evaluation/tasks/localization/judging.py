"""Compare answers with the ground truth, query by query (docs/tutorials/first-comparison.md#read-the-table)."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.tasks.localization.rows import PLACED, REJECTIONS, AnswerRow
from salframe.localization.answers import LocalizationStatus
from salframe.panoramas.frames import Truth
from salframe.panoramas.geometry import pose_errors, pose_yaw, wrap_angle

RECALLS = {"recall_025m_2deg": (0.25, 2.0), "recall_05m_5deg": (0.5, 5.0), "recall_1m_10deg": (1.0, 10.0)}
"""Thresholds of pose recalls by column: translation in metres, rotation in degrees."""


@dataclass(frozen=True, eq=False)
class Judged:
    """The answers of a method compared with the ground truth, for Q queries in the order of the dataset.

    Attributes:
        present: (Q,) bool: whether the map contains the place of the query.
        best_place: (Q,) bool: whether the first place is the true one, even if the answer has the status of a failure.
        evidence: (Q,) float64: evidence that the map contains the place of the query: the probability of this if the
            method computes it, otherwise the best score; -inf for an answer without places.
        confidence: (Q,) float64: probability that the answer (a place, or a rejection) is correct; NaN without one.
        in_map: (Q,) float64: probability that the query is in the map; NaN without one.
        accepted: (Q,) float64: 1 if the answer is accepted (`Localization.accepted`), otherwise 0; NaN if the method
            has no probabilities.
        correct: (Q,) bool: whether the first place is the true one, or an out-of-map query is rejected.
        correct_scene: (Q,) bool: as `correct`, after doorways (places with transition frames only) are removed from the
            places.
        in_top_2: (Q,) bool: whether the true place is among the first 2, or an out-of-map query is rejected.
        in_top_5: (Q,) bool: whether the true place is among the first 5, or an out-of-map query is rejected.
        translation_m: (Q,) float64: translation error; infinite if the method failed or has no pose, NaN if the true
            pose is unknown or the map lacks the place.
        rotation_deg: (Q,) float64: rotation error; infinite and NaN as in `translation_m`.
        heading_deg: (Q,) float64: error of the heading; infinite and NaN as in `translation_m`. An answer may have a
            heading without a pose.
        true_place: Q names of places.
        first_place: Q names of places; None if no place was answered.
        right_type: (Q,) float64: 1 where the room type of the first place is correct, otherwise 0; NaN where it is
            unknown.
        statuses: Q statuses; "crashed" where no answer was recorded.
    """

    present: np.ndarray
    best_place: np.ndarray
    evidence: np.ndarray
    confidence: np.ndarray
    in_map: np.ndarray
    accepted: np.ndarray
    correct: np.ndarray
    correct_scene: np.ndarray
    in_top_2: np.ndarray
    in_top_5: np.ndarray
    translation_m: np.ndarray
    rotation_deg: np.ndarray
    heading_deg: np.ndarray
    true_place: tuple[str, ...]
    first_place: tuple[str | None, ...]
    right_type: np.ndarray
    statuses: tuple[str, ...]

    @classmethod
    def join(cls, parts: Sequence[Judged]) -> Judged:
        """Return the queries of several data sets as one.

        If there are several data sets, the names of places start with the number of their data set.
        """
        if len(parts) == 1:
            return parts[0]
        joined: dict[str, Any] = {}
        for field in fields(cls):
            values = [getattr(part, field.name) for part in parts]
            arrays = isinstance(values[0], np.ndarray)
            joined[field.name] = np.concatenate(values) if arrays else tuple(itertools.chain(*values))
        for name in ("true_place", "first_place"):
            named = [(number, place) for number, part in enumerate(parts) for place in getattr(part, name)]
            joined[name] = tuple(None if place is None else f"{number}: {place}" for number, place in named)
        return cls(**joined)


def judge(
    answers: Sequence[AnswerRow | None],
    truths: Sequence[Truth],
    present: Sequence[bool] | np.ndarray | None = None,
    doorways: Collection[str] = (),
    room_types: Mapping[str, str] | None = None,
) -> Judged:
    """Compare the answer to each query with its ground truth. Places and poses of failed answers do not count.

    Args:
        answers: The answer to each query; None if there is none.
        truths: The ground truth of each query.
        present: Whether the map contains the place of each query. None: the map contains all of them.
        doorways: Places of the map that are doorways.
        room_types: Room types of places, if they are known.
    """
    present = np.ones(len(truths), bool) if present is None else np.asarray(present, bool)
    correct, correct_scene, in_top_2, in_top_5 = np.zeros((4, len(truths)), bool)
    errors = np.full((len(truths), 3), np.inf)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.T_world_pano is None or not present[i]:
            errors[i] = np.nan
        if answer is not None and not present[i]:
            correct[i] = correct_scene[i] = in_top_2[i] = in_top_5[i] = answer.status in REJECTIONS
        if answer is None or answer.status not in PLACED or not present[i]:
            continue
        places = list(dict.fromkeys(ranked.place for ranked in answer.places))
        correct[i] = places[:1] == [truth.place]
        correct_scene[i] = [place for place in places if place not in doorways][:1] == [truth.place]
        in_top_2[i], in_top_5[i] = truth.place in places[:2], truth.place in places[:5]
        if answer.pose_matrix is not None and truth.T_world_pano is not None:
            errors[i, :2] = pose_errors(answer.pose_matrix, truth.T_world_pano)
        if answer.heading is not None and truth.T_world_pano is not None:
            errors[i, 2] = np.abs(wrap_angle(answer.heading - pose_yaw(truth.T_world_pano)))
    statuses = tuple(str(PieceStatus.CRASHED) if answer is None else answer.status for answer in answers)
    rotation_deg, heading_deg = np.degrees(errors[:, 1:]).T
    first = [answer.places[0].place if answer and answer.places else None for answer in answers]
    best_place = [place == truth.place for place, truth in zip(first, truths, strict=True)]
    first_place = [place if status in PLACED else None for place, status in zip(first, statuses, strict=True)]
    return Judged(
        present=present,
        best_place=np.array(best_place, bool),
        evidence=_evidence(answers),
        confidence=np.array([_confidence(answer) for answer in answers], float),
        in_map=np.array([_in_map(answer) for answer in answers], float),
        accepted=np.array([_accepted(answer) for answer in answers], float),
        correct=correct,
        correct_scene=correct_scene,
        in_top_2=in_top_2,
        in_top_5=in_top_5,
        translation_m=errors[:, 0],
        rotation_deg=rotation_deg,
        heading_deg=heading_deg,
        true_place=tuple(truth.place for truth in truths),
        first_place=tuple(first_place),
        right_type=_right_type(answers, truths, room_types or {}),
        statuses=statuses,
    )


def _right_type(
    answers: Sequence[AnswerRow | None], truths: Sequence[Truth], room_types: Mapping[str, str]
) -> np.ndarray:
    """Return the field `right_type` of Judged."""
    right = np.full(len(truths), np.nan)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.place in room_types:
            places = answer.places if answer and answer.status in PLACED else ()
            right[i] = bool(places) and room_types.get(places[0].place) == room_types[truth.place]
    return right


def _evidence(answers: Sequence[AnswerRow | None]) -> np.ndarray:
    """Return the field `evidence` of Judged."""
    scores = [answer.places[0].score if answer and answer.places else None for answer in answers]
    out_of_map_probability = [answer.out_of_map_probability if answer else None for answer in answers]
    if any(value is not None for value in out_of_map_probability):
        scores = [None if value is None else 1 - value for value in out_of_map_probability]
    return np.array([-np.inf if value is None else value for value in scores], float)


def _in_map(answer: AnswerRow | None) -> float:
    """Return the field `in_map` of Judged for one answer."""
    return np.nan if answer is None or answer.out_of_map_probability is None else 1 - answer.out_of_map_probability


def _accepted(answer: AnswerRow | None) -> float:
    """Return the field `accepted` of Judged for one answer."""
    if answer is None:
        return 0.0
    return np.nan if answer.accepted is None else float(answer.accepted)


def _confidence(answer: AnswerRow | None) -> float:
    """Return the field `confidence` of Judged for one answer."""
    if answer is None or answer.out_of_map_probability is None:
        return np.nan
    if answer.status == LocalizationStatus.OUT_OF_MAP:
        return answer.out_of_map_probability
    return answer.probabilities[0] if answer.probabilities and answer.status in PLACED else np.nan


def pose_recalls(judged: Judged) -> dict[str, float | None]:
    """Return the recall at each pose threshold, over all queries whose pose error is known.

    The keys are the names of the columns in RECALLS. The values are None if no query has a pose error.
    """
    has_pose = ~np.isnan(judged.translation_m)
    recalls: dict[str, float | None] = dict.fromkeys(RECALLS)
    for column, (translation_m, rotation_deg) in RECALLS.items() if has_pose.any() else ():
        near = (judged.translation_m <= translation_m) & (judged.rotation_deg <= rotation_deg)
        recalls[column] = float(near.sum() / has_pose.sum())
    return recalls
