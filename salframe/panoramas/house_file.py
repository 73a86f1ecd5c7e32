"""Read the .house file of a Matterport3D building: regions, objects, and positions of panoramas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError, one_line
from salframe.framework.files.reading import read_text

_NAME_LENGTH = 32
"""Length of the name of a panorama: 32 hexadecimal digits. A P line with a shorter name is a portal."""


@dataclass(frozen=True, eq=False)
class Region:
    """A room of the building.

    Attributes:
        index: Index in the file.
        level: Level of the building.
        kind: Letter of the room type.
        low_m: (3,) minimum corner of the box in the world.
        high_m: (3,) maximum corner of the box in the world.
        outlines_m: Polygons of the room on the floor, (n, 2) world x and y each. If the file has none, the rectangle of
            the box.
    """

    index: int
    level: int
    kind: str
    low_m: np.ndarray
    high_m: np.ndarray
    outlines_m: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class StandingPoint:
    """The position of a panorama.

    Attributes:
        region: Index of its region; None if it is in no region.
        position_m: (3,) position in the world.
    """

    region: int | None
    position_m: np.ndarray


@dataclass(frozen=True, eq=False)
class HouseObject:
    """An annotated object with its oriented box in the world.

    Attributes:
        index: Index in the file.
        label: Label of the object.
        category: Category, one of the forty of Matterport3D.
        centre_m: (3,) centre of the box.
        axes: (3, 3) axes of the box, one in each row.
        half_m: (3,) half extents of the box along its axes.
    """

    index: int
    label: str
    category: str
    centre_m: np.ndarray
    axes: np.ndarray
    half_m: np.ndarray


@dataclass(frozen=True, eq=False)
class HouseFile:
    """Content of a .house file: regions and objects in the order of the file, and panoramas by name."""

    regions: tuple[Region, ...]
    objects: tuple[HouseObject, ...]
    panoramas: dict[str, StandingPoint]


def read_house(path: Path) -> HouseFile:
    """Read a .house file (data_organization.md of the Matterport3D release).

    Raises:
        DataError: The file is missing, malformed or empty.
    """
    expected = "a .house file (house_segmentations of the Matterport3D release)"
    lines = [line.split() for line in read_text(path, expected).splitlines()]
    try:
        regions, objects = tuple(_regions(lines)), tuple(_objects(lines))
        panoramas = {
            words[1]: StandingPoint(int(words[3]) if int(words[3]) >= 0 else None, _vector(words, 5))
            for words in lines
            if words[:1] == ["P"] and len(words[1]) == _NAME_LENGTH
        }
    except (IndexError, ValueError) as error:
        reason = "a line is too short" if isinstance(error, IndexError) else one_line(error)
        raise DataError(f"{path} is not {expected}: {reason}") from None
    numbers = [*(r.low_m for r in regions), *(r.high_m for r in regions), *(o for r in regions for o in r.outlines_m)]
    numbers += [part for o in objects for part in (o.centre_m, o.axes, o.half_m)]
    numbers += [point.position_m for point in panoramas.values()]
    if not all(np.isfinite(part).all() for part in numbers):
        raise DataError(f"{path} contains NaN or infinity, expected finite numbers")
    if not regions:
        raise DataError(f"{path} has no regions (rooms), expected lines that begin with R")
    return HouseFile(regions, objects, panoramas)


def _regions(lines: list[list[str]]) -> Iterator[Region]:
    surfaces: dict[int, list[int]] = {}
    corners: dict[int, list[list[float]]] = {}
    for words in lines:
        if words[:1] == ["S"]:
            surfaces.setdefault(int(words[2]), []).append(int(words[1]))
        elif words[:1] == ["V"]:
            corners.setdefault(int(words[2]), []).append([float(words[4]), float(words[5])])
    for words in lines:
        if words[:1] == ["R"]:
            index, low, high = int(words[1]), _vector(words, 9), _vector(words, 12)
            if len(words[5]) != 1 or words[5].isdigit():
                raise ValueError(
                    f"the type of region {index} is {words[5]!r}, expected one character that is not a digit"
                )
            if (high < low).any():
                raise ValueError(
                    f"the maximum corner {high} of region {index} is below the minimum corner {low}, expected larger "
                    "values"
                )
            outlines = tuple(
                np.array(corners[surface]) for surface in surfaces.get(index, ()) if len(corners.get(surface, ())) > 2
            )
            box = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
            yield Region(index, int(words[2]), words[5], low, high, outlines or (box,))


def _objects(lines: list[list[str]]) -> Iterator[HouseObject]:
    categories = {words[1]: words for words in lines if words[:1] == ["C"]}
    for words in lines:
        if words[:1] == ["O"] and words[3] in categories:
            category = categories[words[3]]
            first, second = _vector(words, 7), _vector(words, 10)
            axes = np.stack([first, second, np.cross(first, second)])
            label = category[3].replace("#", " ").strip().lower()
            yield HouseObject(int(words[1]), label, category[5], _vector(words, 4), axes, _vector(words, 13))


def _vector(words: list[str], first: int) -> np.ndarray:
    """Return three numbers of a line as (3,), starting at word `first`. Raises ValueError if the line is too short."""
    if len(words) < first + 3:
        raise ValueError(
            f"the line that begins with {' '.join(words[:2])!r} has {len(words)} words, expected {first + 3} or more"
        )
    return np.array(words[first : first + 3], float)
