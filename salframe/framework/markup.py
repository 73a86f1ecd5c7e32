"""Escaped HTML and inline SVG, for the representations that notebooks show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from unicodedata import category
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

INK, PAPER, LINE = "#282c34", "#ffffff", "#768092"
MARGIN_PX = 12
"""Margin around a drawing in pixels."""
MAX_HEIGHT_PX = 420
"""Maximum height of a drawing in pixels."""
MAX_ROWS = 20
"""Maximum number of rows of a table. If there are more rows, a last row has their number."""


def element(tag: str, text: str = "", children: Iterable[Element] = (), **attributes: str) -> Element:
    """Return an element. `to_html` escapes its text and attributes.

    "_" in the name of an attribute becomes "-". A "_" at the end is removed, which allows names such as `class_`.
    """
    made = Element(tag, {name.rstrip("_").replace("_", "-"): value for name, value in attributes.items()})
    made.text = printable(text)
    made.extend(children)
    return made


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None) -> Element:
    """Return a table of text with at most MAX_ROWS rows."""
    head = element("tr", children=[element("th", heading, style="text-align: left") for heading in headings])
    body = [
        element("tr", children=[element("td", cell, style="text-align: left") for cell in row])
        for row in rows[:MAX_ROWS]
    ]
    if len(rows) > MAX_ROWS:
        more = element("td", f"and {len(rows) - MAX_ROWS} more", colspan=str(len(headings)))
        body.append(element("tr", children=[more]))
    caption = [] if title is None else [element("caption", title)]
    return element("table", children=[*caption, element("thead", children=[head]), element("tbody", children=body)])


def to_html(*elements: Element) -> str:
    """Return elements as HTML, in one `div`."""
    return tostring(element("div", children=elements), encoding="unicode", short_empty_elements=False)


def printable(text: str) -> str:
    """Return a text with U+FFFD instead of control characters and surrogates, which HTML or UTF-8 cannot have."""
    return "".join("\ufffd" if category(c) in ("Cc", "Cs") and c not in "\n\t" else c for c in text)


class PlanDrawing:
    """A drawing from above as inline SVG, at one scale. x points to the right and y up.

    Attributes:
        svg: The element.
    """

    def __init__(self, points_m: np.ndarray, width_px: int = 420, description: str = "plan from above") -> None:
        """Create an empty drawing.

        Args:
            points_m: (N, 2) points that the drawing must contain. Points that are not finite are ignored.
            width_px: Maximum width.
            description: Text for screen readers.
        """
        points_m = np.asarray(points_m, float).reshape(-1, 2)
        points_m = points_m[np.isfinite(points_m).all(1)]
        low, high = (points_m.min(0), points_m.max(0)) if len(points_m) else (np.zeros(2), np.ones(2))
        size_m = np.maximum(high - low, 1.0)
        corner = (low + high - size_m * (1, -1)) / 2  # upper left
        self.scale = float(((np.array([width_px, MAX_HEIGHT_PX]) - 2 * MARGIN_PX) / size_m).min())
        self._corner_m = corner
        width, height = (size_m * self.scale + 2 * MARGIN_PX).round().astype(int).tolist()
        self.svg = Element(
            "svg",
            {
                "xmlns": "http://www.w3.org/2000/svg",
                "width": str(width),
                "height": str(height),
                "viewBox": f"0 0 {width} {height}",
                "role": "img",
                "aria-label": printable(description),
                "style": f"background: {PAPER}; max-width: 100%",
                "font-family": "sans-serif",
                "font-size": "11",
            },
        )

    def pixels(self, points_m: np.ndarray) -> np.ndarray:
        """Return the pixel coordinates (..., 2) of points (..., 2) in metres."""
        return (np.asarray(points_m, float) - self._corner_m) * (self.scale, -self.scale) + MARGIN_PX

    def fill_rings(self, rings_m: Iterable[np.ndarray], **style: str) -> None:
        """Fill the area inside closed rings (K, 2) of points in metres, by the even-odd rule."""
        path = " ".join(f"M{_listed(self.pixels(ring))}Z" for ring in rings_m)
        self._add("path", d=path, fill_rule="evenodd", **style)

    def line(self, points_m: np.ndarray, **style: str) -> None:
        """Draw a line through points (K, 2) in metres."""
        self._add("polyline", points=_listed(self.pixels(points_m)), **{"fill": "none", **style})

    def dot(self, point_m: np.ndarray, radius_px: float, title: str = "", **style: str) -> None:
        """Draw a disk at a point (2,) in metres. Browsers show its title when the pointer is on it."""
        x, y = self.pixels(point_m)
        disk = self._add("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=f"{radius_px:.1f}", **style)
        if title:
            disk.append(element("title", title))

    def arrow(self, point_m: np.ndarray, yaw_rad: float, colour: str, length_px: float = 16.0) -> None:
        """Draw an arrow head at a point (2,) in metres. It points to `yaw_rad`, counter-clockwise from the x axis."""
        turn = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
        head = np.array([(0.6, 0.0), (-0.4, 0.4), (-0.2, 0.0), (-0.4, -0.4)]) * length_px / self.scale
        self.fill_rings([head @ turn.T + np.asarray(point_m)], fill=colour, stroke=PAPER)

    def text(self, point_m: np.ndarray, text: str, **style: str) -> None:
        """Write a text with its middle at a point (2,) in metres."""
        x, y = self.pixels(point_m)
        styles = {"text_anchor": "middle", "fill": INK, **style}
        self._add("text", x=f"{x:.1f}", y=f"{y:.1f}", **styles).text = printable(text)

    def _add(self, tag: str, **attributes: str) -> Element:
        return SubElement(self.svg, tag, {name.replace("_", "-"): value for name, value in attributes.items()})


def _listed(pixels: np.ndarray) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)
