"""`habitat-maps`: a real building with floor masks from the top-down pictures of Object2HabitatMap.

The pictures use a palette of about 100 colours; the colour of a region or object is its index modulo the palette
length. Two rooms of a large building may therefore have the same colour. The files do not contain the scale (metres per
pixel) and the origin. They are estimated from the positions of the rooms: each connected patch of one colour is
assigned to the region whose box in the .house file overlaps it. The edges of patches and boxes give scale and origin.
Walkable areas are identified by their colour.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.house_file import HouseFile, Region, read_house
from salframe.panoramas.images import read_color
from salframe_matterport.dataset import MatterportAnnotations

_PICTURES = {"region": "the regions", "cat": "the categories of objects"}
_WALKABLE_RGB = {"floor": (0, 255, 0), "door": (246, 0, 0), "stairs": (0, 244, 67), "void": (100, 100, 5)}
"""Walkable categories and their colours. "door": seen from above, the lintel of a doorway hides the floor. "void": the
areas are unlabelled floor."""
_PATCH = 0.002
"""Minimum area of a patch as a fraction of the picture. Smaller patches are noise at walls and furniture. Their pixels
are assigned to the nearest room."""
_OVERLAP = 0.5
"""Minimum intersection over union of the box of a patch and the box of its region."""
_EDGE_SCALE_M = 0.05
"""Scale of the soft L1 loss on edge distances, in metres."""
_MISFIT_M = 0.25
"""Maximum median distance in metres between the edges of patches and of their regions' boxes."""


class HabitatMaps(MatterportAnnotations):
    """One building of the dataset `matterport-annotations`, with floor masks from top-down maps.

    The top-down maps are the output of the program Object2HabitatMap, which you run before. The floor is the area of
    all regions in the top-down map. All objects except floor, door and stairs are obstacles.
    """

    name = "habitat-maps"
    version = "1"

    class Config(MatterportAnnotations.Config):
        root: Path | None = Field(
            None,
            description="path of the folder that contains habitat_map/<scan>/, house/<scan>.house, and the files of "
            "the dataset matterport-annotations; required (--data-dir sets it)",
        )
        scans: Literal["all"] | tuple[str, ...] = Field(
            "all",
            description="list with the id of one building, such as [17DRP5sb8fy]; all: the building in the "
            "folder that has top-down maps, if there is only one",
        )
        resolution_m: float = Field(
            0.05,
            gt=0,
            description="size (m) of a pixel of the floor masks, rounded to a whole number of pixels of the top-down "
            "map",
        )

    @cached_property
    def _scans(self) -> Sequence[str]:
        scans = [scan for scan in super()._scans if maps_path(self._root, scan).is_dir()]
        if not scans:
            raise DataError(
                f"{self._root} has no folder habitat_map/<scan>/, expected one with region.png and cat.png, which the "
                "program Object2HabitatMap writes"
            )
        if len(scans) > 1:  # each building has its own world frame
            raise DataError(
                f"{self._root} has top-down maps of {', '.join(scans)}, "
                f"expected one building: select one with --set data.scans=[{scans[0]}]"
            )
        return scans

    @cached_property
    def _floor(self) -> FloorMasks:
        return read_floor(self._root, self._scans[0], self.config.resolution_m)

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Read the building and its maps, so that errors in them are reported before anything is computed."""
        super().prepare(progress)
        self.floors()

    def floors(self) -> Sequence[FloorMasks]:
        """Return the floor masks of the level that the maps show. Its regions have the names of the places."""
        return [self._floor]


def maps_path(root: Path, scan: str) -> Path:
    return root / "habitat_map" / scan


def read_floor(root: Path, scan: str, resolution_m: float) -> FloorMasks:
    """Read the floor masks of the level that a building's top-down maps show.

    Args:
        root: Folder of the files.
        scan: Building.
        resolution_m: Approximate cell size in metres.

    Raises:
        DataError: Pictures are missing, damaged or of different sizes, or do not match the building's regions.
    """
    pictures = {}
    for name, content in _PICTURES.items():
        path = maps_path(root, scan) / f"{name}.png"
        if not path.exists():
            raise DataError(
                f"{path} is missing, expected the top-down map of {content} from Object2HabitatMap's collect_2d_map.py"
            )
        pictures[name] = _color_code(read_color(path))
    region, category = pictures["region"], pictures["cat"]
    if region.shape != category.shape:
        shapes = [f"{picture.shape[1]} x {picture.shape[0]}" for picture in (region, category)]
        raise DataError(
            f"{maps_path(root, scan)}: region.png is {shapes[0]} pixels and cat.png is {shapes[1]}, expected the same "
            "size"
        )
    house = read_house(root / "house" / f"{scan}.house")
    label, pixel_m, origin_m = _locate_regions(region, house, maps_path(root, scan))
    shown = [region for region in house.regions if (label == region.index + 1).any()]
    step = max(1, round(resolution_m / pixel_m))
    obstacle = ~np.isin(category, [_color_code(np.array(rgb)) for rgb in _WALKABLE_RGB.values()]) & (region > 0)
    free = _share(region > 0, step) > 0.5
    return FloorMasks(
        free=free,
        region=np.where(free, _label_cells(label, step, free), 0).astype(np.int32),
        obstacle=free & (_share(obstacle, step) > 0.5),
        resolution_m=step * pixel_m,
        origin_m=origin_m,
        regions={region.index + 1: f"{scan}/region-{region.index}" for region in shown},
        z_m=float(np.median([region.low_m[2] for region in shown])),
    )


def _color_code(rgb: np.ndarray) -> np.ndarray:
    """Encode colours (..., 3) as int32 (...,): one number per colour, 0 for black."""
    return rgb.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], np.int32)


def _locate_regions(
    colour: np.ndarray, house: HouseFile, source: Path
) -> tuple[np.ndarray, float, tuple[float, float]]:
    """Assign the patches of a picture to regions and estimate scale and origin.

    Returns:
        Labels (H, W) int32 (region index + 1, 0 where unknown), metres per pixel, and x and y of the upper left corner
        in the world.
    """
    patches, number = _patches(colour)
    fits = [
        _fit(patches, [region for region in house.regions if region.level == level])
        for level in {r.level for r in house.regions}
    ]
    matched, pixel_m, origin_m, misfit_m = max(fits, key=lambda fit: len(fit[0]))
    if len(matched) < 2 or misfit_m > _MISFIT_M:
        raise DataError(
            f"{source}/region.png does not match the .house file: {len(matched)} of {len(patches)} coloured areas "
            "match "
            f"a region (expected at least 2), and the edges differ by {misfit_m:.2f} m (expected at most {_MISFIT_M} m)"
        )
    table = np.zeros(number.max() + 1, np.int32)
    for patch, region in matched.items():
        table[patch] = region + 1
    return table[number], pixel_m, origin_m


def _patches(colour: np.ndarray) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Find the large connected patches of one colour.

    Returns:
        Box (left, top, right, bottom) in pixels by patch number, and the patch number of each pixel, (H, W) int32, 0
        outside all patches.
    """
    import cv2

    boxes: dict[int, np.ndarray] = {}
    number = np.zeros(colour.shape, np.int32)
    for value in np.unique(colour[colour > 0]):
        count, part, stats, _ = cv2.connectedComponentsWithStats((colour == value).astype(np.uint8), connectivity=4)
        for i in range(1, count):
            left, top, width, height, pixels = stats[i]
            if pixels >= _PATCH * colour.size:
                boxes[len(boxes) + 1] = np.array([left, top, left + width, top + height], float)
                number[part == i] = len(boxes)
    return boxes, number


def _fit(
    patches: dict[int, np.ndarray], regions: list[Region]
) -> tuple[dict[int, int], float, tuple[float, float], float]:
    """Fit the regions of a level to the patches.

    The initial guess aligns the bounding box of all regions with the bounding box of all patches. Then scale and origin
    are fitted by least squares to the edges of overlapping boxes. The loss is soft L1, because curtains and open doors
    shift edges.

    Returns:
        Region index by patch, metres per pixel, origin, and the median edge distance in metres.
    """
    from scipy.optimize import least_squares

    no_fit: tuple[dict[int, int], float, tuple[float, float], float] = {}, np.nan, (np.nan, np.nan), np.inf
    if not patches:
        return no_fit
    pixels = np.array(list(patches.values()))
    # (min x, max y, max x, min y), in the order of (left, top, right, bottom).
    boxes_m = np.array([[region.low_m[0], region.high_m[1], region.high_m[0], region.low_m[1]] for region in regions])
    west, north, east, south = boxes_m[:, 0].min(), boxes_m[:, 1].max(), boxes_m[:, 2].max(), boxes_m[:, 3].min()
    left, top, right, bottom = pixels[:, 0].min(), pixels[:, 1].min(), pixels[:, 2].max(), pixels[:, 3].max()
    scale = np.array([(east - west) / (right - left), (north - south) / (bottom - top)]).mean()
    solution = np.array([scale, west - scale * left, north + scale * top])
    for _ in range(2):
        overlap = _overlap(_to_metres(solution, pixels), boxes_m)
        region, patch = overlap.argmax(1), np.arange(len(pixels))
        matched_patch = overlap[patch, region] >= _OVERLAP
        if not matched_patch.any():
            return no_fit
        boxes_px, targets_m = pixels[matched_patch], boxes_m[region[matched_patch]]

        def misfit_m(guess: np.ndarray, boxes_px=boxes_px, targets_m=targets_m) -> np.ndarray:
            return (_to_metres(guess, boxes_px) - targets_m).ravel()

        solution = least_squares(misfit_m, solution, loss="soft_l1", f_scale=_EDGE_SCALE_M).x
    matched = {number: regions[region[i]].index for i, number in enumerate(patches) if matched_patch[i]}
    return (
        matched,
        float(solution[0]),
        (float(solution[1]), float(solution[2])),
        float(np.median(np.abs(misfit_m(solution)))),
    )


def _to_metres(solution: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Convert boxes (N, 4) left, top, right, bottom in pixels to min x, max y, max x, min y in metres.

    `solution` holds metres per pixel and x and y of the origin.
    """
    scale, x, y = solution
    return pixels * np.array([scale, -scale, scale, -scale]) + np.array([x, y, x, y])


def _overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the intersection over union (N, M) of boxes (min x, max y, max x, min y)."""
    width = np.minimum(a[:, None, 2], b[:, 2]) - np.maximum(a[:, None, 0], b[:, 0])
    height = np.minimum(a[:, None, 1], b[:, 1]) - np.maximum(a[:, None, 3], b[:, 3])
    shared = np.maximum(width, 0) * np.maximum(height, 0)
    area = [(box[:, 2] - box[:, 0]) * (box[:, 1] - box[:, 3]) for box in (a, b)]
    return shared / (area[0][:, None] + area[1] - shared)


def _share(mask: np.ndarray, step: int) -> np.ndarray:
    """Return the fraction of true pixels in each cell of step x step pixels, (rows, columns). Padding is false."""
    rows, columns = (-(-size // step) * step for size in mask.shape)
    padded = np.pad(mask, ((0, rows - mask.shape[0]), (0, columns - mask.shape[1])))
    return padded.reshape(rows // step, step, columns // step, step).mean((1, 3))


def _label_cells(label: np.ndarray, step: int, free: np.ndarray) -> np.ndarray:
    """Return the most frequent label of each cell (rows, columns).

    Each label keeps only its largest connected area. All other cells, such as strips at door sills, get the label of
    the nearest area.
    """
    from scipy import ndimage

    numbers = np.unique(label[label > 0])
    shares = np.stack([_share(label == number, step) for number in numbers])
    cells = np.where(free & (shares.max(0) > 0), numbers[shares.argmax(0)], 0)
    rooms = np.zeros_like(cells)
    for number in numbers:
        parts, count = ndimage.label(cells == number)
        if count:
            rooms[parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])] = number
    nearest = ndimage.distance_transform_edt(rooms == 0, return_distances=False, return_indices=True)
    return rooms[tuple(nearest)]
