"""Compare the places of reference frames with the regions of the floor masks that they stand on."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks, check_heights, floor_numbers, floor_pixels
from salframe.panoramas.frames import FrameKind, ReferenceFrame

MAX_OFFSET_M = {FrameKind.SCENE: 0.5, FrameKind.TRANSITION: 0.75}
"""Maximum distance between a frame and the region of its place. A frame in a doorway may be on either side of the edge
of a region, at most this far from it."""
MAX_SHARE = 0.05
"""Maximum share of frames that may stand outside the region of their place."""
NUM_LISTED = 3
"""Number of frames to name in a warning."""
MAX_FRAMES = 100
"""Maximum number of frames with which possible causes are tried."""
SHIFTS_M = np.arange(-3.0, 3.01, 0.5)
SCALES = 0.1, 0.5, 2.0, 10.0
"""Shifts along x and y, and factors of the resolution, that are tried to find the cause of wrong masks."""


@dataclass(frozen=True)
class MisplacedFrame:
    """A frame that stands outside the region of its place in the masks.

    Attributes:
        frame: Id of the frame.
        place: Place of the frame.
        region: Name of the region that the frame stands on; None for no region.
        in_doorway: Whether the frame is declared to be in a doorway (transition frame), but is far from all edges of
            regions.
    """

    frame: str
    place: str
    region: str | None
    in_doorway: bool = False

    def __str__(self) -> str:
        region = "no region" if self.region is None else f"region {self.region}"
        return f"{self.frame} ({'doorway' if self.in_doorway else f'place {self.place}'}, {region})"


@dataclass(frozen=True)
class RegionComparison:
    """The frames that could be compared with the floor masks, and the frames outside the region of their place.

    A frame is compared if it stands on a region, or if its place has a region.
    """

    num_compared: int
    misplaced_frames: tuple[MisplacedFrame, ...]

    @property
    def is_contradiction(self) -> bool:
        """Whether more than MAX_SHARE of the frames are misplaced."""
        return len(self.misplaced_frames) > MAX_SHARE * self.num_compared


def compare_regions(frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]) -> RegionComparison:
    """Compare the places of reference frames with the regions that they stand on."""
    if not frames:
        return RegionComparison(0, ())
    floors = sorted(floors, key=lambda floor: floor.z_m)
    with_region = {place for floor in floors for place in floor.regions.values()}
    xyz_m = np.array([frame.T_world_pano[:3, 3] for frame in frames])
    num_compared, misplaced_frames = 0, []
    for frame, number in zip(frames, floor_numbers(floors, xyz_m).tolist(), strict=True):
        region, near = (None, {None}) if number < 0 else _regions_near(floors[number], frame)
        if frame.place not in with_region and region is None:
            continue
        num_compared += 1
        if frame.kind is FrameKind.TRANSITION and near == {region} and region is not None:
            misplaced_frames.append(MisplacedFrame(frame.id, frame.place, region, in_doorway=True))
        elif frame.place not in near and (frame.kind is FrameKind.SCENE or frame.place in with_region):
            misplaced_frames.append(MisplacedFrame(frame.id, frame.place, region))
    return RegionComparison(num_compared, tuple(misplaced_frames))


def check_regions(frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]) -> str | None:
    """Return a one-line warning if frames stand outside the region of their place; None if all stand in it.

    Raises:
        DataError: More than MAX_SHARE of the frames stand outside the region of their place, or two floors that touch
            have the same height. The message names the likely cause.
    """
    check_heights(floors)
    comparison = compare_regions(frames, floors)
    misplaced_frames = comparison.misplaced_frames
    if not misplaced_frames:
        return None
    listed = ", ".join(map(str, misplaced_frames[:NUM_LISTED]))
    more = ", ..." if len(misplaced_frames) > NUM_LISTED else ""
    line = (
        f"{len(misplaced_frames)} of {comparison.num_compared} reference frames (panoramas of the map) stand outside "
        f"the region of their place in the floor masks: {listed}{more}"
    )
    if not comparison.is_contradiction:
        return line
    raise DataError(
        f"{line}; expected at most {MAX_SHARE:.0%} of the frames: {_likely_cause(frames, floors, misplaced_frames)}"
    )


def _regions_near(floor: FloorMasks, frame: ReferenceFrame) -> tuple[str | None, set[str | None]]:
    """Return the name of the region on which a frame stands, and the names of all regions within MAX_OFFSET_M.

    None stands for pixels in no region.
    """
    row, column = floor_pixels(floor, frame.T_world_pano[None, :2, 3])[0].tolist()
    reach = int(MAX_OFFSET_M[frame.kind] / floor.resolution_m)
    top, left = max(0, row - reach), max(0, column - reach)
    window = floor.region[top : row + reach + 1, left : column + reach + 1]
    rows, columns = np.ogrid[: window.shape[0], : window.shape[1]]
    is_near = (rows - (row - top)) ** 2 + (columns - (column - left)) ** 2 <= reach**2
    names = {floor.regions.get(label) for label in np.unique(window[is_near]).tolist()}
    return floor.regions.get(int(floor.region[row, column])), names


def _likely_cause(
    frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks], misplaced_frames: Sequence[MisplacedFrame]
) -> str:
    """Return the likely cause of the contradiction: the first change of the masks, such as a flip, after which frames
    and regions agree."""
    sample = frames[:: 1 + len(frames) // MAX_FRAMES]
    for cause, changed in _changes(frames, floors, misplaced_frames):
        comparison = compare_regions(sample, changed)
        if comparison.num_compared and not comparison.is_contradiction:
            return cause
    return "compare `place`, `pose`, `regions`, `z_m` and `origin_m` in manifest.json; one storey may have no masks"


def _changes(
    frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks], misplaced_frames: Sequence[MisplacedFrame]
) -> Iterator[tuple[str, list[FloorMasks]]]:
    """Yield possible errors of the masks in words, each with the floors after a correction of this error."""
    heights_m = _heights(frames, floors)
    listed = ", ".join(f"{floor.z_m:g}" for floor in floors)
    yield (
        f"z_m of the floors may be wrong ({listed}), expected the height of each floor in the world, below its cameras",
        [replace(floor, z_m=z_m) for floor, z_m in zip(floors, heights_m, strict=True)],
    )
    names = _renaming(misplaced_frames)
    renamed = ", ".join(f"{region} should be {place}" for region, place in list(names.items())[:NUM_LISTED])
    yield (
        f"names in `regions` may be swapped ({renamed})",
        [replace(f, regions={label: names.get(name, name) for label, name in f.regions.items()}) for f in floors],
    )
    for axis, edge in ((0, "row 0 must be at the largest y"), (1, "column 0 must be at the smallest x")):
        yield f"masks may be mirrored: {edge}", [_flipped(floor, axis) for floor in floors]
    yield (
        "origin_m may be the lower left corner, expected the upper left corner",
        [_moved(floor, 0.0, floor.resolution_m * len(floor.region)) for floor in floors],
    )
    for scale in SCALES:
        yield (
            f"resolution_m may be wrong, a value {scale:g} times as large fits",
            [replace(floor, resolution_m=floor.resolution_m * scale) for floor in floors],
        )
    for x_m, y_m in sorted(((x, y) for x in SHIFTS_M for y in SHIFTS_M), key=lambda shift: float(np.hypot(*shift))):
        yield (
            f"masks may be shifted: move origin_m by ({x_m:g}, {y_m:g}) m",
            [_moved(floor, x_m, y_m) for floor in floors],
        )


def _renaming(misplaced_frames: Sequence[MisplacedFrame]) -> dict[str, str]:
    """Return for each region the place of most misplaced frames that stand on this region."""
    places: dict[str, Counter[str]] = defaultdict(Counter)
    for misplaced_frame in misplaced_frames:
        if misplaced_frame.region is not None:
            places[misplaced_frame.region][misplaced_frame.place] += 1
    return {region: count.most_common(1)[0][0] for region, count in places.items()}


def _heights(frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]) -> list[float]:
    """Return for each floor a height that is plausible for the cameras of its places."""
    heights_m = []
    for floor in floors:
        places = set(floor.regions.values())
        cameras_m = [float(frame.T_world_pano[2, 3]) for frame in frames if frame.place in places]
        heights_m.append(min(cameras_m, default=floor.z_m + 1e-3) - 1e-3)
    return heights_m


def _flipped(floor: FloorMasks, axis: int) -> FloorMasks:
    free, region, obstacle = (np.flip(mask, axis) for mask in (floor.free, floor.region, floor.obstacle))
    return replace(floor, free=free, region=region, obstacle=obstacle)


def _moved(floor: FloorMasks, x_m: float, y_m: float) -> FloorMasks:
    return replace(floor, origin_m=(floor.origin_m[0] + x_m, floor.origin_m[1] + y_m))
