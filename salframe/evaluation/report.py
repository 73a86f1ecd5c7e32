"""The report of a run: one HTML file that needs nothing else, and its accuracy figure as SVG for print."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from salframe.evaluation.evaluate import Evaluation, Measured
from salframe.evaluation.reported import Reported
from salframe.framework.files import write_text
from salframe.panoramas.floors import FloorMasks

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f", "#8c6d31")
"""Okabe and Ito's palette, told apart by colour-blind readers; the first for the first method."""
RIGHT, WRONG = COLOURS[0], COLOURS[1]

Figure = dict[str, Any]
"""A Plotly figure as JSON: {"title": ..., "data": [...], "layout": {...}}; "wide" where it needs the width of the page."""


def write_report(
    path: Path, title: str, evaluation: Evaluation, floors: Sequence[FloorMasks], reported: Sequence[Reported] = ()
) -> None:
    """Write the report to `path` and the accuracy figure to accuracy.svg beside it; `reported` gets a section of its
    own at the end."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).with_name("templates")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    colours = {method.label: COLOURS[i % len(COLOURS)] for i, method in enumerate(evaluation.methods)}
    done = [method for method in evaluation.methods if method.done]
    accuracy = ""
    if done:
        accuracy = environment.get_template("accuracy.svg.jinja").render(
            rows=[method.row for method in done], colours=colours
        )
        write_text(path.with_name("accuracy.svg"), accuracy)
    figures = [*_error_curves(done, colours), *(_floor_plan(floor, evaluation, done) for floor in floors if done)]
    page = environment.get_template("report.html.jinja").render(
        title=title,
        rows=[method.row for method in evaluation.methods],
        colours=colours,
        queries=len(evaluation.queries),
        accuracy=Markup(accuracy),
        figures=Markup(json.dumps(figures).replace("</", "<\\/")),
        figure_count=len(figures),
        plotly=Markup(get_plotlyjs()),
        answers={method.label: list(_answers(evaluation, method)) for method in done},
        reported=reported,
    )
    write_text(path, page)


def _error_curves(methods: Sequence[Measured], colours: dict[str, str]) -> Iterator[Figure]:
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


def _floor_plan(floor: FloorMasks, evaluation: Evaluation, methods: Sequence[Measured]) -> Figure:
    """Where the queries of a floor were taken and what each method made of them, one method shown at a time."""
    places = set(floor.regions.values())
    position_m = {
        i: truth.T_world_pano[:2, 3].tolist()
        for i, truth in enumerate(evaluation.truths)
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
                    "text": [
                        f"{evaluation.queries[i]}<br>{evaluation.truths[i].place}<br>answer: {_first_place(method.answers[i])}"
                        for i in chosen
                    ],
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


def floor_picture(floor: FloorMasks) -> str:
    """The floor as a data URL: floor light, obstacles grey, walls dark, outside white."""
    inside = cv2.morphologyEx(
        (floor.free | (floor.region > 0)).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )
    image = np.full((*floor.region.shape, 3), 255, np.uint8)
    image[cv2.dilate(inside, np.ones((5, 5), np.uint8)) > 0] = 90
    image[floor.free | (floor.region > 0)] = (238, 243, 245)
    image[floor.obstacle] = (205, 200, 196)
    return "data:image/png;base64," + base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()


def _first_place(answer: dict[str, Any] | None) -> str:
    return answer["places"][0][1] if answer and answer["places"] else "none"


def _answers(evaluation: Evaluation, method: Measured) -> Iterator[dict[str, Any]]:
    """The rows of a method's table of queries; errors are None where there is no pose."""
    for i, (query, truth, answer) in enumerate(zip(evaluation.queries, evaluation.truths, method.answers, strict=True)):
        translation_m, rotation_deg = (
            float(x) if np.isfinite(x) else None
            for x in (method.judged.translation_m[i], method.judged.rotation_deg[i])
        )
        yield {
            "query": query,
            "truth": truth.place,
            "answer": _first_place(answer),
            "correct": bool(method.judged.correct[i]),
            "status": method.judged.statuses[i],
            "translation_m": translation_m,
            "rotation_deg": rotation_deg,
            "error": answer["error"] if answer else None,
        }
