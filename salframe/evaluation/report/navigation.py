"""The report of a navigation run: the table and every trajectory, on the floor plan or the viewpoint graph."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from salframe.evaluation.report.page import floor_picture, render_page
from salframe.evaluation.result import Result
from salframe.evaluation.task import Record
from salframe.framework.files import write_text
from salframe.topology.topological_map import TopologicalMap

_MARGIN_M = 1.0


def write_report(result: Result[Any], records: Sequence[Record], maps: Mapping[str, TopologicalMap]) -> Path:
    """Write navigation.html into the run's folder, with the map of each world; its path."""
    path = result.run / "navigation.html"
    episodes = {record.label: [row for row in record.rows if row is not None and "path" in row] for record in records}
    walked_in = {row["world"] for rows in episodes.values() for row in rows}
    content = {"worlds": {id: _plan(map) for id, map in maps.items() if id in walked_in}, "episodes": episodes}
    page = render_page(
        "navigation.html.jinja",
        title=result.run.name,
        rows=result.rows,
        notes=result.notes,
        content=Markup(json.dumps(content).replace("</", "<\\/")),
    )
    write_text(path, page)
    return path


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
