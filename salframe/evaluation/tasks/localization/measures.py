"""Compute the table row of each method from its answers to queries."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from salframe.evaluation.runs.records import Part, Record, by_method, in_common
from salframe.evaluation.runs.rows import DescriptionLine, Line, MapLine, read_rows
from salframe.evaluation.runs.run_folder import DESCRIPTIONS, MAPS
from salframe.evaluation.statistics import (
    Estimate,
    average_precision,
    estimate_proportion,
    estimate_statistic,
    false_accept_rate,
    holm,
    macro_averages,
    median,
    paired_test,
    precision_at,
    reliability,
    roc_area,
)
from salframe.evaluation.tasks.localization.judging import Judged, judge, pose_recalls
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.survey import LocalizationSurvey
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.localization.posterior import log_loss

Cost = TypeVar("Cost", bound=Line)


def summarize_methods(parts: Sequence[Part[LocalizationSurvey, AnswerRow]], seed: int) -> tuple[LocalizationRow, ...]:
    """Return the row of each method in the table, over one data set or several."""
    queries = sum(len(survey.pieces) for survey, _ in parts)
    judged_by_method = zip(*(judge_records(*part) for part in parts), strict=True)
    lines: list[LocalizationRow] = []
    first: Judged | None = None
    for records, judged_parts in zip(by_method(parts), judged_by_method, strict=True):
        line = LocalizationRow(**in_common(records), queries=queries)
        if all(record.done for record in records):
            joined = Judged.join(judged_parts)
            line = replace(line, **_accuracy_measures(joined), **_confidence_measures(joined, seed), **_costs(records))
            if len(parts) > 1:
                line = replace(line, by_part=tuple(float(part.correct.mean()) for part in judged_parts))
            if first is not None:
                line = replace(line, p_value=paired_test(first.correct, joined.correct, joined.true_place))
            first = first or joined
        lines.append(line)
    adjusted = holm([line.p_value for line in lines])
    return tuple(replace(line, p_adjusted=p) for line, p in zip(lines, adjusted, strict=True))


def judge_records(survey: LocalizationSurvey, records: Sequence[Record[AnswerRow]]) -> list[Judged]:
    """Return the comparison of the answers of each method with the ground truth, in the order of `records`."""
    truth_arguments = survey.truths(), survey.present(), survey.doorways(), survey.dataset.room_types()
    return [judge(record.rows, *truth_arguments) for record in records]


def _accuracy_measures(judged: Judged) -> dict[str, Any]:
    in_map = np.flatnonzero(judged.present)
    precision, recall = macro_averages([judged.first_place[i] for i in in_map], [judged.true_place[i] for i in in_map])
    has_type = judged.present & np.isfinite(judged.right_type)
    located = judged.correct & np.isfinite(judged.translation_m)
    return {
        "accuracy": _rate(judged.correct, judged),
        "scene_accuracy": float(judged.correct_scene.mean()),
        "macro_precision": precision,
        "macro_recall": recall,
        "room_type_accuracy": _rate(judged.right_type, judged, has_type),
        "recall_at_2": float(judged.in_top_2.mean()),
        "recall_at_5": float(judged.in_top_5.mean()),
        "median_translation_m": median(judged.translation_m[located]),
        "median_rotation_deg": median(judged.rotation_deg[located]),
        "median_heading_deg": median(judged.heading_deg[judged.correct & np.isfinite(judged.heading_deg)]),
        **pose_recalls(judged),
    }


def _rate(right: np.ndarray, judged: Judged, of: np.ndarray | None = None) -> Estimate | None:
    """Return the share of correct answers among the queries where `of` (Q,) is true, or among all queries.

    The result is None without queries.
    """
    chosen = np.arange(len(right)) if of is None else np.flatnonzero(of)
    if not len(chosen):
        return None
    return estimate_proportion(right[chosen], [judged.true_place[i] for i in chosen])


def _confidence_measures(judged: Judged, seed: int) -> dict[str, Any]:
    """Return measures of the confidence of answers: rejection of out-of-map queries, and calibration."""
    calibration = reliability(judged.confidence, judged.correct)
    measures: dict[str, Any] = {"calibration_error": None if calibration is None else calibration.expected_error}
    absent = ~judged.present
    if absent.any():
        right, present = judged.present & judged.best_place, int(judged.present.sum())
        measures |= {
            "absent_queries": int(absent.sum()),
            "present_accuracy": _rate(judged.correct, judged, judged.present),
            "present_scene_accuracy": float(judged.correct_scene[judged.present].mean()) if present else None,
            "rejection_rate": _rate(judged.correct, judged, absent),
            "precision_at": precision_at(judged.evidence, right, present),
            "false_accept_rate": false_accept_rate(judged.evidence[right], judged.evidence[absent]),
        }
        has_probability = np.isfinite(judged.in_map)
        if has_probability.any():
            measures["log_loss"] = log_loss(judged.in_map[has_probability], judged.present[has_probability])
            measures["brier_score"] = float(
                np.mean((judged.in_map[has_probability] - judged.present[has_probability]) ** 2)
            )
        if np.isfinite(judged.accepted).all():
            measures["right_not_accepted"] = _rate(judged.accepted == 0, judged, right)
            measures["absent_accepted"] = _rate(judged.accepted == 1, judged, absent)
        for name, area in {"average_precision": _average_precision, "roc_area": _roc_area}.items():
            measures[name] = estimate_statistic(partial(area, judged), judged.true_place, seed) if present else None
    return measures


def _average_precision(judged: Judged, chosen: np.ndarray) -> float | None:
    """Return the average precision of the queries with indices (N,)."""
    present = judged.present[chosen]
    return average_precision(judged.evidence[chosen], present & judged.best_place[chosen], int(present.sum()))


def _roc_area(judged: Judged, chosen: np.ndarray) -> float | None:
    """Return the ROC area of the queries with indices (N,)."""
    present, evidence = judged.present[chosen], judged.evidence[chosen]
    return roc_area(evidence[present], evidence[~present])


def _costs(records: Sequence[Record[AnswerRow]]) -> dict[str, Any]:
    """Return the costs of a method over all data sets."""
    described = [row.ms for record in records for row in _last(record, DESCRIPTIONS, DescriptionLine, "frame")]
    maps = [row for record in records for row in _last(record, MAPS, MapLine, "fold")]
    rows = [row for record in records for row in record.rows if row is not None]
    peaks = [row.peak_memory_mb for row in rows if row.peak_memory_mb is not None]
    return {
        "bytes_per_scene": sum(row.bytes for row in maps) / sum(row.frames for row in maps) if maps else None,
        "describe_ms": median(described),
        "query_ms": median([row.query_ms for row in rows if row.query_ms is not None]),
        "peak_memory_mb": max(peaks, default=None),
    }


def _last(record: Record[AnswerRow], file: str, kind: type[Cost], key: str) -> Collection[Cost]:
    """Return the rows of a file in a method's folder. If several rows have the same `key`, return only the last one."""
    return {getattr(row, key): row for row in read_rows(record.folder / file, kind)}.values()
