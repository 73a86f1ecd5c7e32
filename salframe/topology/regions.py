"""Regions of a free space: grown from the places of reference frames, or found where free space narrows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import RequirementMissing
from salframe.topology.free_space import FreeSpace
from salframe.topology.grid import nearest_pixel

MAX_SEED_M = 0.5
"""Maximum distance, in metres, from a frame to the floor cell from which the region of its place grows."""
SMOOTHING_M = 0.1
"""Standard deviation, in metres, of the Gaussian that smooths the clearance. Without smoothing, single cells of a door
frame would move the narrowest point of a passage."""
MIN_NARROWING_M = 0.2
"""Minimum difference, in metres, between the clearance in the middle of a region and the clearance in a doorway of this
region."""


def grow_regions(space: FreeSpace, xy_m: np.ndarray, places: Sequence[str]) -> tuple[np.ndarray, dict[int, str]]:
    """Return the regions of places: a watershed of the clearance, flooded from the positions of frames.

    The regions of two places meet where the passage between them is narrowest. The clearance is the distance from walls
    and tall furniture.

    Args:
        space: The free space.
        xy_m: (N, 2) positions of frames in the world frame.
        places: Place of each frame.

    Returns:
        The label of each cell of the floor, (rows, columns) int32, 0 for none, and the place of each label.

    Raises:
        RequirementMissing: scikit-image is not installed.
    """
    labels: dict[str, int] = {}
    seeds = np.zeros(space.floor.shape, np.int32)
    for cell, place in zip(space.cells(xy_m), places, strict=True):
        if ((cell < 0) | (cell >= seeds.shape)).any():
            continue
        pixel = nearest_pixel(space.floor, cell + 0.5)
        if pixel is not None and np.linalg.norm(pixel - cell - 0.5) * space.resolution_m <= MAX_SEED_M:
            row, column = pixel.astype(int)
            seeds[row, column] = labels.setdefault(place, len(labels) + 1)
    return _flood(space, _clearance_m(space), seeds), {label: place for place, label in labels.items()}


def split_regions(space: FreeSpace, min_narrowing_m: float = MIN_NARROWING_M) -> np.ndarray:
    """Return the regions between narrow passages: a watershed of the clearance, flooded from its maxima.

    The clearance is the distance from walls and tall furniture. If the clearance of a maximum exceeds the clearance in
    the passage to a higher maximum by less than `min_narrowing_m`, both maxima belong to the same region.

    Args:
        space: The free space.
        min_narrowing_m: Minimum difference between the clearance at a maximum and in a passage, in metres.

    Returns:
        The label of each cell of the floor, (rows, columns) int32 from 1, 0 for none.

    Raises:
        RequirementMissing: scikit-image is not installed.
    """
    from scipy import ndimage

    _require()
    from skimage.morphology import reconstruction

    clearance_m = _clearance_m(space)
    # The h-maxima of the clearance, by morphological reconstruction.
    lowered = reconstruction(np.maximum(clearance_m - min_narrowing_m, 0), clearance_m)
    maxima = (clearance_m - lowered >= min_narrowing_m - 1e-9) & space.floor
    return _flood(space, clearance_m, ndimage.label(maxima, np.ones((3, 3)))[0].astype(np.int32))


def regions_at(region: np.ndarray, space: FreeSpace, xy_m: np.ndarray) -> np.ndarray:
    """Return the label of the region at each position, (N,) int; 0 outside of the regions.

    Args:
        region: (rows, columns) labels of the cells.
        space: The free space.
        xy_m: (N, 2) positions in the world frame.
    """
    cells = space.cells(xy_m)
    is_inside = np.all((cells >= 0) & (cells < np.array(region.shape)), axis=1)
    row, column = np.where(is_inside[:, None], cells, 0).T
    return np.where(is_inside, region[row, column], 0)


def _clearance_m(space: FreeSpace) -> np.ndarray:
    """Return the smoothed distance of each cell of the floor from walls and tall furniture, (rows, columns) float64."""
    from scipy import ndimage

    clearance_m = ndimage.distance_transform_edt(np.pad(space.floor, 1))[1:-1, 1:-1] * space.resolution_m
    smooth: np.ndarray = ndimage.gaussian_filter(clearance_m, SMOOTHING_M / space.resolution_m) * space.floor
    return smooth


def _flood(space: FreeSpace, clearance_m: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    _require()
    from skimage.segmentation import watershed

    return watershed(-clearance_m, seeds, mask=space.floor).astype(np.int32)  # type: ignore[no-any-return]


def _require() -> None:
    """Raise RequirementMissing if scikit-image is not installed."""
    from importlib.util import find_spec

    if find_spec("skimage") is None:
        command = "pip install 'salframe[floors]'"
        raise RequirementMissing(
            f"regions of free space need the package scikit-image, which is not installed: {command}", command
        )
