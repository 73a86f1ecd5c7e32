"""The table of the task `localization`: its lines and columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import (
    GIVEN,
    SEEDS,
    Column,
    area_column,
    bytes_column,
    cost_column,
    number_column,
    p_value_column,
    rate_column,
    share_column,
)
from salframe.evaluation.tables.table import Table, draw_table, select_leading
from salframe.evaluation.tables.text import NONE, fixed, list_methods


@dataclass(frozen=True, kw_only=True)
class LocalizationRow(MethodRow):
    """A method's line: shares of all queries, a failure among them; medians of pose errors over what was localized.

    accuracy with its 95 % interval, of queries clustered by place; scene_accuracy: had nobody answered with a doorway;
    macro_precision, macro_recall: means over places; room_type_accuracy: of the queries whose room type the data set
    tells, the share whose first place is of that type; recall_at_2, recall_at_5; median_translation_m,
    median_rotation_deg; median_heading_deg, of what has a heading and no pose too; recall of poses at the bounds of
    judging.RECALLS; bytes_per_scene, of the saved maps without index by their frames; describe_ms a panorama,
    query_ms a query, medians; peak_memory_mb; p_value of the exact paired test against the first measured method,
    clustered by place; p_adjusted, as by Holm over all that are tested so.

    Where some queries are asked of a map without their place: absent_queries, how many; present_accuracy, of the
    others, and present_scene_accuracy, had nobody answered with a doorway; denied_absent, the share of them whose
    answer denies the map; precision_at, of right places among answers above a bound, at the recalls
    statistics.AT_RECALLS; average_precision, the area below precision against recall; roc_area of telling the two apart
    by the probability of being in the map, or the best score; accepted_absent, the share of them that passes the bound
    on it which 90 % of the right answers pass. calibration_error: the expected one, where the method has
    probabilities. An Estimate has the interval of queries clustered by place.
    """

    queries: int
    absent_queries: int = 0
    present_accuracy: Estimate | None = None
    present_scene_accuracy: float | None = None
    denied_absent: Estimate | None = None
    precision_at: tuple[float | None, ...] = ()
    average_precision: Estimate | None = None
    roc_area: Estimate | None = None
    accepted_absent: float | None = None
    calibration_error: float | None = None
    accuracy: Estimate | None = None
    scene_accuracy: float | None = None
    macro_precision: float | None = None
    macro_recall: float | None = None
    room_type_accuracy: Estimate | None = None
    recall_at_2: float | None = None
    recall_at_5: float | None = None
    median_translation_m: float | None = None
    median_rotation_deg: float | None = None
    median_heading_deg: float | None = None
    recall_025m_2deg: float | None = None
    recall_05m_5deg: float | None = None
    recall_1m_10deg: float | None = None
    bytes_per_scene: float | None = None
    describe_ms: float | None = None
    query_ms: float | None = None
    peak_memory_mb: float | None = None
    p_value: float | None = None
    p_adjusted: float | None = None

    @property
    def measured(self) -> bool:
        return self.accuracy is not None


def _pose(row: LocalizationRow) -> str:
    if row.median_translation_m is not None and row.median_rotation_deg is not None:
        turn_deg = row.median_rotation_deg
        return f"{row.median_translation_m:.2f} m {turn_deg:.{1 if turn_deg < 10 else 0}f}°"
    return NONE if row.median_heading_deg is None else f"{row.median_heading_deg:.1f}°"


def _within(row: LocalizationRow) -> str:
    recalls = (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg)
    return "/".join(f"{recall * 100:.0f}" for recall in recalls if recall is not None) or NONE


def _precision_at(row: LocalizationRow) -> str:
    shares = ("" if share is None else f"{share * 100:.0f}" for share in row.precision_at)
    return "/".join(share or NONE for share in shares) or NONE


COLUMNS: dict[str, Column[LocalizationRow]] = {
    "given": GIVEN,
    "accuracy": rate_column("accuracy %\n(95 %)", lambda row: row.accuracy),
    "seeds": SEEDS,
    "scenes": share_column("scenes\nonly %", lambda row: row.scene_accuracy),
    "macro_precision": share_column("macro\nprecision %", lambda row: row.macro_precision),
    "macro_recall": share_column("macro\nrecall %", lambda row: row.macro_recall),
    "room_type": rate_column("room type %\n(95 %)", lambda row: row.room_type_accuracy),
    "recall_at_2": share_column("R@2\n%", lambda row: row.recall_at_2),
    "recall_at_5": share_column("R@5\n%", lambda row: row.recall_at_5),
    "pose": Column("median\npose error", _pose),
    "heading": number_column("median\nheading error deg", lambda row: row.median_heading_deg, 1),
    "within": Column("pose within\n.25/.5/1 m %", _within),
    "present_accuracy": rate_column("in the map:\nright % (95 %)", lambda row: row.present_accuracy),
    "present_scenes": share_column("scenes\nonly %", lambda row: row.present_scene_accuracy),
    "denied_absent": rate_column("not in it:\ndenied % (95 %)", lambda row: row.denied_absent),
    "precision_at": Column("precision % at\nrecall 50/75/90 %", _precision_at),
    "average_precision": area_column("average\nprecision", lambda row: row.average_precision),
    "roc_area": area_column("ROC\narea", lambda row: row.roc_area),
    "accepted_absent": share_column(
        "not in it: accepted %\nat 90 % of right kept", lambda row: row.accepted_absent, largest=False
    ),
    "calibration_error": Column(
        "calibration\nerror", lambda row: fixed(row.calibration_error, 3), lambda row: row.calibration_error, False
    ),
    "bytes": bytes_column("bytes\n/scene", lambda row: row.bytes_per_scene),
    "describe": cost_column("describe\nms", lambda row: row.describe_ms),
    "query": cost_column("query\nms", lambda row: row.query_ms),
    "memory": cost_column("memory\nMB", lambda row: row.peak_memory_mb, 0),
    "p": p_value_column(lambda row: row.p_adjusted),
}
USUAL = (
    *("given", "accuracy", "seeds", "scenes", "recall_at_5", "pose", "within"),
    *("bytes", "describe", "query", "p"),
)
OUT_OF_MAP = (
    *("present_accuracy", "present_scenes", "denied_absent", "precision_at", "average_precision", "roc_area"),
    *("accepted_absent", "calibration_error"),
)
"""Columns of the table of methods that are asked out-of-map queries."""
ABOUT = (
    "Accuracy, recalls and curves are over all queries: a failure counts as wrong and infinitely far; "
    "intervals are of queries clustered by place. The median error is over the correctly localized queries that have a "
    "pose. Times are medians when first computed, without loading images. p: exact paired test of the accuracy, "
    "clustered by place, against the first measured method of the same run, after Holm."
)
"""What a page says of the columns."""


def out_of_map_tables(
    rows: Sequence[LocalizationRow], leading: Mapping[str, Sequence[str]] | None = None
) -> list[Table]:
    """Return the table of the methods that were asked out-of-map queries; none where there are none."""
    asked = [row for row in rows if row.absent_queries]
    columns = [COLUMNS[name] for name in OUT_OF_MAP]
    return (
        [draw_table(columns, asked, select_leading(leading, rows, asked), "place in the map or not")] if asked else []
    )


def describe_times_note(rows: Sequence[LocalizationRow]) -> list[str]:
    """Return a note on the time to describe a panorama: the methods without a detector in it; none where all have
    one."""
    given = [row.method for row in rows if row.measured and any(part.startswith("annotations") for part in row.given)]
    listed = list_methods(given, [row.method for row in rows])
    return [f"describe ms: no detector ran for {listed}, which had annotations"] if given else []
