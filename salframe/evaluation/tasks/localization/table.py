"""The table of the task `localization`: its rows and columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import (
    INPUT,
    SEED_RANGE,
    Column,
    bytes_column,
    cost_column,
    number_column,
    p_value_column,
    rate_column,
    share_column,
)
from salframe.evaluation.tables.table import Table, draw_table, select_leading
from salframe.evaluation.tables.text import NONE, list_methods


@dataclass(frozen=True, kw_only=True)
class LocalizationRow(MethodRow):
    """The row of a method. Shares are over all queries, and a failure counts as wrong.

    An Estimate has a 95 % confidence interval, in which queries are clustered by place. An out-of-map query is a query
    whose place is not in the map. The fields from `absent_queries` to `absent_accepted`, except `calibration_error`,
    are measured only if there are out-of-map queries.

    Attributes:
        queries: Number of queries.
        absent_queries: Number of out-of-map queries.
        present_accuracy: Accuracy of the queries whose place is in the map.
        present_scene_accuracy: `scene_accuracy` of the queries whose place is in the map.
        rejection_rate: Rejection rate: share of out-of-map queries that are rejected.
        precision_at: Precision of accepted answers at the recalls statistics.AT_RECALLS.
        average_precision: Area under the precision-recall curve.
        roc_area: Area under the ROC curve for the separation of out-of-map queries from all others, by the probability
            of being in the map, or by the best score.
        false_accept_rate: Share of out-of-map queries that are accepted at the threshold that accepts 90 %
            of the correct answers.
        calibration_error: Expected calibration error; None if the method has no probabilities.
        log_loss: Mean negative logarithm of the probability of the true case (in the map or out of it), in nats.
        brier_score: Mean squared difference between the probability that the query is in the map and 1 or 0, the true
            value.
        right_not_accepted: Share of the answers with the true place that are not accepted.
        absent_accepted: Share of the out-of-map queries whose answer is accepted.
        accuracy: Share of correct answers.
        scene_accuracy: Accuracy without transition frames: doorways are removed from the places of the answers.
        macro_precision: Mean precision over places.
        macro_recall: Mean recall over places.
        room_type_accuracy: Share of queries of known room type whose first place is of that type.
        recall_at_2: Share of queries whose place is among the first 2.
        recall_at_5: Share of queries whose place is among the first 5.
        median_translation_m: Median translation error of correct answers with a pose.
        median_rotation_deg: Median rotation error of correct answers with a pose.
        median_heading_deg: Median error of the heading of correct answers with a heading.
        recall_025m_2deg: Pose recall at (0.25 m, 2 deg), see judging.RECALLS.
        recall_05m_5deg: Pose recall at (0.5 m, 5 deg).
        recall_1m_10deg: Pose recall at (1 m, 10 deg).
        bytes_per_scene: Size of the saved maps without index, per reference frame.
        describe_ms: Median time to describe a panorama.
        query_ms: Median time to answer a query.
        peak_memory_mb: Peak memory (1e6 bytes).
        p_value: p-value of the exact paired test of the accuracy against the first measured method, clustered by place.
        p_adjusted: The p-value after Holm's adjustment.
    """

    queries: int
    absent_queries: int = 0
    present_accuracy: Estimate | None = None
    present_scene_accuracy: float | None = None
    rejection_rate: Estimate | None = None
    precision_at: tuple[float | None, ...] = ()
    average_precision: Estimate | None = None
    roc_area: Estimate | None = None
    false_accept_rate: float | None = None
    calibration_error: float | None = None
    log_loss: float | None = None
    brier_score: float | None = None
    right_not_accepted: Estimate | None = None
    absent_accepted: Estimate | None = None
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


def _pose_recall(row: LocalizationRow) -> str:
    recalls = (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg)
    return "/".join(f"{recall * 100:.0f}" for recall in recalls if recall is not None) or NONE


def _precision_at(row: LocalizationRow) -> str:
    shares = ("" if share is None else f"{share * 100:.0f}" for share in row.precision_at)
    return "/".join(share or NONE for share in shares) or NONE


COLUMNS: dict[str, Column[LocalizationRow]] = {
    "input": INPUT,
    "accuracy": rate_column("accuracy %\n(95 % CI)", lambda row: row.accuracy),
    "seed_range": SEED_RANGE,
    "scene_accuracy": share_column("without\ndoorways %", lambda row: row.scene_accuracy),
    "macro_precision": share_column("macro\nprecision %", lambda row: row.macro_precision),
    "macro_recall": share_column("macro\nrecall %", lambda row: row.macro_recall),
    "room_type": rate_column("room type %\n(95 % CI)", lambda row: row.room_type_accuracy),
    "recall_at_2": share_column("R@2\n%", lambda row: row.recall_at_2),
    "recall_at_5": share_column("R@5\n%", lambda row: row.recall_at_5),
    "pose": Column("median\npose error", _pose),
    "heading": number_column("median\nheading error deg", lambda row: row.median_heading_deg, 1),
    "pose_recall": Column("pose recall %\n.25/.5/1 m", _pose_recall),
    "present_accuracy": rate_column("in the map:\ncorrect % (95 % CI)", lambda row: row.present_accuracy),
    "present_scene_accuracy": share_column("without\ndoorways %", lambda row: row.present_scene_accuracy),
    "rejection_rate": rate_column("out of map:\nrejected % (95 % CI)", lambda row: row.rejection_rate),
    "precision_at": Column("precision % at\nrecall 50/75/90 %", _precision_at),
    "average_precision": rate_column("average precision %\n(95 % CI)", lambda row: row.average_precision),
    "roc_area": rate_column("ROC area %\n(95 % CI)", lambda row: row.roc_area),
    "false_accept_rate": share_column(
        "false accept rate %\nat 90 % accepted", lambda row: row.false_accept_rate, larger_is_better=False
    ),
    "calibration_error": share_column(
        "calibration\nerror %", lambda row: row.calibration_error, larger_is_better=False
    ),
    "log_loss": number_column("log loss\nnats", lambda row: row.log_loss, 3),
    "brier_score": number_column("Brier\nscore", lambda row: row.brier_score, 3),
    "right_not_accepted": rate_column(
        "right: not\naccepted % (95 % CI)", lambda row: row.right_not_accepted, larger_is_better=False
    ),
    "absent_accepted": rate_column(
        "out of map:\naccepted % (95 % CI)", lambda row: row.absent_accepted, larger_is_better=False
    ),
    "bytes": bytes_column("bytes\n/panorama", lambda row: row.bytes_per_scene),
    "describe": cost_column("describe\nms", lambda row: row.describe_ms),
    "query": cost_column("query\nms", lambda row: row.query_ms),
    "memory": cost_column("memory\nMB", lambda row: row.peak_memory_mb, 0),
    "p": p_value_column(lambda row: row.p_adjusted),
}
DEFAULT_COLUMNS = (
    *("input", "accuracy", "seed_range", "recall_at_5", "pose", "pose_recall"),
    *("bytes", "describe", "query", "p"),
)
OUT_OF_MAP = (
    *("present_accuracy", "present_scene_accuracy", "rejection_rate", "precision_at", "average_precision", "roc_area"),
    *("false_accept_rate", "calibration_error"),
)
"""Columns of the table of methods with out-of-map queries."""
ABOUT = (
    "Accuracy, recalls and curves are over all queries. A failed query counts as wrong, with an infinite pose error. "
    "The intervals take into account that queries of one place are correlated. The median error is over the queries "
    "with "
    "the correct place and a pose. Times are medians, without loading images. p: exact paired test of the accuracy "
    "against the first measured method of the same run, clustered by place, adjusted by Holm's method."
)
"""Note on the columns of the table, for the HTML page."""


def out_of_map_tables(
    rows: Sequence[LocalizationRow], leading: Mapping[str, Sequence[str]] | None = None
) -> list[Table]:
    """Return the table of the methods with out-of-map queries; none without such queries."""
    selected = [row for row in rows if row.absent_queries]
    columns = [COLUMNS[name] for name in OUT_OF_MAP]
    return (
        [draw_table(columns, selected, select_leading(leading, rows, selected), "out-of-map queries")]
        if selected
        else []
    )


def describe_times_note(rows: Sequence[LocalizationRow]) -> list[str]:
    """Return a note that names the methods whose time to describe a panorama excludes the detector, because they use
    annotations. The list is empty without such methods."""
    methods = [row.title for row in rows if row.measured and any(part.startswith("annotations") for part in row.input)]
    listed = list_methods(methods, [row.title for row in rows])
    return [f"describe ms: no detector time for {listed}, which use annotations"] if methods else []
