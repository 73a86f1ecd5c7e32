"""The tables of an HTML page: the tables that the terminal shows, and the same tables with all columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from salframe.evaluation.report.arms import Arm, short_key
from salframe.evaluation.runs.task import AnyTask
from salframe.evaluation.tables.table import Table


def make_tables(kind: type[AnyTask], arms: Sequence[Arm], about: str, columns: Sequence[str] = ()) -> dict[str, Any]:
    """Return the tables of arms (methods with their settings) for JSON: "usual" with the columns in `columns`, "all"
    with every column, and notes."""
    keys = list(dict.fromkeys(key for arm in arms for key in arm.varied))
    bases = [arm.base for arm in arms]
    leading = {} if keys and len(set(bases)) == 1 else {"method": bases}
    leading |= {short_key(key, keys): [arm.varied.get(key, "") for arm in arms] for key in keys}
    if any(len(arm.entries) > 1 for arm in arms):
        leading["seeds"] = [str(len(arm.entries)) for arm in arms]
    rows = [replace(arm.row, method=arm.name, changes=(), substitution=None) for arm in arms]
    usual = [_as_json(table) for table in kind.tables(rows, columns, leading)]
    return {
        "usual": usual,
        "all": [_as_json(table) for table in kind.tables(rows, list(kind.columns), leading)],
        "about": [about, *kind.legend(rows)],
    }


def _as_json(table: Table) -> dict[str, Any]:
    return {
        "title": table.title,
        "headings": list(table.headings),
        "leading": table.leading,
        "rows": [list(row) for row in table.rows],
        "best": sorted(map(list, table.best)),
    }
