"""Draw a picture of detections: outlines, names and scores on the image, the graph viewed from above, and a table."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from salframe.drawing.canvas import FAINT, INK, PAPER, Colour, fill_translucent, font, stroke
from salframe.drawing.outlines import outline_objects
from salframe.drawing.plan import Plan
from salframe.drawing.text_placer import TextPlacer
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import rays_to_pixels

MIN_WIDTH, MAX_WIDTH = 1280, 2560
"""Minimum and maximum width of the picture in pixels. Smaller images are enlarged, and larger images are reduced, by an
integer factor, so that names are readable."""
MAX_NAMES, MANY_OBJECTS = 40, 24
"""Maximum number of objects with a name on the image (the largest objects), and number of objects above which a smaller
font is used."""
COLOURS: tuple[Colour, ...] = (
    (230, 57, 70),
    (29, 120, 200),
    (42, 157, 90),
    (244, 140, 30),
    (131, 76, 190),
    (0, 160, 170),
    (214, 51, 132),
    (150, 108, 40),
    (242, 196, 36),
    (92, 110, 240),
    (120, 180, 40),
    (180, 50, 30),
    (60, 190, 240),
    (200, 120, 220),
    (20, 110, 90),
    (250, 128, 114),
    (110, 60, 110),
    (70, 200, 140),
    (190, 160, 90),
    (90, 90, 100),
)


def draw_objects(
    rgb: np.ndarray,
    detections: Detections,
    *,
    saliency: np.ndarray | None = None,
    graph: SaliencyGraph | None = None,
    camera: Camera | None = None,
    title: str = "",
) -> np.ndarray:
    """Draw a picture of detections: the image with outlines and names, the graph viewed from above, and a table.

    Args:
        rgb: (H, W, 3) uint8, an equirectangular panorama, or the photograph of `camera`.
        detections: N detections. They are in the panorama frame, for a photograph too.
        saliency: (N,) float64, saliency of the detections; None if it is unknown.
        graph: Saliency graph of the detections; None: the bearings are drawn in its place.
        camera: The camera of a photograph; None for a panorama.
        title: Title above the image.

    Returns:
        (h, w, 3) uint8: from top to bottom the title, the image with outlines, labels and scores, and the graph beside
        the table.
    """
    import cv2

    height, width = rgb.shape[:2]
    factor = -(-MIN_WIDTH // width) if width < MIN_WIDTH else 1 / -(-width // MAX_WIDTH)
    colours = choose_colours(detections.labels)
    lines = [[line * factor for line in parts] for parts in find_lines(height, detections, camera)]
    width, height = round(width * factor), round(height * factor)
    image = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC)
    image = name_objects(draw_outlines(image, detections, lines, colours), detections, lines, colours)
    side = width // 2
    plan = Plan(detections, graph, colours, side, camera).image
    table = _table(detections, saliency, colours, width - side, side)
    ruler = [_ruler(width)] if camera is None else []
    return np.vstack([_title(title, width), image, *ruler, np.hstack([plan, table])])


def choose_colours(labels: Iterable[str]) -> dict[str, Colour]:
    """Return a colour for each label.

    A label has the same colour in every picture, except if another label of the same picture already has this colour.
    """
    chosen: dict[str, int] = {}
    for label in sorted(set(labels)):
        first = zlib.crc32(label.encode()) % len(COLOURS)
        turn = [(first + step) % len(COLOURS) for step in range(len(COLOURS))]
        chosen[label] = next((index for index in turn if index not in chosen.values()), first)
    return {label: COLOURS[index] for label, index in chosen.items()}


def find_lines(height: int, detections: Detections, camera: Camera | None = None) -> list[list[np.ndarray]]:
    """Return the outlines of objects in an image.

    Args:
        height: Height of the image in pixels.
        detections: N detections.
        camera: The camera of a photograph; None for a panorama.

    Returns:
        For each object, the closed lines around its parts, each (K, 2), as (x, y) in pixels (centre of the first pixel:
        (0.5, 0.5)). If only the bearing of an object is known, the line is a single point.
    """
    outlines = []
    for rays, bearing in zip(outline_objects(detections), detections.bearing, strict=True):
        outlines.append([line for part in rays or [bearing[None]] for line in _project(part, height, camera)])
    return outlines


def draw_outlines(
    rgb: np.ndarray, detections: Detections, lines: list[list[np.ndarray]], colours: dict[str, Colour]
) -> np.ndarray:
    """Return an image (H, W, 3) uint8 with the outlines of objects. The areas of the objects have translucent colours.

    Args:
        rgb: (H, W, 3) uint8.
        detections: N detections.
        lines: Outlines of each object, as `find_lines` returns them.
        colours: Colour of each label.
    """
    order = _by_area(lines)
    polygons = [(line, colours[detections.labels[i]]) for i in order for line in lines[i]]
    image = fill_translucent(rgb, polygons, 0.25)
    for line, colour in polygons:
        stroke(image, line, PAPER, _letters(rgb) / 4.5, closed=True)
        stroke(image, line, colour, _letters(rgb) / 8, closed=True)
    return image


def name_objects(
    image: np.ndarray, detections: Detections, lines: list[list[np.ndarray]], colours: dict[str, Colour]
) -> np.ndarray:
    """Return an image (H, W, 3) uint8 with the labels and scores of the largest objects. Arguments are those of
    `draw_outlines`."""
    height, width = image.shape[:2]
    has_many = len(detections) > MANY_OBJECTS
    placer = TextPlacer(width, height, round(_letters(image) * (0.8 if has_many else 1)))
    for i in _by_area(lines)[:MAX_NAMES]:
        label, spot = detections.labels[i], _spot(lines[i], width, height)
        if spot is not None:
            placer.put(f"{label} {detections.scores[i]:.2f}", colours[label], *spot)
    return placer.draw(image)


def _letters(image: np.ndarray) -> int:
    """Return the size of letters on an image, in pixels."""
    return max(16, round(image.shape[1] / 100))


def _by_area(lines: list[list[np.ndarray]]) -> np.ndarray:
    """Return the indices of objects, largest first."""
    import cv2

    areas = [sum(cv2.contourArea(line.astype(np.float32)) for line in parts) for parts in lines]
    return np.argsort([-area for area in areas], kind="stable")


def _project(rays: np.ndarray, height: int, camera: Camera | None) -> Iterator[np.ndarray]:
    """Yield the projections of a closed line of rays (K, 3) to the image: polygons (K', 2), as (x, y) in pixels.

    The border of a panorama may cut a line into several polygons. Rays behind the camera of a photograph are left out.
    A line with an unknown ray (NaN) gives no polygon.
    """
    if not np.isfinite(rays).all():
        return
    if camera is not None:
        pixels = camera.project(rays)
        pixels = pixels[np.isfinite(pixels).all(1)]
        if len(pixels):
            yield pixels + 0.5
        return
    column, row = rays_to_pixels(rays, height)
    column = np.unwrap(column, period=2 * height)
    column -= np.floor(column.min() / (2 * height)) * 2 * height
    line = np.column_stack([column, row])
    if abs(column[-1] - column[0]) > height:  # around a pole: repeat the line, and close it outside the image
        turn = np.array([np.copysign(2 * height, column[-1] - column[0]), 0])
        pole = -height if row.mean() < height / 2 else 2 * height
        line = np.vstack([line - turn, line, line + turn])
        yield np.vstack([line, [line[-1, 0], pole], [line[0, 0], pole]])
        return
    for shift in range(int(line[:, 0].max() // (2 * height)) + 1):
        yield line - (shift * 2 * height, 0)


def _spot(lines: list[np.ndarray], width: int, height: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the box (left, top, right, bottom) around the largest visible part of an object, and a point (x, y) inside
    this part, far from its outline; None if no part is visible."""
    import cv2

    best = None
    for line in lines:
        low = np.floor(np.clip(line.min(0), 0, (width, height)))
        high = np.ceil(np.clip(line.max(0), 0, (width, height)))
        if len(line) < 3:
            inside = ((line[0] >= 0) & (line[0] < (width, height))).all()
            return (np.concatenate([line[0], line[0]]), line[0]) if inside else None
        if (high <= low).any():
            continue
        coarse = max(1.0, float((high - low).max()) / 200)
        mask = np.zeros(np.ceil((high - low) / coarse).astype(int)[::-1] + 2, np.uint8)
        cv2.fillPoly(mask, [np.round((line - low) / coarse + 0.5).astype(np.int32)], 1)
        mask[[0, -1]] = mask[:, [0, -1]] = 0
        depth = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
        deep = np.argwhere(depth >= 0.85 * depth.max())  # in a long strip, select a point near the middle
        row, column = deep[np.argmin(((deep - np.argwhere(mask).mean(0)) ** 2).sum(1))] if depth.any() else (0, 0)
        if best is None or mask.sum() * coarse**2 > best[0]:
            at = low + (np.array([column, row]) - 0.5) * coarse
            best = mask.sum() * coarse**2, np.concatenate([low, high]), at
    return best and best[1:]


def _title(text: str, width: int) -> np.ndarray:
    """Return an image of the title."""
    from PIL import Image, ImageDraw

    points = max(14, round(width / 80))
    while points > 8 and font(points).getbbox(text)[2] > width - 2 * points:
        points -= 1
    image = Image.new("RGB", (width, 2 * points), INK)
    ImageDraw.Draw(image).text((points, points), text, PAPER, font(points), "lm")
    return np.asarray(image)


def _ruler(width: int) -> np.ndarray:
    """Return an image of a ruler with the azimuths of the columns of a panorama, every 30 degrees."""
    from PIL import Image, ImageDraw

    points = max(12, round(width / 120))
    image = Image.new("RGB", (width, 2 * points), PAPER)
    draw = ImageDraw.Draw(image)
    for azimuth in range(180, -181, -30):
        x = (180 - azimuth) / 360 * width
        draw.line((x, 0, x, 0.4 * points), INK, max(1, points // 8))
        if abs(azimuth) < 180:
            draw.text((x, 1.2 * points), _degrees(azimuth), INK, font(points), "mm")
    return np.asarray(image)


def _table(
    detections: Detections, saliency: np.ndarray | None, colours: dict[str, Colour], width: int, height: int
) -> np.ndarray:
    """Return an image of a table of the objects. They are sorted by decreasing saliency; by decreasing score if the
    saliency is unknown."""
    from PIL import Image, ImageDraw

    image = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(image)
    line = float(np.clip(height / (len(detections) + 2.5), width / 48, width / 26))
    letters = font(max(9, round(0.62 * line)))
    columns = {"object": 0.10, "score": 0.52, "azimuth": 0.64, "range": 0.76, "saliency": 0.89}
    if saliency is None:
        columns = {"object": 0.10, "score": 0.58, "azimuth": 0.76, "elevation": 0.94}
    room = int((height - 2 * line) / line)
    order = np.argsort(-(detections.scores if saliency is None else saliency), kind="stable")
    order = order[: room if len(order) <= room else room - 1]
    x, y, z = detections.bearing.T
    azimuth_deg, elevation_deg = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    range_m = np.linalg.norm(detections.centroid_m, axis=1)

    max_width = (columns["score"] - columns["object"] - 0.09) * width

    def write(row: int, cells: Iterable[str], colour: Colour) -> None:
        for number, (share, text) in enumerate(zip(columns.values(), cells, strict=False)):
            draw.text((share * width, (row + 1) * line), text, colour, letters, "lm" if number == 0 else "rm")

    write(0, columns, FAINT)
    for row, i in enumerate(order, 1):
        label, middle = detections.labels[i], (row + 1) * line
        draw.rounded_rectangle(
            (0.05 * width, middle - 0.26 * line, 0.08 * width, middle + 0.26 * line), 0.1 * line, colours[label]
        )
        first_cells = _shorten(label, letters, max_width), f"{detections.scores[i]:.2f}", _degrees(azimuth_deg[i])
        if saliency is None:
            write(row, (*first_cells, _degrees(elevation_deg[i])), INK)
            continue
        range_text = f"{range_m[i]:.2f} m" if np.isfinite(range_m[i]) else "-"
        write(row, (*first_cells, range_text, f"{100 * saliency[i]:.1f} %"), INK)
        if saliency[i] > 0.01 * saliency.max():
            end = 0.905 + 0.085 * saliency[i] / saliency.max()
            draw.rectangle((0.905 * width, middle - 0.14 * line, end * width, middle + 0.14 * line), colours[label])
    if len(order) < len(detections):
        write(len(order) + 1, [f"and {len(detections) - len(order)} more"], FAINT)
    return np.asarray(image)


def _shorten(text: str, letters: Any, max_width: float) -> str:
    """Return a text cut to a maximum width in pixels."""
    if letters.getlength(text) <= max_width:
        return text
    while text and letters.getlength(f"{text}...") > max_width:
        text = text[:-1]
    return f"{text.rstrip()}..."


def _degrees(angle_deg: float) -> str:
    if not np.isfinite(angle_deg):
        return "-"
    rounded = round(angle_deg)
    return f"{rounded:+d}°" if rounded % 180 else f"{abs(rounded)}°"
