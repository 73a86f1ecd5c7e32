"""From the answers of methods to their lines in the table."""

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
    accepted_though_absent,
    average_precision,
    estimate_proportion,
    estimate_statistic,
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

Cost = TypeVar("Cost", bound=Line)


def summarize_methods(parts: Sequence[Part[LocalizationSurvey, AnswerRow]], seed: int) -> tuple[LocalizationRow, ...]:
    """Return a line of the table for each method, over one data set or several."""
    queries = sum(len(survey.pieces) for survey, _ in parts)
    judged = zip(*(judge_records(*part) for part in parts), strict=True)
    lines: list[LocalizationRow] = []
    first: Judged | None = None
    for records, found_in in zip(by_method(parts), judged, strict=True):
        line = LocalizationRow(**in_common(records), queries=queries)
        if all(record.done for record in records):
            found = Judged.join(found_in)
            line = replace(line, **_reached(found), **_known_worth(found, seed), **_costs(records))
            if len(parts) > 1:
                line = replace(line, by_part=tuple(float(part.correct.mean()) for part in found_in))
            if first is not None:
                line = replace(line, p_value=paired_test(first.correct, found.correct, found.true_place))
            first = first or found
        lines.append(line)
    adjusted = holm([line.p_value for line in lines])
    return tuple(replace(line, p_adjusted=p) for line, p in zip(lines, adjusted, strict=True))


def judge_records(survey: LocalizationSurvey, records: Sequence[Record[AnswerRow]]) -> list[Judged]:
    """The answers of each method against the truth."""
    known = survey.truths(), survey.present(), survey.doorways(), survey.dataset.room_types()
    return [judge(record.rows, *known) for record in records]


def _reached(found: Judged) -> dict[str, Any]:
    asked = np.flatnonzero(found.present)
    precision, recall = macro_averages([found.first_place[i] for i in asked], [found.true_place[i] for i in asked])
    typed = found.present & np.isfinite(found.right_type)
    located = found.correct & np.isfinite(found.translation_m)
    return {
        "accuracy": _rate(found.correct, found),
        "scene_accuracy": float(found.correct_scene.mean()),
        "macro_precision": precision,
        "macro_recall": recall,
        "room_type_accuracy": _rate(found.right_type, found, typed),
        "recall_at_2": float(found.in_top_2.mean()),
        "recall_at_5": float(found.in_top_5.mean()),
        "median_translation_m": median(found.translation_m[located]),
        "median_rotation_deg": median(found.rotation_deg[located]),
        "median_heading_deg": median(found.heading_deg[found.correct & np.isfinite(found.heading_deg)]),
        **pose_recalls(found),
    }


def _rate(right: np.ndarray, found: Judged, of: np.ndarray | None = None) -> Estimate | None:
    """Return the share of the queries `of` (Q,) bool, by default all, that are right; None of none."""
    chosen = np.arange(len(right)) if of is None else np.flatnonzero(of)
    if not len(chosen):
        return None
    return estimate_proportion(right[chosen], [found.true_place[i] for i in chosen])


def _known_worth(found: Judged, seed: int) -> dict[str, Any]:
    """What answers know of their own worth: whether the query is in the map at all, and how probable they are."""
    calibration = reliability(found.confidence, found.correct)
    known: dict[str, Any] = {"calibration_error": None if calibration is None else calibration.expected_error}
    absent = ~found.present
    if absent.any():
        right, present = found.present & found.best_place, int(found.present.sum())
        known |= {
            "absent_queries": int(absent.sum()),
            "present_accuracy": _rate(found.correct, found, found.present),
            "present_scene_accuracy": float(found.correct_scene[found.present].mean()) if present else None,
            "denied_absent": _rate(found.correct, found, absent),
            "precision_at": precision_at(found.evidence, right, present),
            "accepted_absent": accepted_though_absent(found.evidence[right], found.evidence[absent]),
        }
        for name, area in {"average_precision": _average_precision, "roc_area": _roc_area}.items():
            known[name] = estimate_statistic(partial(area, found), found.true_place, seed) if present else None
    return known


def _average_precision(found: Judged, chosen: np.ndarray) -> float | None:
    """Of queries (N,), given by their indices."""
    present = found.present[chosen]
    return average_precision(found.evidence[chosen], present & found.best_place[chosen], int(present.sum()))


def _roc_area(found: Judged, chosen: np.ndarray) -> float | None:
    """Of queries (N,), given by their indices."""
    present, evidence = found.present[chosen], found.evidence[chosen]
    return roc_area(evidence[present], evidence[~present])


def _costs(records: Sequence[Record[AnswerRow]]) -> dict[str, Any]:
    """What a method cost on every data set."""
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
    """The rows of a file in a method's folder, of those with one key the last."""
    return {getattr(row, key): row for row in read_rows(record.folder / file, kind)}.values()
