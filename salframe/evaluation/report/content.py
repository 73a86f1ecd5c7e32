"""All that a page shows from the start."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from salframe.evaluation.report.arms import Arm, find_entries, name_arms
from salframe.evaluation.report.page import render, write_page
from salframe.evaluation.report.summary import describe_run, list_notes
from salframe.evaluation.report.tables import make_tables
from salframe.evaluation.report.view import LocalizationView, NavigationView, RunView
from salframe.evaluation.tasks.localization.figures import draw_figures
from salframe.evaluation.tasks.localization.queries import OUTCOMES, list_sets
from salframe.evaluation.tasks.navigation.walks import list_walks
from salframe.framework.files import write_text

FIRST_SHOWN = 8
"""The curves of so many arms are drawn until others are chosen."""
PAGE, ACCURACY = "report.html", "accuracy.svg"


def write_run_page(view: RunView) -> Path:
    """Write the page of one run into its folder, without pictures; its path. Of a comparison the accuracy as SVG too,
    for print."""
    path = view.result.run / PAGE
    content = make_content([view], name_arms([view], find_entries([view]), view.result.rows))
    write_page(path, content)
    measured = [row for row in view.result.rows if row.measured]
    if isinstance(view, LocalizationView) and measured:
        write_text(path.with_name(ACCURACY), render("accuracy.svg.jinja", rows=measured))
    return path


def make_content(views: Sequence[RunView], arms: Sequence[Arm]) -> dict[str, Any]:
    """What the page of some runs of one task shows, for JSON. Pictures come in islands."""
    runs = [describe_run(view) for view in views]
    task = views[0].result.task
    content: dict[str, Any] = {
        "title": ", ".join(dict.fromkeys(view.name for view in views)),
        "task": task,
        "runs": runs,
        "notes": list_notes(views, arms),
        "tables": make_tables(task, arms),
        "reported": [paper.model_dump(mode="json") for view in views for paper in view.result.reported],
        "arms": [{"name": arm.name, "label": arm.label} for arm in arms],
        "chosen": [number for number, arm in enumerate(arms) if arm.row.measured][:FIRST_SHOWN],
        "outcomes": OUTCOMES,
        "figures": [],
        "sets": [],
        "walks": [],
        "pictures": False,
    }
    compared = [view for view in views if isinstance(view, LocalizationView)]
    walked = [view for view in views if isinstance(view, NavigationView)]
    if compared:
        content |= {"figures": draw_figures(arms, compared), "sets": list_sets(arms, compared)}
    if walked:
        content["walks"] = list_walks(arms, walked)
    return content
