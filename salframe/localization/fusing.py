"""Fuse the answers to the single views of a query to one answer, for localizers that cannot join descriptions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from salframe.localization.answers import (
    MAX_OUT_OF_MAP_PROBABILITY,
    Localization,
    LocalizationStatus,
    RankedPlace,
    ranked_places,
)
from salframe.panoramas.geometry import invert_pose

MIN_PROBABILITY = 1e-6
"""Lower bound of a probability in a product over views, so that a single view cannot exclude a place."""


FUSED = "views were localized one by one, and the answers were fused"
"""Text in the note of an answer whose views should have been joined, but had to be fused."""


class Fusion(StrEnum):
    """Ways to combine several views of a query to one answer."""

    JOINED = "joined"
    """Views are joined to one query. If the localizer cannot join them, their answers are fused as with PRODUCT."""
    PRODUCT = "product"
    """The probabilities of a place are multiplied over the views."""
    SUREST = "surest"
    """The answer whose first place has the highest probability is used (the highest score, without probabilities)."""


def fuse_answers(answers: Sequence[Localization], T_last_view: np.ndarray | None) -> Localization:
    """Fuse the answers of the views of a query. Views are treated as independent.

    If all answers with places have probabilities, the fused probability of a place is proportional to the product of
    its probabilities in these answers. Otherwise, the fused places are the places of the answer with the highest score.

    The pose comes from the answers whose first place is the first fused place: the pose of the answer with the highest
    probability (or score) is converted to the pose of the last view. If `T_last_view` is None, only the answer to the
    last view can give the pose.

    If an answer has the status OUT_OF_MAP, and the fused out-of-map probability exceeds MAX_OUT_OF_MAP_PROBABILITY, the
    fused answer has the status OUT_OF_MAP and no pose.

    Args:
        answers: The answers, at least one, in the order of the views.
        T_last_view: (V, 4, 4) poses of the views in the frame of the last view; None: unknown.

    Returns:
        The fused answer, without notes. If no answer has a place, it is the answer to the last view.
    """
    placed = [number for number, answer in enumerate(answers) if answer.places]
    if not placed:
        return replace(answers[-1], notes=(), next_view=None)
    has_probabilities = all(answers[number].out_of_map_probability is not None for number in placed)
    places, out_of_map = (
        _multiply([answers[number] for number in placed])
        if has_probabilities
        else (max((answers[number].places for number in placed), key=lambda places: places[0].score), None)
    )
    limit = min(answers[number].max_accepted_probability for number in placed)
    is_rejected = (
        any(answer.status is LocalizationStatus.OUT_OF_MAP for answer in answers)
        and out_of_map is not None
        and out_of_map > MAX_OUT_OF_MAP_PROBABILITY
    )
    if is_rejected:
        return Localization(
            places,
            None,
            LocalizationStatus.OUT_OF_MAP,
            out_of_map_probability=out_of_map,
            max_accepted_probability=limit,
        )
    pose = _pose(answers, places[0].place, T_last_view)
    status = LocalizationStatus.NO_POSE if pose is None else LocalizationStatus.OK
    return Localization(places, pose, status, out_of_map_probability=out_of_map, max_accepted_probability=limit)


def choose_surest(answers: Sequence[Localization], T_last_view: np.ndarray | None) -> Localization:
    """Return the answer whose first place has the highest probability, with its pose converted to the last view.

    Without probabilities, the answer with the highest score is returned. Arguments are those of `fuse_answers`.
    """
    placed = [number for number, answer in enumerate(answers) if answer.places]
    if not placed:
        return replace(answers[-1], notes=(), next_view=None)
    number = max(placed, key=lambda number: _certainty(answers[number]))
    surest = replace(answers[number], notes=(), next_view=None)
    if surest.T_world_query is None or number == len(answers) - 1:
        return surest
    if T_last_view is None:
        return replace(
            surest, T_world_query=None, covariance=None, status=LocalizationStatus.NO_POSE, notes=(), next_view=None
        )
    moved = surest.T_world_query @ invert_pose(T_last_view[number])
    return replace(surest, T_world_query=moved, notes=(), next_view=None)


def _certainty(answer: Localization) -> float:
    """Return the probability of the first place of an answer, or its score if it has no probability."""
    first = answer.places[0]
    return first.score if first.probability is None else first.probability


def _multiply(answers: Sequence[Localization]) -> tuple[tuple[RankedPlace, ...], float]:
    """Return the places with the normalized products of their probabilities, best first, and the normalized product of
    the out-of-map probabilities.

    The frame of a place is taken from the answer that gives the place the highest probability.
    """
    log_total: dict[str, float] = {}
    best: dict[str, RankedPlace] = {}
    log_min = float(np.log(MIN_PROBABILITY))
    for answer in answers:
        for place in answer.places:
            log_probability = float(np.log(max(place.probability or 0.0, MIN_PROBABILITY)))
            log_total[place.place] = log_total.get(place.place, 0.0) + log_probability - log_min
            if place.place not in best or (place.probability or 0.0) > (best[place.place].probability or 0.0):
                best[place.place] = place
    outside = sum(
        float(np.log(max(answer.out_of_map_probability or 0.0, MIN_PROBABILITY))) - log_min for answer in answers
    )
    names = sorted(log_total, key=lambda name: (-log_total[name], name))
    logs = np.array([*(log_total[name] for name in names), outside])
    share = np.exp(logs - logs.max())
    share /= share.sum()
    scores = (logs[:-1] + len(answers) * log_min).tolist()
    return ranked_places([best[name].frame for name in names], names, scores, share[:-1].tolist()), float(share[-1])


def _pose(answers: Sequence[Localization], place: str, T_last_view: np.ndarray | None) -> np.ndarray | None:
    """Return the pose (4, 4) of the last view in the world; None if no answer gives one.

    It comes from the answer with the highest probability or score of those that have a pose and the first place
    `place`.
    """
    rows = [
        number
        for number, answer in enumerate(answers)
        if answer.T_world_query is not None and answer.places[0].place == place
    ]
    if T_last_view is None:
        rows = [number for number in rows if number == len(answers) - 1]
    if not rows:
        return None
    surest = max(rows, key=lambda number: _certainty(answers[number]))
    pose = np.asarray(answers[surest].T_world_query)
    return pose if T_last_view is None else pose @ invert_pose(T_last_view[surest])
