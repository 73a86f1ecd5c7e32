"""The figures of a comparison for Plotly. Each trace names the arm (a method with its settings) that determines its
colour and visibility."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.page import numbers
from salframe.evaluation.statistics import Estimate, accepted_above, reliability
from salframe.evaluation.tasks.localization.judging import Judged
from salframe.evaluation.tasks.localization.rows import PLACED, AnswerRow
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.evaluation.tasks.localization.view import LocalizationView
from salframe.panoramas.frames import Truth

Figure = dict[str, Any]
"""A figure: "title", "data", "layout", and optionally "about". A trace with "arm" has the colour of that arm (a method
with its settings)."""
ERRORS = (
    ("translation_m", "translation error (m)", (0.01, 20.0)),
    ("rotation_deg", "rotation error (degrees)", (0.1, 180.0)),
)
"""For each pose error: the field of `Judged`, the title of the figure, and the minimum and maximum of its error
axis."""
HISTOGRAM_BINS = 24
PERCENT = {"range": [0, 1.02], "tickformat": ".0%"}


@dataclass(frozen=True, eq=False)
class ArmAnswers:
    """The answers of one arm (a method with its settings) over all of its seeds.

    Attributes:
        number: Index of the arm in the comparison.
        arm: The arm.
        line: Row of the arm in the results table.
        accuracy: Accuracy of the arm.
        rows: Answer to each query, None if there is none.
        truths: Ground truth of each query.
        judged: Errors of the answers, from the comparison with the ground truth.
    """

    number: int
    arm: Arm
    line: LocalizationRow
    accuracy: Estimate
    rows: tuple[AnswerRow | None, ...]
    truths: tuple[Truth, ...]
    judged: Judged


def gather(arms: Sequence[Arm], views: Sequence[LocalizationView]) -> list[ArmAnswers]:
    """Return the arms (methods with their settings) that were measured, with their answers to all queries."""
    arm_answers = []
    for number, arm in enumerate(arms):
        line = arm.row
        if isinstance(line, LocalizationRow) and line.accuracy is not None:
            rows = tuple(row for run, method in arm.entries for row in views[run].records[method].rows)
            truths = tuple(truth for run, _ in arm.entries for truth in views[run].queries.truths)
            judged = [views[run].judged[method] for run, method in arm.entries]
            arm_answers.append(ArmAnswers(number, arm, line, line.accuracy, rows, truths, Judged.join(judged)))
    return arm_answers


def draw_figures(arms: Sequence[Arm], views: Sequence[LocalizationView]) -> list[Figure]:
    """Return the figures of a report that compares methods."""
    arm_answers = gather(arms, views)
    figures = [
        *_bars(arm_answers),
        *_costs(arm_answers, lambda row: row.query_ms, "time per query (ms)", "Accuracy against time"),
        *_costs(arm_answers, lambda row: row.bytes_per_scene, "bytes per panorama", "Accuracy against memory"),
        *_recalls(arm_answers),
        *_error_curves(arm_answers),
        *_histograms(arm_answers),
        *_precision(arm_answers),
        *_reliability(arm_answers),
    ]
    return figures


def _bars(arm_answers: Sequence[ArmAnswers]) -> Iterator[Figure]:
    """Yield the accuracies with their 95 % CI, one bar per arm, the first at the top."""
    traces = []
    for one in arm_answers:
        traces.append(
            {
                "type": "bar",
                "orientation": "h",
                "arm": one.number,
                "x": [one.accuracy.value],
                "y": [one.arm.name],
                "error_x": {
                    "type": "data",
                    "symmetric": False,
                    "thickness": 1.2,
                    "width": 3,
                    **_error_bars(one.accuracy),
                },
                "hovertemplate": "%{x:.1%}<extra>%{y}</extra>",
            }
        )
    if traces:
        layout = {"xaxis": PERCENT, "yaxis": {"autorange": "reversed", "automargin": True, "ticksuffix": " "}}
        yield {"title": "Accuracy with 95 % CI", "data": traces, "layout": {**layout, "bargap": 0.35}}


def _costs(
    arm_answers: Sequence[ArmAnswers], get: Callable[[LocalizationRow], float | None], axis: str, title: str
) -> Iterator[Figure]:
    """Yield the accuracy against a cost, one point per arm."""
    traces: list[dict[str, Any]] = []
    for one in arm_answers:
        if cost := get(one.line):
            traces.append(
                {
                    "arm": one.number,
                    "x": [cost],
                    "y": [one.accuracy.value],
                    "error_y": {
                        "type": "data",
                        "symmetric": False,
                        "thickness": 1,
                        "width": 3,
                        **_error_bars(one.accuracy),
                    },
                    "mode": "markers",
                    "text": [one.arm.name],
                    "cliponaxis": False,
                    "hovertemplate": "%{x:,.4~g}, %{y:.1%}<extra>%{text}</extra>",
                    "marker": {"size": 10},
                }
            )
    if traces:
        x = {"type": "log", "title": {"text": axis}, "dtick": 1, "range": _decades([one["x"][0] for one in traces])}
        yield {"title": title, "data": traces, "layout": {"xaxis": x, "yaxis": {**PERCENT, "range": [0, 1.08]}}}


def _error_bars(estimate: Estimate) -> dict[str, Any]:
    if estimate.low is None or estimate.high is None:
        return {}
    return {"array": [estimate.high - estimate.value], "arrayminus": [estimate.value - estimate.low]}


def _decades(values: Sequence[float]) -> list[float]:
    """Return the range of exponents of values, with a margin at both ends."""
    low, high = np.log10([min(values), max(values)])
    return [float(np.floor(low - 0.15)), float(np.ceil(high + 0.15))]


def _recalls(arm_answers: Sequence[ArmAnswers]) -> Iterator[Figure]:
    """Yield the share of queries whose place is among the first N of the answer. Places of a failed answer do not
    count."""
    traces = []
    for one in arm_answers:
        ranks = np.array([rank_of(row, truth.place) for row, truth in zip(one.rows, one.truths, strict=True)])
        num_places = max((len(row.places) for row in one.rows if row), default=0)
        counts = np.arange(1, max(num_places, 1) + 1)
        share = (ranks[None] <= counts[:, None]).mean(1)
        traces.append({"arm": one.number, "x": counts.tolist(), "y": numbers(share, 4), "mode": "lines+markers"})
    if traces:
        x = {"title": {"text": "N"}, "dtick": 1}
        layout = {"xaxis": x, "yaxis": {**PERCENT, "title": {"text": "correct place among the first N"}}}
        yield {"title": "Recall at N", "data": traces, "layout": layout}


def rank_of(row: AnswerRow | None, place: str) -> float:
    """Return the rank of a place in an answer, from 1. Infinite if the answer does not contain the place."""
    if row is None or row.status not in PLACED:
        return np.inf
    ranked = list(dict.fromkeys(ranked.place for ranked in row.places))
    return ranked.index(place) + 1 if place in ranked else np.inf


def _error_curves(arm_answers: Sequence[ArmAnswers]) -> Iterator[Figure]:
    """Yield the share of queries whose pose error is below a bound, as a curve over the bound. The error of a failure
    is infinite."""
    for name, title, bounds in ERRORS:
        traces = []
        for one in arm_answers:
            errors = getattr(one.judged, name)
            finite = np.sort(errors[np.isfinite(errors)])
            if len(finite):
                share = np.arange(1, len(finite) + 1) / np.count_nonzero(~np.isnan(errors))
                x, y = np.clip([bounds[0], *finite, bounds[1]], *bounds), [0.0, *share, share[-1]]
                drawn = {"x": numbers(x), "y": numbers(np.array(y), 4), "mode": "lines", "line": {"shape": "hv"}}
                traces.append({"arm": one.number, **drawn})
        if traces:
            axis = {"type": "log", "title": {"text": title}, "range": np.log10(bounds).tolist(), "dtick": 1}
            layout = {"xaxis": axis, "yaxis": {**PERCENT, "title": {"text": "share of queries"}}}
            yield {"title": f"Cumulative {title.partition(' (')[0]}", "data": traces, "layout": layout}


def _histograms(arm_answers: Sequence[ArmAnswers]) -> Iterator[Figure]:
    """Yield the histograms of pose errors, in bins of equal width on a logarithmic axis.

    The first and the last bin include errors beyond the axis.
    """
    for name, title, bounds in ERRORS:
        edges = np.geomspace(*bounds, HISTOGRAM_BINS + 1)
        traces = []
        for one in arm_answers:
            errors = getattr(one.judged, name)
            finite = np.clip(errors[np.isfinite(errors)], bounds[0], bounds[1])
            if len(finite):
                share = np.histogram(finite, edges)[0] / np.count_nonzero(~np.isnan(errors))
                x, y = numbers(np.repeat(edges, 2)[1:-1], 4), numbers(np.repeat(share, 2), 4)
                traces.append({"arm": one.number, "x": x, "y": y, "mode": "lines", "fill": "tozeroy"})
        if traces:
            axis = {"type": "log", "title": {"text": title}, "range": np.log10(bounds).tolist(), "dtick": 1}
            y_axis = {"title": {"text": "share of queries"}, "tickformat": ".0%", "rangemode": "tozero"}
            layout = {"xaxis": axis, "yaxis": y_axis}
            yield {"title": f"Distribution of the {title.partition(' (')[0]}", "data": traces, "layout": layout}


def _precision(arm_answers: Sequence[ArmAnswers]) -> Iterator[Figure]:
    """Yield the precision-recall curves of arms that have out-of-map queries."""
    traces = []
    for one in arm_answers:
        judged, present = one.judged, int(one.judged.present.sum())
        if present and not judged.present.all():
            hits, precision = accepted_above(judged.evidence, judged.present & judged.best_place)
            drawn = {"x": numbers(hits / present, 4), "y": numbers(precision, 4), "mode": "lines"}
            traces.append({"arm": one.number, **drawn})
    if traces:
        axes = {"xaxis": "recall: share of the queries in the map", "yaxis": "precision of accepted answers"}
        layout = {axis: {**PERCENT, "title": {"text": text}} for axis, text in axes.items()}
        yield {"title": "Precision-recall curve", "data": traces, "layout": layout}


def _reliability(arm_answers: Sequence[ArmAnswers]) -> Iterator[Figure]:
    """Yield the reliability diagrams of arms whose answers have probabilities."""
    traces: list[dict[str, Any]] = []
    for one in arm_answers:
        diagram = reliability(one.judged.confidence, one.judged.correct)
        if diagram is not None:
            counts = [f"{count} queries" for count in diagram.count]
            x, y = numbers(diagram.confidence, 4), numbers(diagram.frequency, 4)
            traces.append({"arm": one.number, "x": x, "y": y, "text": counts, "mode": "lines+markers"})
    if traces:
        diagonal = {"x": [0, 1], "y": [0, 1], "mode": "lines", "line": {"color": "#999", "dash": "dot", "width": 1}}
        layout = {
            "xaxis": {**PERCENT, "title": {"text": "probability of the answer"}},
            "yaxis": {**PERCENT, "title": {"text": "share of correct answers"}},
        }
        yield {"title": "Reliability", "data": [*traces, {**diagonal, "hoverinfo": "skip"}], "layout": layout}
