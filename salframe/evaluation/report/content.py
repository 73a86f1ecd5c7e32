"""The content of an HTML page that is shown when the page is opened."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.summary import describe_run, list_notes
from salframe.evaluation.report.tables import make_tables
from salframe.evaluation.report.view import RunView
from salframe.evaluation.runs.run_folder import name_of

MAX_NAMES = 4
"""Maximum number of methods that the title of an HTML page names."""
MAX_SHOWN = 8
"""Maximum number of measured arms (methods with their settings) whose curves an HTML page shows by default."""


def make_content(
    views: Sequence[RunView[Any, Any]], arms: Sequence[Arm], about: str, columns: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the sections that the HTML pages of all tasks have, filled with these runs, as a JSON object.

    Args:
        views: The runs, of one task.
        arms: The arms of the runs: the methods with their settings.
        about: A note on the columns of the tables.
        columns: Names of the columns of the first table. Empty for the default columns.
    """
    runs = [describe_run(view) for view in views]
    return {
        "title": _title(views, arms),
        "subtitle": _subtitle(views),
        "task": views[0].result.task,
        "runs": runs,
        "notes": list_notes(views, arms),
        "tables": make_tables(views[0].result.kind, arms, about, columns),
        "reported": [paper.model_dump(mode="json") for view in views for paper in view.result.reported],
        "arms": [{"name": arm.name, "label": arm.label} for arm in arms],
        "selected": [number for number, arm in enumerate(arms) if arm.row.measured][:MAX_SHOWN],
        "outcomes": [],
        "figures": [],
        "sets": [],
        "walks": [],
        "pictures": False,
    }


def _title(views: Sequence[RunView[Any, Any]], arms: Sequence[Arm]) -> str:
    """Return the methods and the data in words."""
    names = list(dict.fromkeys(arm.base for arm in arms))
    shown = names if len(names) <= MAX_NAMES else [*names[: MAX_NAMES - 1], f"{len(names) - MAX_NAMES + 1} more"]
    methods = shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"
    data = list(dict.fromkeys(name_of(view.result.run) for view in views))
    return f"{methods} on {', '.join(data)}"


def _subtitle(views: Sequence[RunView[Any, Any]]) -> str:
    """Return the task, the dates of the runs and the version of salframe in words."""
    dates = sorted({str(view.result.environment["date"]) for view in views if "date" in view.result.environment})
    versions = sorted({str(view.result.environment["packages"].get("salframe", "?")) for view in views})
    days = [dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}"] if dates else []
    return ", ".join([views[0].result.task.capitalize(), *days, f"salframe {', '.join(versions)}"])
