"""The report of a run: one HTML file with the table and every trajectory, on the floor plan or the viewpoint graph."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from salframe.evaluation.report import floor_picture
from salframe.framework.files import write_text
from salframe.navigation.walk import Row
from salframe.topology.topological_map import TopologicalMap

_MARGIN_M = 1.0


def write_report(
    path: Path,
    title: str,
    table: Sequence[Mapping[str, Any]],
    rows: Mapping[str, Mapping[int, Row]],
    maps: Mapping[str, TopologicalMap],
) -> None:
    """Write the report: the methods' rows of the table, their episodes by label and number, and the map of each world."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parents[1] / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    episodes = {
        label: [walked for walked in of_method.values() if walked["status"] != "crashed"]
        for label, of_method in rows.items()
    }
    walked_in = {walked["world"] for of_method in episodes.values() for walked in of_method}
    content = {"worlds": {id: _plan(map) for id, map in maps.items() if id in walked_in}, "episodes": episodes}
    page = environment.get_template("navigation.html.jinja").render(
        title=title, rows=table, content=Markup(json.dumps(content).replace("</", "<\\/"))
    )
    write_text(path, page)


def _plan(map: TopologicalMap) -> dict[str, Any]:
    """What is drawn below trajectories: `box` left, top, width, height in metres, with a picture of it; without masks
    the map's edges."""
    place = {node.id: [round(node.xyz_m[0], 3), round(node.xyz_m[1], 3)] for node in map.nodes}
    if map.floors:
        floor = map.floors[0]
        rows, columns = floor.region.shape
        box = [*floor.origin_m, columns * floor.resolution_m, rows * floor.resolution_m]
        return {"box": box, "picture": floor_picture(floor), "edges": [], "nodes": place}
    low, high = np.min(list(place.values()), 0) - _MARGIN_M, np.max(list(place.values()), 0) + _MARGIN_M
    edges = [[*place[edge.start], *place[edge.end]] for edge in map.edges]
    return {"box": [low[0], high[1], *(high - low).tolist()], "picture": None, "edges": edges, "nodes": place}
