"""The queries of a data set and the answers of each arm (a method with its settings), as columns that an HTML page
filters and lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.page import floor_plan, number, numbers
from salframe.evaluation.tasks.localization.judging import Judged
from salframe.evaluation.tasks.localization.rows import PLACED, REJECTIONS, AnswerRow
from salframe.evaluation.tasks.localization.view import LocalizationView
from salframe.panoramas.geometry import pose_yaw

CORRECT, WRONG, REJECTED, NONE = "correct", "wrong place", "rejected", "no answer"
OUTCOMES = (CORRECT, WRONG, REJECTED, NONE)
"""Outcomes of a query: correct place or correct rejection; wrong place; wrong rejection; no answer."""


def list_sets(arms: Sequence[Arm], views: Sequence[LocalizationView]) -> list[dict[str, Any]]:
    """Return the queries of each data set with the answers of its arms (methods with their settings), for JSON.

    Runs on the same data share their queries. Truths and answers are indices into `places`.
    """
    sets: list[dict[str, Any]] = []
    for group in group_views(views):
        view = views[group[0]]
        answers = {
            str(key): (views[run].records[method].rows, views[run].judged[method])
            for key, arm in enumerate(arms)
            for run, method in arm.entries
            if run in group and views[run].records[method].done
        }
        truths = [truth.place for truth in view.queries.truths]
        named = {row.places[0].place for rows, _ in answers.values() for row in rows if row is not None and row.places}
        places = sorted({*truths, *named})
        index = {place: position for position, place in enumerate(places)}
        sets.append(
            {
                "name": view.name,
                "places": places,
                "ids": list(view.queries.ids),
                "truth": [index[place] for place in truths],
                "poses": [None if t.T_world_pano is None else xy_yaw(t.T_world_pano) for t in view.queries.truths],
                "answers": {key: _columns(rows, judged, index) for key, (rows, judged) in answers.items()},
                "floors": [floor_plan(floor) for floor in view.queries.floors],
            }
        )
    return sets


def group_views(views: Sequence[LocalizationView]) -> list[list[int]]:
    """Return the indices of the runs, grouped by data set."""
    groups: list[list[int]] = []
    for run, view in enumerate(views):
        alike = next((group for group in groups if views[group[0]].data == view.data), None)
        if alike is None:
            groups.append([run])
        else:
            alike.append(run)
    return groups


def _columns(rows: Sequence[AnswerRow | None], judged: Judged, index: dict[str, int]) -> dict[str, Any]:
    """Return the columns of the answers of an arm, with a value for each query."""
    first = [row.places[0] if row is not None and row.places else None for row in rows]
    poses = [None if row is None else row.pose_matrix for row in rows]
    return {
        "outcome": [
            OUTCOMES.index(outcome_of(row, bool(correct))) for row, correct in zip(rows, judged.correct, strict=True)
        ],
        "place": [None if one is None else index[one.place] for one in first],
        "status": [_status(row, status) for row, status in zip(rows, judged.statuses, strict=True)],
        "error": [row.error if row is not None else None for row in rows],
        "translation_m": numbers(judged.translation_m),
        "rotation_deg": numbers(judged.rotation_deg, 2),
        "pose": [None if pose is None else xy_yaw(pose) for pose in poses],
        "ranked": [_ranked(row) for row in rows],
        "out_of_map_probability": [None if row is None else number(row.out_of_map_probability) for row in rows],
        "ms": [None if row is None else number(row.query_ms, 1) for row in rows],
    }


def _status(row: AnswerRow | None, status: str) -> str:
    """Return the status of an answer in words. An answer whose place is not accepted is marked."""
    if row is None or row.status not in PLACED:
        return status
    return f"{status}, not accepted" if row.accepted is False else status


def outcome_of(row: AnswerRow | None, correct: bool) -> str:
    """Return the outcome of a query, one of OUTCOMES. `row` is the answer; None if there is none."""
    if correct:
        return CORRECT
    if row is not None and row.status in PLACED:
        return WRONG
    return REJECTED if row is not None and row.status in REJECTIONS else NONE


def _ranked(row: AnswerRow | None, max_places: int = 3) -> list[list[Any]]:
    """Return the first places of an answer: place, score, and probability where there is one."""
    if row is None:
        return []
    probabilities = row.probabilities or [None] * len(row.places)
    places = zip(row.places, probabilities, strict=False)
    return [[one.place, number(one.score, 4), number(probability)] for one, probability in list(places)[:max_places]]


def xy_yaw(pose: np.ndarray) -> list[float]:
    """Return x and y in metres and the azimuth in radians of a pose (4, 4)."""
    return [round(float(value), 3) for value in (*pose[:2, 3], pose_yaw(pose))]
