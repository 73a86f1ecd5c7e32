"""Write an HTML page to a file: its template, its scripts, and its content as JSON that is safe inside HTML."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from salframe.framework.files.writing import atomic_path
from salframe.panoramas.floors import FloorMasks

FOLDER = Path(__file__).parent
STYLES = ("page.css", "parts.css")
SCRIPTS = ("page.js", "figures.js", "rooms.js", "queries.js", "drawing.js", "detail.js", "walks.js", "main.js")
"""Scripts in assets/, in the order in which they are included."""
Json = dict[str, Any]


def render(template: str, **content: Any) -> str:
    """Return a template of templates/ with its content filled in. Text is escaped."""
    return _environment().get_template(template).render(**content)


def write_page(path: Path, content: Mapping[str, Any], islands: Iterable[tuple[str, str]] = ()) -> None:
    """Write a self-contained page.

    Args:
        path: The file.
        content: The content that is shown on load.
        islands: Pairs of an id and a text: JSON, or a data URL, that the browser reads on demand. Each pair is written
            before the next one is computed.
    """
    page = _environment().get_template("page.html.jinja")
    parts = page.generate(
        title=content["title"],
        subtitle=content["subtitle"],
        style=_read(*STYLES),
        plotly=_read("plotly-basic.min.js"),
        script=_read(*SCRIPTS),
        content=Markup(as_json(content)),
        islands=((id, Markup(text)) for id, text in islands),
    )
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(parts)


def as_json(value: Any) -> str:
    """Return JSON for a script element. `<` is escaped, so that no text ends the element or begins a comment."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def number(value: Any, digits: int = 3) -> float | None:
    """Return a rounded number for JSON; None if it is not finite or None."""
    return round(float(value), digits) if value is not None and math.isfinite(value) else None


def numbers(values: np.ndarray, digits: int = 3) -> list[Any]:
    """Return an array as nested lists of rounded numbers for JSON. A number that is not finite becomes None."""
    rounded = np.round(np.asarray(values, float), digits)
    values_or_none = rounded.astype(object)
    values_or_none[~np.isfinite(rounded)] = None
    return values_or_none.tolist()


def picture(image: np.ndarray, *, quality: int | None = None) -> str:
    """Return an image (h, w, 3) uint8 RGB as a data URL: PNG, or WebP of this quality."""
    import cv2

    suffix, options = (".png", []) if quality is None else (".webp", [cv2.IMWRITE_WEBP_QUALITY, quality])
    code = cv2.imencode(suffix, image[..., ::-1], options)[1].tobytes()
    return f"data:image/{suffix[1:]};base64,{base64.b64encode(code).decode()}"


def floor_plan(floor: FloorMasks) -> Json:
    """Return a floor for JSON.

    Its keys are "box" (left, top, width, height in metres), "picture" (rooms pale, obstacles darker, walls dark,
    outside transparent), "places", and "labels": the name of each place and the point (x, y) in metres inside it that
    is farthest from its border.
    """
    import cv2

    rows, columns = floor.region.shape
    walked = floor.free | (floor.region > 0)
    inside = cv2.morphologyEx(walked.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    grey, alpha = np.full((rows, columns), 90, np.uint8), cv2.dilate(inside, np.ones((5, 5), np.uint8)) * 255
    grey[walked] = 240
    grey[floor.obstacle] = 205
    code = cv2.imencode(".png", np.dstack([grey, grey, grey, alpha]))[1].tobytes()
    return {
        "picture": "data:image/png;base64," + base64.b64encode(code).decode(),
        "box": [*map(float, floor.origin_m), columns * floor.resolution_m, rows * floor.resolution_m],
        "places": sorted(set(floor.regions.values())),
        "labels": [[name, *_middle_m(floor, id)] for id, name in sorted(floor.regions.items())],
    }


def _middle_m(floor: FloorMasks, region: int) -> list[float]:
    """Return the point (x, y) in metres inside a region that is farthest from its border."""
    import cv2

    inside = np.pad((floor.region == region).astype(np.uint8), 1)
    row, column = np.unravel_index(np.argmax(cv2.distanceTransform(inside, cv2.DIST_L2, 3)), inside.shape)
    left_m, top_m = map(float, floor.origin_m)
    middle = left_m + (column - 0.5) * floor.resolution_m, top_m - (row - 0.5) * floor.resolution_m
    return [round(value, 3) for value in middle]


def _read(*names: str) -> Markup:
    """Return the concatenated text of files in assets/."""
    return Markup("\n".join((FOLDER / "assets" / name).read_text(encoding="utf-8") for name in names))


def _environment() -> Environment:
    loader = FileSystemLoader(FOLDER / "templates")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
