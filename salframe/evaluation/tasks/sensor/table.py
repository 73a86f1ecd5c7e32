"""The table of the task `sensor`: its lines and columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import GIVEN, Column, count_column, number_column, rate_column
from salframe.evaluation.tables.table import Table, leading_methods
from salframe.evaluation.tables.text import percent
from salframe.evaluation.tasks.sensor.found_lines import FoundLine


@dataclass(frozen=True, kw_only=True)
class SensorRow(MethodRow):
    """A detector's line: over the panoramas that could be read, how many, the share of the annotated objects that was
    found, and found by a right label, with 95 % intervals, of objects clustered by place; false objects a panorama;
    robust standard deviations of the errors of what was found, as in `Errors`; lines: the same shares of objects of a
    size, a range, a hidden share, by what they are called."""

    panoramas: int | None = None
    objects: int | None = None
    found: Estimate | None = None
    right: Estimate | None = None
    false_per_panorama: float | None = None
    bearing_rad: float | None = None
    range_share: float | None = None
    size_log: float | None = None
    height_m: float | None = None
    lines: Mapping[str, FoundLine] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        return self.found is not None


COLUMNS: dict[str, Column[SensorRow]] = {
    "given": GIVEN,
    "found": rate_column("found %\n(95 %)", lambda row: row.found),
    "right": rate_column("found by the\nright name %", lambda row: row.right),
    "false": number_column("false objects\na panorama", lambda row: row.false_per_panorama, 1),
    "bearing": number_column("bearing\ndeg", lambda row: _scaled(row.bearing_rad, math.degrees(1)), 2),
    "range": number_column("range\n%", lambda row: _scaled(row.range_share, 100), 1),
    "size": number_column("size\n%", lambda row: _scaled(row.size_log, 100), 0),
    "height": number_column("height\ncm", lambda row: _scaled(row.height_m, 100), 1),
    "objects": count_column("objects", lambda row: row.objects),
    "panoramas": count_column("panoramas", lambda row: row.panoramas),
}
USUAL = tuple(COLUMNS)


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def alike_tables(rows: Sequence[SensorRow], leading: Mapping[str, Sequence[str]] | None = None) -> list[Table]:
    """Return a table of what detectors find of objects that are alike, beside what the fitted model says; none where
    nothing was measured."""
    if not any(row.lines for row in rows):
        return []
    leading = leading_methods(rows) if leading is None else leading
    cells = [
        [*labels, name, str(line.objects), *map(percent, (line.found, line.modelled, line.right))]
        for row, *labels in zip(rows, *leading.values(), strict=True)
        for name, line in row.lines.items()
    ]
    headings = (*leading, "objects", "annotated", "found %", "the model\nsays %", "found by its\nright name %")
    return [Table(headings, cells, leading=len(leading) + 1, title="by size, range and what hides them")]
