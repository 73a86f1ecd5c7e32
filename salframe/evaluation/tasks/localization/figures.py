"""The figures of a comparison, as Plotly reads them; each trace names the arm whose colour and choice it follows."""

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
"""{"title", "data", "layout"}, and "about" where there is more to say. A trace with "arm" has that arm's colour."""
ERRORS = (
    ("translation_m", "translation error (m)", (0.01, 20.0)),
    ("rotation_deg", "rotation error (degrees)", (0.1, 180.0)),
)
"""Fields of Judged, what they are, and the range that is drawn."""
HISTOGRAM_BINS = 24
PERCENT = {"range": [0, 1.02], "tickformat": ".0%"}


@dataclass(frozen=True, eq=False)
class Answered:
    """A measured arm by its position, its line and accuracy, and its answers over all of its seeds: rows, what is true,
    and both compared."""

    number: int
    arm: Arm
    line: LocalizationRow
    accuracy: Estimate
    rows: tuple[AnswerRow | None, ...]
    truths: tuple[Truth, ...]
    judged: Judged


def gather(arms: Sequence[Arm], views: Sequence[LocalizationView]) -> list[Answered]:
    """The measured arms, with their answers."""
    found = []
    for number, arm in enumerate(arms):
        line = arm.row
        if isinstance(line, LocalizationRow) and line.accuracy is not None:
            rows = tuple(row for run, method in arm.entries for row in views[run].records[method].rows)
            truths = tuple(truth for run, _ in arm.entries for truth in views[run].queries.truths)
            judged = [views[run].judged[method] for run, method in arm.entries]
            found.append(Answered(number, arm, line, line.accuracy, rows, truths, Judged.join(judged)))
    return found


def draw_figures(arms: Sequence[Arm], views: Sequence[LocalizationView]) -> list[Figure]:
    """What there is to draw of some comparisons."""
    answered = gather(arms, views)
    figures = [
        *_bars(answered),
        *_costs(answered, lambda row: row.query_ms, "time of a query (ms)", "Accuracy against time"),
        *_costs(answered, lambda row: row.bytes_per_scene, "bytes a scene", "Accuracy against memory"),
        *_recalls(answered),
        *_error_curves(answered),
        *_histograms(answered),
        *_precision(answered),
        *_reliability(answered),
    ]
    return figures


def _bars(answered: Sequence[Answered]) -> Iterator[Figure]:
    """Accuracy with its interval, a bar an arm, the first at the top."""
    traces = []
    for one in answered:
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
        yield {"title": "Accuracy, 95 % interval", "data": traces, "layout": {**layout, "bargap": 0.35}}


def _costs(
    answered: Sequence[Answered], get: Callable[[LocalizationRow], float | None], axis: str, title: str
) -> Iterator[Figure]:
    """Accuracy against what it costs, a point an arm."""
    traces: list[dict[str, Any]] = []
    for one in answered:
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
                    "mode": "markers+text" if len(answered) <= 8 else "markers",
                    "text": [one.arm.name],
                    "textposition": "top center",
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
    """The exponents between which some values lie, with room at both ends."""
    low, high = np.log10([min(values), max(values)])
    return [float(np.floor(low - 0.15)), float(np.ceil(high + 0.15))]


def _recalls(answered: Sequence[Answered]) -> Iterator[Figure]:
    """The share of queries whose place is among the first k, a failure's places among them not."""
    traces = []
    for one in answered:
        ranks = np.array([rank_of(row, truth.place) for row, truth in zip(one.rows, one.truths, strict=True)])
        most = max((len(row.places) for row in one.rows if row), default=0)
        k = np.arange(1, max(most, 1) + 1)
        share = (ranks[None] <= k[:, None]).mean(1)
        traces.append({"arm": one.number, "x": k.tolist(), "y": numbers(share, 4), "mode": "lines+markers"})
    if traces:
        x = {"title": {"text": "k"}, "dtick": 1}
        layout = {"xaxis": x, "yaxis": {**PERCENT, "title": {"text": "right place among the first k"}}}
        yield {"title": "Recall of places", "data": traces, "layout": layout}


def rank_of(row: AnswerRow | None, place: str) -> float:
    """The rank of a place in an answer, 1 the first; infinite where it is not among its places, or it names none."""
    if row is None or row.status not in PLACED:
        return np.inf
    ranked = list(dict.fromkeys(ranked.place for ranked in row.places))
    return ranked.index(place) + 1 if place in ranked else np.inf


def _error_curves(answered: Sequence[Answered]) -> Iterator[Figure]:
    """The share of all queries whose pose error is below a bound; a failure is infinitely far."""
    for name, title, bounds in ERRORS:
        traces = []
        for one in answered:
            errors = getattr(one.judged, name)
            known = np.sort(errors[np.isfinite(errors)])
            if len(known):
                share = np.arange(1, len(known) + 1) / np.count_nonzero(~np.isnan(errors))
                x, y = np.clip([bounds[0], *known, bounds[1]], *bounds), [0.0, *share, share[-1]]
                drawn = {"x": numbers(x), "y": numbers(np.array(y), 4), "mode": "lines", "line": {"shape": "hv"}}
                traces.append({"arm": one.number, **drawn})
        if traces:
            axis = {"type": "log", "title": {"text": title}, "range": np.log10(bounds).tolist(), "dtick": 1}
            layout = {"xaxis": axis, "yaxis": {**PERCENT, "title": {"text": "share of queries"}}}
            yield {"title": f"Cumulative {title.partition(' (')[0]}", "data": traces, "layout": layout}


def _histograms(answered: Sequence[Answered]) -> Iterator[Figure]:
    """How many queries have an error of each size, in bins of equal width on a logarithmic axis; the first and the last
    hold what lies beyond."""
    for name, title, bounds in ERRORS:
        edges = np.geomspace(*bounds, HISTOGRAM_BINS + 1)
        traces = []
        for one in answered:
            errors = getattr(one.judged, name)
            known = np.clip(errors[np.isfinite(errors)], bounds[0], bounds[1])
            if len(known):
                share = np.histogram(known, edges)[0] / np.count_nonzero(~np.isnan(errors))
                x, y = numbers(np.repeat(edges, 2)[1:-1], 4), numbers(np.repeat(share, 2), 4)
                traces.append({"arm": one.number, "x": x, "y": y, "mode": "lines", "fill": "tozeroy"})
        if traces:
            axis = {"type": "log", "title": {"text": title}, "range": np.log10(bounds).tolist(), "dtick": 1}
            y_axis = {"title": {"text": "share of queries"}, "tickformat": ".0%", "rangemode": "tozero"}
            layout = {"xaxis": axis, "yaxis": y_axis}
            yield {"title": f"Distribution of the {title.partition(' (')[0]}", "data": traces, "layout": layout}


def _precision(answered: Sequence[Answered]) -> Iterator[Figure]:
    """Precision against recall of right places among answers above a bound, of arms whose queries are asked of maps
    without their place too."""
    traces = []
    for one in answered:
        judged, present = one.judged, int(one.judged.present.sum())
        if present and not judged.present.all():
            hits, precision = accepted_above(judged.evidence, judged.present & judged.best_place)
            drawn = {"x": numbers(hits / present, 4), "y": numbers(precision, 4), "mode": "lines"}
            traces.append({"arm": one.number, **drawn})
    if traces:
        axes = {"xaxis": "recall: share of the queries in the map", "yaxis": "precision of accepted answers"}
        layout = {axis: {**PERCENT, "title": {"text": text}} for axis, text in axes.items()}
        yield {"title": "Precision against recall", "data": traces, "layout": layout}


def _reliability(answered: Sequence[Answered]) -> Iterator[Figure]:
    """How often answers are right beside the probability that they gave, of arms that give any."""
    traces: list[dict[str, Any]] = []
    for one in answered:
        found = reliability(one.judged.confidence, one.judged.correct)
        if found is not None:
            counts = [f"{count} queries" for count in found.count]
            x, y = numbers(found.confidence, 4), numbers(found.frequency, 4)
            traces.append({"arm": one.number, "x": x, "y": y, "text": counts, "mode": "lines+markers"})
    if traces:
        even = {"x": [0, 1], "y": [0, 1], "mode": "lines", "line": {"color": "#999", "dash": "dot", "width": 1}}
        layout = {
            "xaxis": {**PERCENT, "title": {"text": "probability of the answer"}},
            "yaxis": {**PERCENT, "title": {"text": "share of right answers"}},
        }
        yield {"title": "Reliability", "data": [*traces, {**even, "hoverinfo": "skip"}], "layout": layout}
