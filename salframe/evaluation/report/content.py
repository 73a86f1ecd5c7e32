"""The content of a page that is shown on load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.summary import describe_run, list_notes
from salframe.evaluation.report.tables import make_tables
from salframe.evaluation.report.view import RunView

FIRST_SHOWN = 8
"""Number of arms whose curves are drawn by default."""


def make_content(views: Sequence[RunView[Any, Any]], arms: Sequence[Arm], about: str) -> dict[str, Any]:
    """Return the content of a page that all tasks share, as JSON.

    Args:
        views: The runs, of one task.
        arms: The arms of the runs.
        about: A note on the columns of the tables.
    """
    runs = [describe_run(view) for view in views]
    return {
        "title": ", ".join(dict.fromkeys(view.name for view in views)),
        "task": views[0].result.task,
        "runs": runs,
        "notes": list_notes(views, arms),
        "tables": make_tables(views[0].result.kind, arms, about),
        "reported": [paper.model_dump(mode="json") for view in views for paper in view.result.reported],
        "arms": [{"name": arm.name, "label": arm.label} for arm in arms],
        "chosen": [number for number, arm in enumerate(arms) if arm.row.measured][:FIRST_SHOWN],
        "outcomes": [],
        "figures": [],
        "sets": [],
        "walks": [],
        "pictures": False,
    }
