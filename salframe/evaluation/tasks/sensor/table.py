"""The table of the task `sensor`: its rows and columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import INPUT, Column, count_column, number_column, rate_column
from salframe.evaluation.tables.table import Table, leading_methods
from salframe.evaluation.tables.text import percent
from salframe.evaluation.tasks.sensor.detection_lines import DetectionLine


@dataclass(frozen=True, kw_only=True)
class SensorRow(MethodRow):
    """The row of a detector, over the panoramas that could be read.

    Attributes:
        panoramas: Number of panoramas.
        objects: Number of annotated objects.
        detection_rate: Share of the objects that were detected, with its 95 % confidence interval, in which objects are
            clustered by place.
        right: Share of the objects that were detected with the correct label, with the same kind of interval.
        false_per_panorama: Number of false positives per panorama.
        bearing_rad: Robust standard deviation of the error of the bearing, as in `Errors`.
        range_share: Robust standard deviation of the relative error of the range.
        size_log: Robust standard deviation of the error of the logarithm of the size.
        height_m: Robust standard deviation of the error of the height.
        lines: Detection rates of groups of objects of similar size, range or hidden share, by name of the group.
    """

    panoramas: int | None = None
    objects: int | None = None
    detection_rate: Estimate | None = None
    right: Estimate | None = None
    false_per_panorama: float | None = None
    bearing_rad: float | None = None
    range_share: float | None = None
    size_log: float | None = None
    height_m: float | None = None
    lines: Mapping[str, DetectionLine] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        return self.detection_rate is not None


COLUMNS: dict[str, Column[SensorRow]] = {
    "input": INPUT,
    "detection_rate": rate_column("detected %\n(95 % CI)", lambda row: row.detection_rate),
    "right": rate_column("detected with\ncorrect label %", lambda row: row.right),
    "false": number_column("false positives\nper panorama", lambda row: row.false_per_panorama, 1),
    "bearing": number_column("bearing\ndeg", lambda row: _scaled(row.bearing_rad, math.degrees(1)), 2),
    "range": number_column("range\n%", lambda row: _scaled(row.range_share, 100), 1),
    "size": number_column("size\n%", lambda row: _scaled(row.size_log, 100), 0),
    "height": number_column("height\ncm", lambda row: _scaled(row.height_m, 100), 1),
    "objects": count_column("objects", lambda row: row.objects),
    "panoramas": count_column("panoramas", lambda row: row.panoramas),
}
DEFAULT_COLUMNS = tuple(COLUMNS)


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def alike_tables(rows: Sequence[SensorRow], leading: Mapping[str, Sequence[str]] | None = None) -> list[Table]:
    """Return a table of the detection rates of groups of similar objects, beside the rates of the fitted model.

    The list is empty if no detector was measured.
    """
    if not any(row.lines for row in rows):
        return []
    leading = leading_methods(rows) if leading is None else leading
    cells = [
        [*labels, name, str(line.objects), *map(percent, (line.detection_rate, line.modelled, line.right))]
        for row, *labels in zip(rows, *leading.values(), strict=True)
        for name, line in row.lines.items()
    ]
    headings = (*leading, "objects", "annotated", "detected %", "model %", "detected with\ncorrect label %")
    return [Table(headings, cells, leading=len(leading) + 1, title="by size, range and occlusion")]
