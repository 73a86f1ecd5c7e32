"""The content of the HTML page that only the task `localization` has: figures, queries and their details."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.page import render
from salframe.evaluation.report.paged_task import Islands
from salframe.evaluation.tasks.localization.detail import QuerySet, find_details
from salframe.evaluation.tasks.localization.figures import draw_figures
from salframe.evaluation.tasks.localization.pictures import make_islands
from salframe.evaluation.tasks.localization.queries import OUTCOMES, group_views, list_sets
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.evaluation.tasks.localization.view import LocalizationView
from salframe.framework.files.writing import write_text
from salframe.panoramas.opening import Progress

ACCURACY = "accuracy.svg"
"""Name of the figure of the accuracy in a run folder."""


def make_part(views: Sequence[LocalizationView], arms: Sequence[Arm]) -> dict[str, Any]:
    """Return the content of the HTML page that only the task `localization` has, as JSON: the figures, and the queries
    of the runs with the answers of each arm (a method with its settings)."""
    return {"outcomes": OUTCOMES, "figures": draw_figures(arms, views), "sets": list_sets(arms, views)}


def make_islands_of_views(
    views: Sequence[LocalizationView], arms: Sequence[Arm], full: bool, progress: Progress | None
) -> Islands:
    """Return the details that the browser reads on demand: the panorama, the objects and the matches of every query.
    Descriptions (features) of panoramas that are not cached are computed."""
    sets = []
    for group in group_views(views):
        survey = views[group[0]].survey
        query_set = QuerySet(survey.dataset, [(piece.fold, piece.frame) for piece in survey.pieces])
        sets.append((query_set, find_details(query_set, group, arms, views, progress)))
    notes = tuple(dict.fromkeys(note for _, details in sets for note in details.notes))
    return Islands(make_islands(sets, full, progress), notes)


def write_accuracy(folder: Path, rows: Sequence[LocalizationRow]) -> None:
    """Write a figure of the accuracy of the measured methods."""
    measured = [row for row in rows if row.measured]
    if measured:
        write_text(folder / ACCURACY, render("accuracy.svg.jinja", rows=measured))
