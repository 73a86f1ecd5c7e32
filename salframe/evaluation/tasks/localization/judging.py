"""Answers compared with the truth, query by query (docs/tutorials/first-comparison.md#read-the-table)."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.tasks.localization.rows import DENIALS, PLACED, AnswerRow
from salframe.localization.answers import LocalizationStatus
from salframe.panoramas.frames import Truth
from salframe.panoramas.geometry import pose_errors, pose_yaw, wrap_angle

RECALLS = {"recall_025m_2deg": (0.25, 2.0), "recall_05m_5deg": (0.5, 5.0), "recall_1m_10deg": (1.0, 10.0)}
"""Pose recalls by their column: translation in metres, rotation in degrees."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A method's answers against the truth, one entry a query, in the order of the dataset.

    present (Q,) bool: the map has the query's place. correct (Q,) bool: the first place is the true one, or the place
    is not in the map and the status denies it; in_top_2, in_top_5 (Q,) bool, likewise; correct_scene (Q,) bool: as
    correct, had nobody answered with a doorway. best_place (Q,) bool: the first place is the true one, whatever the
    status. translation_m, rotation_deg (Q,) float64, infinite where there is no pose or the
    method failed, NaN where the truth has no pose or the map lacks the place; heading_deg (Q,) float64, the same of the
    heading, which may be known without a pose. evidence (Q,) float64: how much speaks for the place being in the map:
    the probability of that where the method has one, else the best score; -inf of an answer without places. confidence
    (Q,) float64: the probability of what was answered, a place or that it is not in the map; NaN without. true_place,
    first_place: Q names, the latter None where no place was answered. right_type (Q,) float64: 1 where the first place
    is of the true one's room type, otherwise 0, NaN where that is not known. statuses: Q words, "crashed" where no
    answer was recorded.
    """

    present: np.ndarray
    best_place: np.ndarray
    evidence: np.ndarray
    confidence: np.ndarray
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
        """The queries of several data sets as one; where there are several, places are named by the number of their
        data set too."""
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
    """Compare each query's answer (None where it was not answered) with its truth; `present`: whether its map has the
    query's place, None: every one has; `doorways`: the places of the map that are no scene; `room_types`: of
    places, where they are known. A failure's places and pose do not count."""
    present = np.ones(len(truths), bool) if present is None else np.asarray(present, bool)
    correct, correct_scene, in_top_2, in_top_5 = np.zeros((4, len(truths)), bool)
    errors = np.full((len(truths), 3), np.inf)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.T_world_pano is None or not present[i]:
            errors[i] = np.nan
        if answer is not None and not present[i]:
            correct[i] = correct_scene[i] = in_top_2[i] = in_top_5[i] = answer.status in DENIALS
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
    """(Q,) as in Judged."""
    right = np.full(len(truths), np.nan)
    for i, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if truth.place in room_types:
            places = answer.places if answer and answer.status in PLACED else ()
            right[i] = bool(places) and room_types.get(places[0].place) == room_types[truth.place]
    return right


def _evidence(answers: Sequence[AnswerRow | None]) -> np.ndarray:
    """(Q,) as in Judged: of the probabilities of a method that gives any, otherwise of its scores."""
    scores = [answer.places[0].score if answer and answer.places else None for answer in answers]
    not_here = [answer.not_here if answer else None for answer in answers]
    if any(value is not None for value in not_here):
        scores = [None if value is None else 1 - value for value in not_here]
    return np.array([-np.inf if value is None else value for value in scores], float)


def _confidence(answer: AnswerRow | None) -> float:
    """As in Judged."""
    if answer is None or answer.not_here is None:
        return np.nan
    if answer.status == LocalizationStatus.NOT_HERE:
        return answer.not_here
    return answer.probabilities[0] if answer.probabilities and answer.status in PLACED else np.nan


def pose_recalls(judged: Judged) -> dict[str, float | None]:
    """Shares of all queries whose true pose is known that are localized within the bounds of RECALLS, by column."""
    posed = ~np.isnan(judged.translation_m)
    recalls: dict[str, float | None] = dict.fromkeys(RECALLS)
    for column, (translation_m, rotation_deg) in RECALLS.items() if posed.any() else ():
        near = (judged.translation_m <= translation_m) & (judged.rotation_deg <= rotation_deg)
        recalls[column] = float(near.sum() / posed.sum())
    return recalls
