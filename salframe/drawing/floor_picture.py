"""Draw a picture of a topological map: floor, regions, nodes, and edges with their lengths and azimuths."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from salframe.drawing.floor_colours import floor_colours
from salframe.framework.files.writing import atomic_path, check_picture_output
from salframe.panoramas.floors import FloorMasks, find_floor
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap

if TYPE_CHECKING:
    from PIL import Image
    from PIL.ImageFont import FreeTypeFont, ImageFont

_SMOOTH = 2  # factor by which the drawing is enlarged before it is reduced for smooth lines
_LONG_SIDE, _MIN_SCALE, _MAX_SCALE = 3200, 30.0, 110.0  # pixels, and pixels per metre
_MARGIN, _HEADER, _FOOTER = 40, 72, 90
_INK, _PAPER = (40, 44, 52), (255, 255, 255)
_SCENE, _TRANSITION, _SIGHT, _BENT = (31, 78, 160), (214, 84, 34), (70, 98, 150), (176, 98, 8)


def draw_topology(topology: TopologicalMap, path: str | Path) -> None:
    """Write a PNG of the map. The floors are drawn below each other, the top floor first.

    The label of an edge states its length and its azimuth. The azimuth is the direction of a walk along the edge, in
    the direction in which the label is read. A label without room is left out.

    Raises:
        ConfigError: The path names an existing file that is not a PNG.
    """
    from PIL import Image

    check_picture_output(Path(path))

    panels = [_Panel(topology, number).image for number in reversed(range(len(topology.floors)))]
    picture = Image.new("RGB", (max(panel.width for panel in panels), sum(panel.height for panel in panels)), _PAPER)
    top = 0
    for panel in panels:
        picture.paste(panel, (0, top))
        top += panel.height
    with atomic_path(Path(path)) as temporary:
        picture.save(temporary, "PNG", optimize=True)


class _Panel:
    """The picture of one floor. Lengths are in pixels of the enlarged drawing, except lengths whose names end in _m."""

    def __init__(self, topology: TopologicalMap, number: int) -> None:
        from PIL import Image, ImageDraw

        floor = topology.floors[number]
        low, high = _extent(floor)
        width_m, height_m = high - low
        scale = float(np.clip(_LONG_SIDE / max(width_m, height_m), _MIN_SCALE, _MAX_SCALE))
        self._scale = scale * _SMOOTH
        self._corner_m = np.array([low[0], high[1]])
        self._top_left = np.array([_MARGIN, _HEADER]) * _SMOOTH
        size = (max(int(width_m * scale), 620) + 2 * _MARGIN, int(height_m * scale) + _HEADER + _FOOTER)
        self.image = Image.new("RGB", (size[0] * _SMOOTH, size[1] * _SMOOTH), _PAPER)
        self._draw = ImageDraw.Draw(self.image)
        self._taken = np.zeros((size[1], size[0]), bool)

        nodes = [node for node in topology.nodes if find_floor(topology.floors, np.array(node.xyz_m)) == number]
        place = {node.id: self._pixel(node.xyz_m[:2]) for node in nodes}
        edges = [edge for edge in topology.edges if edge.start in place and edge.end in place]
        self._draw_floor(floor, low, high)
        for edge in sorted(edges, key=lambda edge: -edge.length_m):
            line = [tuple(self._pixel(point)) for point in edge.path_m] or [
                tuple(place[edge.start]),
                tuple(place[edge.end]),
            ]
            self._draw.line(line, _BENT if edge.path_m else _SIGHT, 3 if edge.path_m else 2, "curve")
        for node in nodes:
            self._mark_node(node, place[node.id])
        self._name_regions(floor, nodes, place)
        labelled = self._label_edges(edges, place)
        self._draw_legend(floor, len(topology.floors), nodes, edges, labelled, size)
        self.image = self.image.resize(size, Image.Resampling.LANCZOS)

    def _pixel(self, xy_m: Iterable[float]) -> np.ndarray:
        return (np.asarray(tuple(xy_m)) - self._corner_m) * (self._scale, -self._scale) + self._top_left

    def _draw_floor(self, floor: FloorMasks, low: np.ndarray, high: np.ndarray) -> None:
        """Draw the floor in the colours of `floor_colours`."""
        from PIL import Image

        row, column = _rows_columns(floor, low, high)
        image = Image.fromarray(floor_colours(floor)[row, column])
        factor = max(1, round(floor.resolution_m * self._scale))
        size = (
            round(image.width * floor.resolution_m * self._scale),
            round(image.height * floor.resolution_m * self._scale),
        )
        image = image.resize((image.width * factor, image.height * factor), Image.Resampling.NEAREST).resize(
            size, Image.Resampling.BOX
        )
        corner = self._pixel(
            (floor.origin_m[0] + column.start * floor.resolution_m, floor.origin_m[1] - row.start * floor.resolution_m)
        )
        self.image.paste(image, tuple(np.round(corner).astype(int)))

    def _mark_node(self, node: MapNode, at: np.ndarray) -> None:
        (x, y), r = at, 7 * _SMOOTH
        if node.kind is NodeKind.SCENE:
            self._draw.ellipse((x - r, y - r, x + r, y + r), _SCENE, _PAPER, _SMOOTH)
        else:
            self._draw.polygon([(x, y - r), (x + r, y), (x, y + r), (x - r, y)], _TRANSITION, _PAPER, _SMOOTH)
        self._take(at, np.array([2.4 * r, 2.4 * r]), 0.0)

    def _name_regions(self, floor: FloorMasks, nodes: list[MapNode], place: dict[str, np.ndarray]) -> None:
        """Write the name of each region near its first scene node; near the middle of the region if it has no scene
        node."""
        for label, name in floor.regions.items():
            rows, columns = np.nonzero((floor.region == label) & floor.free)
            if not len(rows):
                continue
            middle = (
                floor.origin_m[0] + columns.mean() * floor.resolution_m,
                floor.origin_m[1] - rows.mean() * floor.resolution_m,
            )
            at = next(
                (place[node.id] for node in nodes if node.kind is NodeKind.SCENE and name in node.regions),
                self._pixel(middle),
            )
            text = self._text(name, 18, _INK)
            offsets = [(0, dy) for dy in (-1, 1, -2, 2)] + [(dx, dy) for dy in (-1, 1, 0) for dx in (-0.55, 0.55)]
            spots = [at + np.array([dx * text.width, dy * 22 * _SMOOTH]) for dx, dy in offsets]
            free = [spot for spot in spots if self._is_free(spot, np.array(text.size), 0.0)]
            self._put(text, (free or spots)[0])
            self._take((free or spots)[0], np.array(text.size), 0.0)

    def _label_edges(self, edges: list[MapEdge], place: dict[str, np.ndarray]) -> int:
        """Write length and azimuth along each edge, shortest edges first, and return the number of labelled edges. An
        edge gets no label if it passes another node, or if there is no room."""
        labelled = 0
        nodes = np.array(list(place.values()))
        for edge in sorted(edges, key=lambda edge: edge.length_m):
            line = np.array([self._pixel(point) for point in edge.path_m] or [place[edge.start], place[edge.end]])
            segment = int(np.linalg.norm(np.diff(line, axis=0), axis=1).argmax())
            first, second = line[segment], line[segment + 1]
            azimuth_deg = round(float(np.degrees(edge.azimuth_rad)))
            if second[0] < first[0]:
                first, second, azimuth_deg = second, first, azimuth_deg - 180
            along = second - first
            text = self._text(
                f"{edge.length_m:.1f} m, {(azimuth_deg + 180) % 360 - 180}°", 14, _BENT if edge.path_m else _SIGHT
            )
            size, angle = np.array(text.size), float(np.arctan2(along[1], along[0]))
            if size[0] > 0.9 * np.hypot(*along) or _passes_by(first, second, nodes, 10 * _SMOOTH):
                continue
            spot = next(
                (s for s in (first + share * along for share in (0.5, 0.35, 0.65)) if self._is_free(s, size, angle)),
                None,
            )
            if spot is not None:
                self._put(text, spot, angle)
                self._take(spot, size, angle)
                labelled += 1
        return labelled

    def _draw_legend(
        self,
        floor: FloorMasks,
        floors: int,
        nodes: list[MapNode],
        edges: list[MapEdge],
        labelled: int,
        size: tuple[int, int],
    ) -> None:
        """Draw the title above the floor. Draw the legend, a scale bar and the axes of the world below the floor."""
        s = _SMOOTH
        scenes, bent = sum(node.kind is NodeKind.SCENE for node in nodes), sum(bool(edge.path_m) for edge in edges)
        which = f"Floor at z = {floor.z_m:.2f} m" if floors > 1 else "Topological map"
        title = f"{which}: {len(floor.regions)} regions, {len(nodes)} nodes, {len(edges)} edges"
        self._write(title, (_MARGIN * s, 10 * s), 24)
        note = "" if labelled == len(edges) else f" ({labelled} of {len(edges)} edges have room for a label)"
        note = f"Label of an edge: its length, and its azimuth (from x towards y) in reading direction{note}."
        self._write(note, (_MARGIN * s, 42 * s), 15)
        x, y, r = float(_MARGIN * s), (size[1] - _FOOTER + 34) * s, 6 * s
        self._draw.ellipse((x, y - r, x + 2 * r, y + r), _SCENE)
        x = self._write(f"scene node ({scenes})", (x + 2 * r + 6 * s, y - 9 * s), 16) + 20 * s
        self._draw.polygon([(x + r, y - r), (x + 2 * r, y), (x + r, y + r), (x, y)], _TRANSITION)
        x = self._write(f"transition node ({len(nodes) - scenes})", (x + 2 * r + 6 * s, y - 9 * s), 16) + 20 * s
        x, y = float(_MARGIN * s), y + 28 * s
        self._draw.line([(x, y), (x + 24 * s, y)], _SIGHT, 2 * s)
        x = self._write(f"straight edge ({len(edges) - bent})", (x + 30 * s, y - 9 * s), 16) + 20 * s
        self._draw.line([(x, y), (x + 12 * s, y - 5 * s), (x + 24 * s, y)], _BENT, 2 * s)
        self._write(f"edge around corners ({bent})", (x + 30 * s, y - 9 * s), 16)
        bar_m = next(metres for metres in (10, 5, 2, 1) if metres * self._scale <= 260 * s or metres == 1)
        right = (size[0] - _MARGIN) * s
        self._draw.rectangle((right - 110 * s - bar_m * self._scale, y - 3 * s, right - 110 * s, y + 3 * s), _INK)
        self._write(f"{bar_m} m", (right - 110 * s - bar_m * self._scale, y - 26 * s), 16)
        for tip, name in (((44, 0), "x"), ((0, -44), "y")):
            self._draw_arrow(np.array([right - 60 * s, y + 4 * s]), np.array(tip) * s, name)

    def _draw_arrow(self, start: np.ndarray, along: np.ndarray, name: str) -> None:
        end, unit = start + along, along / np.hypot(*along)
        across = np.array([-unit[1], unit[0]])
        self._draw.line([tuple(start), tuple(end)], _INK, 2 * _SMOOTH)
        head = [end + 8 * _SMOOTH * unit, end + 4 * _SMOOTH * across, end - 4 * _SMOOTH * across]
        self._draw.polygon([tuple(point) for point in head], _INK)
        x, y = end + 16 * _SMOOTH * unit
        self._draw.text((x, y), name, _INK, _font(16), "mm")

    def _write(self, text: str, at: tuple[float, float], points: int) -> float:
        """Write text with its upper left corner at a pixel. Return the x coordinate of its right end."""
        self._draw.text(at, text, _INK, _font(points))
        return at[0] + self._draw.textlength(text, _font(points))

    def _text(self, text: str, points: int, colour: tuple[int, int, int]) -> Image.Image:
        """Return an image of a text with a light rim on a light background. Without them, a line behind the text could
        look like a minus sign."""
        from PIL import Image, ImageDraw

        rim = _SMOOTH
        left, top, right, bottom = _font(points).getbbox(text, stroke_width=rim)
        image = Image.new("RGBA", (int(right - left) + 2, int(bottom - top) + 2), (255, 255, 255, 170))
        ImageDraw.Draw(image).text(
            (1 - left, 1 - top), text, colour, _font(points), stroke_width=rim, stroke_fill=(255, 255, 255)
        )
        return image

    def _put(self, text: Image.Image, centre: np.ndarray, angle: float = 0.0) -> None:
        """Paste text rotated by an angle (radians, clockwise in the picture)."""
        from PIL import Image

        turned = text.rotate(-np.degrees(angle), Image.Resampling.BICUBIC, expand=True) if angle else text
        x, y = np.round(centre - np.array(turned.size) / 2).astype(int)
        self.image.paste(turned, (int(x), int(y)), turned)

    def _cells(self, centre: np.ndarray, size: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows and columns of pixels, in the picture that is not enlarged, that a rotated rectangle covers.

        Args:
            centre: (2,) centre (x, y) of the rectangle.
            size: (2,) width and height of the rectangle.
            angle: Rotation in radians, clockwise in the picture.
        """
        u, v = (np.arange(-extent / 2, extent / 2 + _SMOOTH, _SMOOTH) for extent in size)
        u, v = (side.ravel() for side in np.meshgrid(u, v))
        x, y = centre[0] + u * np.cos(angle) - v * np.sin(angle), centre[1] + u * np.sin(angle) + v * np.cos(angle)
        rows, columns = self._taken.shape
        return np.clip(y / _SMOOTH, 0, rows - 1).astype(int), np.clip(x / _SMOOTH, 0, columns - 1).astype(int)

    def _is_free(self, centre: np.ndarray, size: np.ndarray, angle: float) -> bool:
        return not self._taken[self._cells(centre, size, angle)].any()

    def _take(self, centre: np.ndarray, size: np.ndarray, angle: float) -> None:
        self._taken[self._cells(centre, size, angle)] = True


def _passes_by(first: np.ndarray, second: np.ndarray, nodes: np.ndarray, near: float) -> bool:
    """Return whether any of the nodes (N, 2) is within `near` pixels of the line between two points. Nodes at the ends
    of the line are ignored."""
    along = second - first
    length = float(np.hypot(*along))
    share = (nodes - first) @ along / length
    away = np.abs((nodes - first) @ (-along[1], along[0])) / length
    return bool(((share > near) & (share < length - near) & (away < near)).any())


def _extent(floor: FloorMasks) -> tuple[np.ndarray, np.ndarray]:
    """Return the minimum and maximum (x, y) in metres of the floor, with a margin of 0.3 m."""
    rows, columns = np.nonzero(floor.free | (floor.region > 0))
    left_m, top_m = floor.origin_m
    low = np.array([left_m + columns.min() * floor.resolution_m, top_m - (rows.max() + 1) * floor.resolution_m])
    high = np.array([left_m + (columns.max() + 1) * floor.resolution_m, top_m - rows.min() * floor.resolution_m])
    return low - 0.3, high + 0.3


def _rows_columns(floor: FloorMasks, low: np.ndarray, high: np.ndarray) -> tuple[slice, slice]:
    """Return the rows and columns of the pixels of a floor between two corners (x, y) in metres."""
    left, right = ((x - floor.origin_m[0]) / floor.resolution_m for x in (low[0], high[0]))
    top, bottom = ((floor.origin_m[1] - y) / floor.resolution_m for y in (high[1], low[1]))
    rows, columns = floor.free.shape
    return slice(max(0, round(top)), min(rows, round(bottom))), slice(max(0, round(left)), min(columns, round(right)))


@cache
def _font(points: int) -> FreeTypeFont | ImageFont:
    from PIL import ImageFont

    return ImageFont.load_default(points * _SMOOTH)
