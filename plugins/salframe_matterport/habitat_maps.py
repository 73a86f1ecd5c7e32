"""`habitat-maps`: a real building with its floor seen from above, from the top-down pictures of Object2HabitatMap.

The pictures are coloured by a palette that gives regions and objects the colour of their index modulo its length, about
100, so that in a large building two rooms may share one; neither scale nor origin are stored. Both are found here from
where the rooms lie: each connected patch of colour belongs to the region whose box of the .house file it fills, and the
boxes' edges tell metres a pixel and origin. Only what can be walked on is known by its colour.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.house_file import HouseFile, Region, read_house
from salframe.panoramas.images import read_color
from salframe_matterport.dataset import MatterportAnnotations

_PICTURES = {"region": "the regions", "cat": "the categories of objects"}
_WALKABLE_RGB = {"floor": (0, 255, 0), "door": (246, 0, 0), "stairs": (0, 244, 67), "void": (100, 100, 5)}
"""A lintel hides its doorway from above; void is nothing but unlabelled patches of floor."""
_PATCH = 0.002
"""Patches that cover a smaller share of the picture are stains at walls and furniture; the cells under them go to the
nearest room."""
_OVERLAP = 0.5
"""Least intersection over union of a patch's box with its region's."""
_EDGE_SCALE_M = 0.05
_MISFIT_M = 0.25
"""Half of the regions' edges at least must lie this near those of their boxes."""


class HabitatMaps(MatterportAnnotations):
    """A real building with floor masks: `matterport-annotations` of one whose top-down maps by Object2HabitatMap are at
    hand.

    The floor is the regions of the map, obstacles all objects that are neither floor, door nor stairs.
    """

    name = "habitat-maps"
    version = "1"

    class Config(MatterportAnnotations.Config):
        root: Path | None = Field(
            None,
            description="folder of habitat_map/<scan>/, house/<scan>.house, and the files of matterport-annotations",
        )
        resolution_m: float = Field(
            0.05, gt=0, description="cell of the floor masks; the nearest whole number of pixels is taken"
        )

    @cached_property
    def _scans(self) -> Sequence[str]:
        scans = [scan for scan in super()._scans if maps_path(self._root, scan).is_dir()]
        if not scans:
            raise DataError(
                f"{self._root} has no folder habitat_map/<scan>/ of any building, "
                "expected Object2HabitatMap's region.png and cat.png there"
            )
        if len(scans) > 1:  # each has a world of its own
            raise DataError(
                f"{self._root} has maps of {', '.join(scans)}, "
                f"expected one building a map: --set data.scans=[{scans[0]}]"
            )
        return scans

    @cached_property
    def _floor(self) -> FloorMasks:
        return read_floor(self._root, self._scans[0], self.config.resolution_m)

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Read the building and its maps: what is wrong with them shows before anything is computed."""
        super().prepare(progress)
        self.floors()

    def floors(self) -> Sequence[FloorMasks]:
        """The level that the maps show; its regions are named as the places of the viewpoints."""
        return [self._floor]


def maps_path(root: Path, scan: str) -> Path:
    return root / "habitat_map" / scan


def read_floor(root: Path, scan: str, resolution_m: float) -> FloorMasks:
    """The masks of the level that a building's top-down maps show, in cells of about `resolution_m`.

    Raises DataError on missing, damaged or differently sized pictures, or where they do not fit the building's regions.
    """
    pictures = {}
    for name, what in _PICTURES.items():
        path = maps_path(root, scan) / f"{name}.png"
        if not path.exists():
            raise DataError(
                f"{path} is missing: the top-down map of {what}, which Object2HabitatMap's collect_2d_map.py draws"
            )
        pictures[name] = _coded(read_color(path))
    region, category = pictures["region"], pictures["cat"]
    if region.shape != category.shape:
        shapes = [f"{picture.shape[1]} x {picture.shape[0]}" for picture in (region, category)]
        raise DataError(
            f"{maps_path(root, scan)}: region.png is {shapes[0]} and cat.png {shapes[1]}, expected one size"
        )
    house = read_house(root / "house" / f"{scan}.house")
    label, pixel_m, origin_m = _place(region, house, maps_path(root, scan))
    shown = [region for region in house.regions if (label == region.index + 1).any()]
    step = max(1, round(resolution_m / pixel_m))
    obstacle = ~np.isin(category, [_coded(np.array(rgb)) for rgb in _WALKABLE_RGB.values()]) & (region > 0)
    free = _share(region > 0, step) > 0.5
    return FloorMasks(
        free=free,
        region=np.where(free, _cells(label, step, free), 0).astype(np.int32),
        obstacle=free & (_share(obstacle, step) > 0.5),
        resolution_m=step * pixel_m,
        origin_m=origin_m,
        regions={region.index + 1: f"{scan}/region-{region.index}" for region in shown},
        z_m=float(np.median([region.low_m[2] for region in shown])),
    )


def _coded(rgb: np.ndarray) -> np.ndarray:
    """(...,) int32 of colours (..., 3): one number a colour, 0 for black."""
    return rgb.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], np.int32)


def _place(colour: np.ndarray, house: HouseFile, source: Path) -> tuple[np.ndarray, float, tuple[float, float]]:
    """Label (H, W) int32 of a region's index + 1, 0 where unknown, the metres a pixel, and the world's x and y of the
    upper left corner."""
    patches, number = _patches(colour)
    fits = [
        _fit(patches, [region for region in house.regions if region.level == level])
        for level in {r.level for r in house.regions}
    ]
    matched, pixel_m, origin_m, misfit_m = max(fits, key=lambda fit: len(fit[0]))
    if len(matched) < 2 or misfit_m > _MISFIT_M:
        raise DataError(
            f"{source}/region.png does not show the regions of the .house file: "
            f"{len(matched)} of {len(patches)} patches lie where a region "
            f"is (half of their edges within {misfit_m:.2f} m), expected two at least and {_MISFIT_M} m"
        )
    table = np.zeros(number.max() + 1, np.int32)
    for patch, region in matched.items():
        table[patch] = region + 1
    return table[number], pixel_m, origin_m


def _patches(colour: np.ndarray) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Boxes (left, top, right, bottom) in pixels of the large connected patches of one colour by their number, and the
    numbers (H, W)."""
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
    """The regions of a level laid on the patches: region index by patch, metres a pixel, origin, and the median
    distance of their edges.

    To begin with, the regions' common box is laid on the patches' common box. Then the edges of the boxes of patches
    and regions that overlap give scale and origin by least squares (soft L1: curtains and open doors move an edge).
    """
    from scipy.optimize import least_squares

    nothing: tuple[dict[int, int], float, tuple[float, float], float] = {}, np.nan, (np.nan, np.nan), np.inf
    if not patches:
        return nothing
    pixels = np.array(list(patches.values()))
    # (x low, y high, x high, y low): the order of left, top, right, bottom.
    boxes_m = np.array([[region.low_m[0], region.high_m[1], region.high_m[0], region.low_m[1]] for region in regions])
    west, north, east, south = boxes_m[:, 0].min(), boxes_m[:, 1].max(), boxes_m[:, 2].max(), boxes_m[:, 3].min()
    left, top, right, bottom = pixels[:, 0].min(), pixels[:, 1].min(), pixels[:, 2].max(), pixels[:, 3].max()
    scale = np.array([(east - west) / (right - left), (north - south) / (bottom - top)]).mean()
    solution = np.array([scale, west - scale * left, north + scale * top])
    for _ in range(2):
        overlap = _overlap(_to_metres(solution, pixels), boxes_m)
        region, patch = overlap.argmax(1), np.arange(len(pixels))
        sound = overlap[patch, region] >= _OVERLAP
        if not sound.any():
            return nothing
        seen, wanted = pixels[sound], boxes_m[region[sound]]

        def misfit_m(guess: np.ndarray, seen=seen, wanted=wanted) -> np.ndarray:
            return (_to_metres(guess, seen) - wanted).ravel()

        solution = least_squares(misfit_m, solution, loss="soft_l1", f_scale=_EDGE_SCALE_M).x
    matched = {number: regions[region[i]].index for i, number in enumerate(patches) if sound[i]}
    return (
        matched,
        float(solution[0]),
        (float(solution[1]), float(solution[2])),
        float(np.median(np.abs(misfit_m(solution)))),
    )


def _to_metres(solution: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N, 4) x low, y high, x high, y low of boxes (N, 4) left, top, right, bottom; solution: metres a pixel, x and y
    of the origin."""
    scale, x, y = solution
    return pixels * np.array([scale, -scale, scale, -scale]) + np.array([x, y, x, y])


def _overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, M) intersection over union of boxes x low, y high, x high, y low."""
    width = np.minimum(a[:, None, 2], b[:, 2]) - np.maximum(a[:, None, 0], b[:, 0])
    height = np.minimum(a[:, None, 1], b[:, 1]) - np.maximum(a[:, None, 3], b[:, 3])
    shared = np.maximum(width, 0) * np.maximum(height, 0)
    area = [(box[:, 2] - box[:, 0]) * (box[:, 1] - box[:, 3]) for box in (a, b)]
    return shared / (area[0][:, None] + area[1] - shared)


def _share(mask: np.ndarray, step: int) -> np.ndarray:
    """(rows, columns) share of a mask in cells of step x step pixels; beyond the picture there is nothing."""
    rows, columns = (-(-size // step) * step for size in mask.shape)
    padded = np.pad(mask, ((0, rows - mask.shape[0]), (0, columns - mask.shape[1])))
    return padded.reshape(rows // step, step, columns // step, step).mean((1, 3))


def _cells(label: np.ndarray, step: int, free: np.ndarray) -> np.ndarray:
    """(rows, columns) the label that most of a cell has; stripes at thresholds and stains take that of the nearest
    room."""
    from scipy import ndimage

    numbers = np.unique(label[label > 0])
    most = np.stack([_share(label == number, step) for number in numbers])
    cells = np.where(free & (most.max(0) > 0), numbers[most.argmax(0)], 0)
    rooms = np.zeros_like(cells)
    for number in numbers:
        parts, count = ndimage.label(cells == number)
        if count:
            rooms[parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])] = number
    nearest = ndimage.distance_transform_edt(rooms == 0, return_distances=False, return_indices=True)
    return rooms[tuple(nearest)]
