"""Transitions (doorways) between the regions of a floor (docs/how-to/maps.md#what-the-map-is-made-of)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from salframe.topology.grid import FloorGrid

_EIGHT = np.ones((3, 3), bool)


@dataclass(frozen=True, eq=False)
class Doorway:
    """A line along which the labels of two regions meet on walkable floor, before erosion by the robot radius.

    Attributes:
        labels: Labels of the two regions.
        width_m: Width of the doorway in metres. The extent of the line is measured in both regions, and the smaller
            extent is used.
        pixels: (N, 2) pixels (row, column) on both sides of the line.
        points: Pixels (row, column) of the transition nodes, one for each part of the line where the robot fits
            through; empty if it does not fit through.
    """

    labels: tuple[int, int]
    width_m: float
    pixels: np.ndarray
    points: tuple[tuple[int, int], ...]


def find_doorways(grid: FloorGrid) -> list[Doorway]:
    """Return the doorways of a floor, sorted by pair of regions, then from the top left.

    Transition pixels are pixels with a 4-neighbour of another region. Each 8-connected component of transition pixels
    is a doorway. Of the transition pixels on clear floor, each 8-connected component gives a transition point: its
    medoid.
    """
    from scipy import ndimage

    doorways = []
    for pair, pixels, fits in _meetings(grid):
        corner = pixels.min(0)
        shape = pixels.max(0) - corner + 1
        wide, clear = np.zeros(shape, bool), np.zeros(shape, bool)
        wide[tuple((pixels - corner).T)] = True
        clear[tuple((pixels[fits] - corner).T)] = True
        components, count = ndimage.label(wide, _EIGHT)
        passages, passage_count = ndimage.label(clear, _EIGHT)
        through = [np.argwhere(passages == number) for number in range(1, passage_count + 1)]
        for number in range(1, count + 1):
            line = np.argwhere(components == number) + corner
            first = grid.label[tuple(line.T)] == pair[0]
            width_m = (min(_distances(line[side]).max() for side in (first, ~first)) + 1) * grid.floor.resolution_m
            points = tuple(_medoid(points + corner) for points in through if components[tuple(points[0])] == number)
            doorways.append(Doorway(pair, float(width_m), line, points))
    return doorways


def close_doorways(grid: FloorGrid, min_doorway_m: float) -> tuple[list[Doorway], list[Doorway]]:
    """Close narrow doorways: set their pixels in `grid.clear` to False.

    Returns:
        The doorways with at least the minimum width, and the narrower doorways.
    """
    doorways = find_doorways(grid)
    narrow = [doorway for doorway in doorways if doorway.width_m < min_doorway_m - 1e-9]
    for doorway in narrow:
        grid.clear[tuple(doorway.pixels.T)] = False
    return [doorway for doorway in doorways if doorway not in narrow], narrow


def _meetings(grid: FloorGrid) -> Iterator[tuple[tuple[int, int], np.ndarray, np.ndarray]]:
    """Yield, for each pair of labels that meet: the pair, the pixels (N, 2) with a 4-neighbour of the other label, and
    whether both neighbours are clear, (N,) bool."""
    label, clear = grid.label, grid.clear
    columns = []
    for step in ((0, 1), (1, 0)):
        first, second = np.s_[: label.shape[0] - step[0], : label.shape[1] - step[1]], np.s_[step[0] :, step[1] :]
        pixel = np.argwhere((label[first] != label[second]) & (label[first] > 0) & (label[second] > 0))
        other = pixel + step
        labels = np.sort(np.column_stack([label[tuple(pixel.T)], label[tuple(other.T)]]), 1)
        fits = clear[tuple(pixel.T)] & clear[tuple(other.T)]
        columns += [np.column_stack([labels, side, fits]) for side in (pixel, other)]
    rows = np.concatenate(columns)
    for pair in np.unique(rows[:, :2], axis=0):
        matching = rows[(rows[:, :2] == pair).all(1)]
        yield (int(pair[0]), int(pair[1])), matching[:, 2:4], matching[:, 4].astype(bool)


def _distances(pixels: np.ndarray) -> np.ndarray:
    from scipy.spatial.distance import cdist

    return cdist(pixels, pixels)


def _medoid(pixels: np.ndarray) -> tuple[int, int]:
    row, column = pixels[_distances(pixels).sum(1).argmin()]
    return int(row), int(column)
