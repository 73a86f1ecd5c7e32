"""Where one walks from a region to the next (docs/how-to/maps.md#what-the-map-is-made-of)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from salframe.topology.grid import FloorGrid

_EIGHT = np.ones((3, 3), bool)


@dataclass(frozen=True, eq=False)
class Doorway:
    """Where the labels of two regions meet on walkable floor, before erosion: how far the line they meet along reaches,
    on the side where that is less, its pixels (N, 2), and the transition points on it, (row, column) of medoids; none
    where the robot does not fit through."""

    labels: tuple[int, int]
    width_m: float
    pixels: np.ndarray
    points: tuple[tuple[int, int], ...]


def find_doorways(grid: FloorGrid) -> list[Doorway]:
    """Every doorway of a floor, by pair of regions, then from the top left.

    Transition pixels have a 4-neighbour of another region; their 8-connected components make the doorways, and on the
    clear floor alone the transition points.
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
    """The doorways of a floor that are wide enough, and the narrower ones: these are closed, their pixels no longer
    clear."""
    doorways = find_doorways(grid)
    narrow = [doorway for doorway in doorways if doorway.width_m < min_doorway_m - 1e-9]
    for doorway in narrow:
        grid.clear[tuple(doorway.pixels.T)] = False
    return [doorway for doorway in doorways if doorway not in narrow], narrow


def _meetings(grid: FloorGrid) -> Iterator[tuple[tuple[int, int], np.ndarray, np.ndarray]]:
    """For each pair of labels that meet: the pair, (N, 2) pixels that have the other as 4-neighbour, (N,) bool those
    where both are clear."""
    label, clear = grid.label, grid.clear
    found = []
    for step in ((0, 1), (1, 0)):
        first, second = np.s_[: label.shape[0] - step[0], : label.shape[1] - step[1]], np.s_[step[0] :, step[1] :]
        pixel = np.argwhere((label[first] != label[second]) & (label[first] > 0) & (label[second] > 0))
        other = pixel + step
        labels = np.sort(np.column_stack([label[tuple(pixel.T)], label[tuple(other.T)]]), 1)
        fits = clear[tuple(pixel.T)] & clear[tuple(other.T)]
        found += [np.column_stack([labels, side, fits]) for side in (pixel, other)]
    rows = np.concatenate(found)
    for pair in np.unique(rows[:, :2], axis=0):
        chosen = rows[(rows[:, :2] == pair).all(1)]
        yield (int(pair[0]), int(pair[1])), chosen[:, 2:4], chosen[:, 4].astype(bool)


def _distances(pixels: np.ndarray) -> np.ndarray:
    from scipy.spatial.distance import cdist

    return cdist(pixels, pixels)


def _medoid(pixels: np.ndarray) -> tuple[int, int]:
    row, column = pixels[_distances(pixels).sum(1).argmin()]
    return int(row), int(column)
