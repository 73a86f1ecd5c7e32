"""The report of a comparison: table, error curves, floor plans, every answer; the accuracy figure as SVG for print."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from salframe.evaluation.metrics import Judged, reliability
from salframe.evaluation.report.page import COLOURS, floor_picture, render_page
from salframe.evaluation.result import Result
from salframe.evaluation.run import Row
from salframe.evaluation.task import Record
from salframe.framework.files import write_text
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Truth

RIGHT, WRONG = COLOURS[0], COLOURS[1]

Figure = dict[str, Any]
"""A Plotly figure as JSON: {"title": ..., "data": [...], "layout": {...}}; "wide" where it needs the page's width."""


@dataclass(frozen=True, eq=False)
class _Method:
    """A measured method: its answers in the order of the queries, and how they were judged."""

    label: str
    answers: Sequence[Row | None]
    judged: Judged


@dataclass(frozen=True, eq=False)
class Queries:
    """What was asked: ids, what is true of each, and the floors that they lie on."""

    ids: Sequence[str]
    truths: Sequence[Truth]
    floors: Sequence[FloorMasks]


def write_report(result: Result[Any], queries: Queries, records: Sequence[Record], judged: Sequence[Judged]) -> Path:
    """Write report.html and accuracy.svg into the run's folder; the path of the former."""
    path = result.run / "report.html"
    colours = {row.method: COLOURS[i % len(COLOURS)] for i, row in enumerate(result.rows)}
    paired = zip(records, judged, strict=True)
    done = [_Method(record.label, record.rows, found) for record, found in paired if record.done]
    accuracy = ""
    if done:
        measured = [row for row in result.rows if row.measured]
        accuracy = render_page("accuracy.svg.jinja", rows=measured, colours=colours)
        write_text(path.with_name("accuracy.svg"), accuracy)
    floors = queries.floors if done else ()
    figures = [
        *_error_curves(done, colours),
        *_reliability_diagram(done, colours),
        *(_floor_plan(floor, queries, done) for floor in floors),
    ]
    page = render_page(
        "report.html.jinja",
        title=result.run.name,
        rows=result.rows,
        colours=colours,
        queries=len(queries.ids),
        notes=result.notes,
        accuracy=Markup(accuracy),
        figures=Markup(json.dumps(figures).replace("</", "<\\/")),
        figure_count=len(figures),
        plotly=Markup(get_plotlyjs()),
        answers={method.label: list(_answers(queries, method)) for method in done},
        reported=result.reported,
    )
    write_text(path, page)
    return path


def _error_curves(methods: Sequence[_Method], colours: dict[str, str]) -> Iterator[Figure]:
    """The share of all queries whose pose error is below a bound; a failure is infinitely far."""
    for name, title, bounds in (
        ("translation_m", "translation error (m)", (0.01, 20)),
        ("rotation_deg", "rotation error (degrees)", (0.1, 180)),
    ):
        traces = []
        for method in methods:
            errors = getattr(method.judged, name)
            known = np.sort(errors[np.isfinite(errors)])
            if len(known):
                share = np.arange(1, len(known) + 1) / np.count_nonzero(~np.isnan(errors))
                x = np.clip([bounds[0], *known, bounds[1]], *bounds)
                y = [0.0, *share, share[-1]]
                line = {"shape": "hv", "color": colours[method.label]}
                traces.append({"x": x.tolist(), "y": y, "name": method.label, "mode": "lines", "line": line})
        if traces:
            axis = {"type": "log", "title": {"text": title}, "range": np.log10(bounds).tolist()}
            layout = {
                "xaxis": axis,
                "yaxis": {"title": {"text": "share of queries"}, "range": [0, 1.02], "tickformat": ".0%"},
            }
            yield {"title": f"Cumulative {title.partition(' (')[0]}", "data": traces, "layout": layout}


def _reliability_diagram(methods: Sequence[_Method], colours: dict[str, str]) -> Iterator[Figure]:
    """How often answers are right beside the probability that they gave, of methods that give any."""
    traces: list[dict[str, Any]] = []
    for method in methods:
        found = reliability(method.judged)
        if found is not None:
            line = {"color": colours[method.label]}
            counts = [f"{count} queries" for count in found.count]
            x, y = found.confidence.tolist(), found.frequency.tolist()
            traces.append({"x": x, "y": y, "text": counts, "name": method.label, "mode": "lines+markers", "line": line})
    if traces:
        even = {"color": "#999", "dash": "dot"}
        traces.append({"x": [0, 1], "y": [0, 1], "name": "calibrated", "mode": "lines", "line": even})
        layout = {
            "xaxis": {"title": {"text": "probability of the answer"}, "range": [0, 1.02], "tickformat": ".0%"},
            "yaxis": {"title": {"text": "share of right answers"}, "range": [0, 1.02], "tickformat": ".0%"},
        }
        yield {"title": "Reliability", "data": traces, "layout": layout}


def _floor_plan(floor: FloorMasks, queries: Queries, methods: Sequence[_Method]) -> Figure:
    """Where the queries of a floor were taken and what each method made of them, one method shown at a time."""
    places = set(floor.regions.values())
    position_m = {
        i: truth.T_world_pano[:2, 3].tolist()
        for i, truth in enumerate(queries.truths)
        if truth.place in places and truth.T_world_pano is not None
    }
    traces, buttons = [], []
    for method in methods:
        for correct, colour, symbol in ((True, RIGHT, "circle"), (False, WRONG, "x")):
            chosen = [i for i in position_m if method.judged.correct[i] == correct]
            traces.append(
                {
                    "x": [position_m[i][0] for i in chosen],
                    "y": [position_m[i][1] for i in chosen],
                    "text": [_label(queries, method, i) for i in chosen],
                    "name": f"{'right' if correct else 'wrong'} ({len(chosen)})",
                    "mode": "markers",
                    "hoverinfo": "text",
                    "marker": {"color": colour, "symbol": symbol, "size": 9},
                    "visible": method is methods[0],
                }
            )
        shown = [other is method for other in methods for _ in range(2)]
        buttons.append({"label": method.label, "method": "restyle", "args": [{"visible": shown}]})
    rows, columns = floor.region.shape
    width_m, height_m = columns * floor.resolution_m, rows * floor.resolution_m
    left_m, top_m = floor.origin_m
    picture = {
        "source": floor_picture(floor),
        "xref": "x",
        "yref": "y",
        "x": left_m,
        "y": top_m,
        "sizex": width_m,
        "sizey": height_m,
        "sizing": "stretch",
        "layer": "below",
    }
    layout = {
        "images": [picture],
        "xaxis": {
            "title": {"text": "x (m)"},
            "range": [left_m, left_m + width_m],
            "constrain": "domain",
            "showgrid": False,
            "zeroline": False,
        },
        "yaxis": {
            "title": {"text": "y (m)"},
            "range": [top_m - height_m, top_m],
            "scaleanchor": "x",
            "showgrid": False,
            "zeroline": False,
        },
        "updatemenus": [
            {
                "type": "buttons",
                "direction": "right",
                "buttons": buttons,
                "x": 1,
                "y": 1,
                "xanchor": "right",
                "yanchor": "bottom",
            }
        ],
        "height": int(np.clip(1000 * height_m / width_m + 140, 320, 900)),
    }
    return {"title": "Queries on the floor plan", "data": traces, "layout": layout, "wide": True}


def _first_place(answer: Row | None) -> str:
    return answer["places"][0][1] if answer and answer["places"] else "none"


def _label(queries: Queries, method: _Method, i: int) -> str:
    return f"{queries.ids[i]}<br>{queries.truths[i].place}<br>answer: {_first_place(method.answers[i])}"


def _answers(queries: Queries, method: _Method) -> Iterator[dict[str, Any]]:
    """The rows of a method's table of queries; errors are None where there is no pose."""
    judged = method.judged
    for i, (query, truth, answer) in enumerate(zip(queries.ids, queries.truths, method.answers, strict=True)):
        error_m, error_deg = float(judged.translation_m[i]), float(judged.rotation_deg[i])
        yield {
            "query": query,
            "truth": truth.place,
            "answer": _first_place(answer),
            "correct": bool(judged.correct[i]),
            "status": judged.statuses[i],
            "translation_m": error_m if np.isfinite(error_m) else None,
            "rotation_deg": error_deg if np.isfinite(error_deg) else None,
            "error": answer["error"] if answer else None,
        }
