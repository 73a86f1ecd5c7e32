"""Draw the trail of a tracked camera on the floor, and the support of the estimated pose (evidence for it) over
time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from salframe.drawing.canvas import FAINT, INK, PAPER, Colour, disk, fill, font, stroke
from salframe.drawing.floor_colours import floor_colours
from salframe.framework.files.writing import atomic_path, check_picture_output
from salframe.localization.tracker import TrackStatus
from salframe.localization.tracking import Track
from salframe.panoramas.floors import FloorMasks, floor_numbers

COLOURS: dict[TrackStatus, Colour] = {
    TrackStatus.TRACKING: (31, 78, 160),
    TrackStatus.LOST: (214, 84, 34),
    TrackStatus.OUT_OF_MAP: (150, 150, 150),
}
"""Colour of each status."""
LONG_SIDE_PX, MAX_SCALE = 1400, 80.0
"""Length of the longer side of the picture of a floor in pixels, and maximum scale in pixels per metre."""
MARGIN_M = 1.0
"""Margin around the floor and the trail in metres."""
CHART_PX, TEXT_PX, GAP_PX = 110, 26, 14
"""Heights in pixels of the chart of the support (evidence for the pose) and of a line of text, and the gap around
them."""


def draw_trail(track: Track, path: str | Path, floors: Sequence[FloorMasks] = ()) -> None:
    """Write a PNG of a track: the estimated positions on the floor, coloured by status, and the support (evidence for
    the pose) over time.

    Args:
        track: The track.
        path: The file.
        floors: Floors of the map. Only the floor with the most positions is drawn. Without floors, the background is
            empty.

    Raises:
        ConfigError: The path names an existing file that is not a PNG.
    """
    from PIL import Image

    check_picture_output(Path(path))
    picture = Image.fromarray(trail_image(track, floors))
    with atomic_path(Path(path)) as temporary:
        picture.save(temporary, "PNG", optimize=True)


def trail_image(track: Track, floors: Sequence[FloorMasks] = ()) -> np.ndarray:
    """Return the picture of a track, (H, W, 3) uint8 RGB. Arguments are those of `draw_trail`."""
    posed = [step.pose for step in track.steps if step.pose.T_world_pano is not None]
    poses = np.array([pose.T_world_pano for pose in posed]).reshape(-1, 4, 4)
    floor = _choose_floor(floors, poses[:, :3, 3])
    points = poses[:, :2, 3]
    corners = points if floor is None else np.concatenate([points, _corners_m(floor)])
    low, high = (corners.min(0) - MARGIN_M, corners.max(0) + MARGIN_M) if len(corners) else (np.zeros(2), np.ones(2))
    scale = min(LONG_SIDE_PX / float((high - low).max()), MAX_SCALE)
    plan = np.full((*np.ceil((high - low)[::-1] * scale).astype(int), 3), PAPER, np.uint8)

    def pixel(xy_m: np.ndarray) -> np.ndarray:
        return (np.asarray(xy_m) - (low[0], high[1])) * (scale, -scale)

    if floor is not None:
        _paint_floor(plan, floor, pixel(np.array(floor.origin_m)), scale)
    for before, pose in pairwise(posed):
        line = np.array([before.T_world_pano[:2, 3], pose.T_world_pano[:2, 3]])  # type: ignore[index]
        stroke(plan, pixel(line), COLOURS[pose.status], 3)
    for pose, matrix in zip(posed, poses, strict=True):
        disk(plan, pixel(matrix[:2, 3]), 5, COLOURS[pose.status])
        ahead = matrix[:2, 3] + 12 / scale * matrix[:2, 0]
        stroke(plan, pixel(np.array([matrix[:2, 3], ahead])), COLOURS[pose.status], 2)
    return np.concatenate([plan, _chart(track, plan.shape[1])])


def _chart(track: Track, width: int) -> np.ndarray:
    """Return the chart of the support over the steps, with the legend, (H, W, 3) uint8."""
    from PIL import Image, ImageDraw

    height = CHART_PX + 3 * TEXT_PX + 2 * GAP_PX
    chart = np.full((height, width, 3), PAPER, np.uint8)
    support = np.array([step.pose.support for step in track.steps])
    bar = (width - 2 * GAP_PX) / max(len(support), 1)
    bottom = CHART_PX + TEXT_PX
    for number, step in enumerate(track.steps):
        top = bottom - CHART_PX * step.pose.support / max(support.max(), 1e-9)
        left, right = GAP_PX + number * bar, GAP_PX + (number + 0.9) * bar
        fill(chart, np.array([(left, top), (right, top), (right, bottom), (left, bottom)]), COLOURS[step.pose.status])
    stroke(chart, np.array([(GAP_PX, bottom), (width - GAP_PX, bottom)]), FAINT, 1)
    image = Image.fromarray(chart)
    draw, letters = ImageDraw.Draw(image), font(TEXT_PX - 12)
    maximum = f"{support.max():.2f}" if len(support) else "-"
    draw.text((GAP_PX, 4), f"{track.name}: support of the belief, maximum {maximum}", INK, letters)
    times = f"{track.t_s[0]:g} to {track.t_s[-1]:g} s" if len(track.t_s) else "no step"
    draw.text((GAP_PX, bottom + 6), f"{len(track.steps)} steps, {times}", INK, letters)
    counts = {status: sum(step.pose.status is status for step in track.steps) for status in COLOURS}
    left = float(GAP_PX)
    for status, count in counts.items():
        text = f"{status}: {count}"
        draw.text((left, bottom + 6 + TEXT_PX), text, COLOURS[status], letters)
        left += draw.textlength(text, letters) + 2 * GAP_PX
    return np.asarray(image)


def _choose_floor(floors: Sequence[FloorMasks], positions_m: np.ndarray) -> FloorMasks | None:
    """Return the floor with the most positions (N, 3); the lowest floor if no position is on a floor; None without
    floors."""
    if not floors:
        return None
    by_height = sorted(floors, key=lambda floor: floor.z_m)
    numbers = floor_numbers(by_height, positions_m)
    return by_height[int(np.bincount(numbers[numbers >= 0], minlength=len(floors)).argmax())]


def _corners_m(floor: FloorMasks) -> np.ndarray:
    """Return the minimum and the maximum (x, y) in metres of the free floor and the regions, (2, 2)."""
    rows, columns = np.nonzero(floor.free | (floor.region > 0))
    x_m = floor.origin_m[0] + floor.resolution_m * np.array([columns.min(), columns.max() + 1])
    y_m = floor.origin_m[1] - floor.resolution_m * np.array([rows.max() + 1, rows.min()])
    return np.column_stack([x_m, y_m])


def _paint_floor(plan: np.ndarray, floor: FloorMasks, corner: np.ndarray, scale: float) -> None:
    """Paint a floor on a plan in place.

    Args:
        plan: (H, W, 3) uint8.
        floor: The floor.
        corner: (2,) pixel (x, y) of the upper left corner of the floor.
        scale: Pixels per metre.
    """
    rows, columns = (
        np.floor((np.arange(size) + 0.5 - offset) / (scale * floor.resolution_m)).astype(int)
        for size, offset in zip(plan.shape[:2], corner[::-1], strict=True)
    )
    row = np.flatnonzero((rows >= 0) & (rows < floor.free.shape[0]))
    column = np.flatnonzero((columns >= 0) & (columns < floor.free.shape[1]))
    plan[np.ix_(row, column)] = floor_colours(floor)[np.ix_(rows[row], columns[column])]
