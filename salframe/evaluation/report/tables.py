"""The tables of a page: those of the terminal, with all columns in tables of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from salframe.evaluation.report.arms import Arm, short_key
from salframe.evaluation.tables.columns import COLUMNS
from salframe.evaluation.tables.table import Table, tables_of, without_detector

ABOUT = {
    "localization": "Accuracy, recalls and curves are over all queries: a failure counts as wrong and infinitely far; "
    "intervals are of queries clustered by place. The median error is over the correctly localized queries that have a "
    "pose. Times are medians when first computed, without loading images. p: exact paired test of the accuracy, "
    "clustered by place, against the first measured method of the same run, after Holm.",
    "navigation": "SR: the agent says that it has arrived and has at most 0.5 m to go. SPL: success times shortest way "
    "along the map over the longer of that and the way walked. Rates are over all episodes. p: exact paired test of "
    "SR, clustered by goal, against the first measured method of the same run, after Holm.",
}


def make_tables(task: str, arms: Sequence[Arm]) -> dict[str, Any]:
    """The tables of arms of one task, for JSON: `usual`, `all`, which has every column, and `about` them."""
    keys = list(dict.fromkeys(key for arm in arms for key in arm.varied))
    bases = [arm.base for arm in arms]
    leading = {} if keys and len(set(bases)) == 1 else {"method": bases}
    leading |= {short_key(key, keys): [arm.varied.get(key, "") for arm in arms] for key in keys}
    if any(len(arm.entries) > 1 for arm in arms):
        leading["seeds"] = [str(len(arm.entries)) for arm in arms]
    rows = [replace(arm.row, method=arm.name) for arm in arms]
    usual = [_as_json(table) for table in tables_of(task, rows, (), leading)]
    timed = without_detector(rows) if task == "localization" else None
    return {
        "usual": usual,
        "all": [_as_json(table) for table in tables_of(task, rows, list(COLUMNS[task]), leading)],
        "about": [ABOUT[task], *([timed] if timed else [])],
    }


def _as_json(table: Table) -> dict[str, Any]:
    return {
        "title": table.title,
        "headings": list(table.headings),
        "leading": table.leading,
        "rows": [list(row) for row in table.rows],
        "best": sorted(map(list, table.best)),
    }
