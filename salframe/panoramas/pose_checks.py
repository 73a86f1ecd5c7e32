"""Compare the poses of reference frames with their range images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.cube_depth import is_cube_depth
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frame_agreement import (
    DEFAULT_TOLERANCE,
    Agreement,
    RangeView,
    Tolerance,
    mean_agreement,
    nearest_pairs,
    pair_agreements,
)
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d, range_of_cube_depth
from salframe.panoramas.pose_conventions import NAMES, PoseConvention, convert_pose

NUM_FRAMES = 24
"""Maximum number of frames whose range images are compared."""
MAX_TILT_DEG = 10.0
"""Maximum angle between the up axes of a panorama and of the world that causes no warning."""
REFUSED_TILT_DEG, REFUSED_SHARE = 45.0, 0.1
"""The poses are an error if more than this share of the frames is tilted by more than this angle."""
MIN_RATIO = 0.88
"""A lower `Agreement.ratio` of all frames causes a warning. The ratio is 0.99 to 1.00 in rendered buildings, and 0.95
if positions have errors of 0.1 m."""
MIN_EVIDENCE = 0.08
"""Minimum `Agreement.evidence` of all frames at which `Agreement.ratio` is used."""
MIN_ON_SURFACE = 0.25
"""Minimum share of agreeing points after a correction, for frames of one place that see no common surface before."""
MIN_PAIR_RATIO, MIN_PAIR_EVIDENCE = 0.6, 0.2
"""Minimum `Agreement.ratio` of a pair of frames without a warning, and minimum evidence for checking a pair."""
CLOSE = Tolerance(relative=0.02, offset=0.02)
"""Maximum difference of ranges that agree, in the comparison of position scales near 1."""
CLOSE_SCALES = (0.75, 0.8, 0.85, 0.9, 0.93, 1.07, 1.1, 1.15, 1.2, 1.25, 1.33)
MIN_SCALE_GAIN = 0.06
"""Minimum increase of `Agreement.ratio` at another scale, with the tolerance CLOSE."""
UNIT_SCALES = (0.001, 0.01, 0.1, 0.3048, 1 / 0.3048, 10.0, 100.0, 1000.0)
"""Factors of the positions that correct a unit: millimetres, centimetres, decimetres, feet, and the reverse."""
SCALES = (*np.geomspace(0.2, 5.0, 45).tolist(), *UNIT_SCALES)
"""Factors of the positions that are tried as corrections."""
ALIKE_NET = 0.01
"""Maximum difference of `Agreement.net` between corrections that count as equally good."""
MIN_NAMED_GAIN = 0.25
"""Minimum increase of `Agreement.ratio` to report a correction after which the ratio is still below MIN_RATIO."""
MAX_FLOOR_ERROR_M = 0.35
"""Maximum difference between the height of the visible floor and the height of the floor masks."""


class _Explanation(NamedTuple):
    """A correction of the poses or ranges after which the frames may agree better.

    Attributes:
        agreement: Agreement of the frames after the correction.
        text: The correction in words; "" for a scale of the positions.
        scale: Factor of the positions.
        surprise: How unusual the error is. Of equally good corrections, the one with the lowest value is reported.
    """

    agreement: Agreement
    text: str
    scale: float = 1.0
    surprise: float = 0.0


@dataclass(frozen=True, eq=False)
class _Sample:
    """Reference frames with their range images."""

    frames: tuple[ReferenceFrame, ...]
    ranges: tuple[np.ndarray, ...]
    views: tuple[RangeView, ...]

    @property
    def poses(self) -> list[np.ndarray]:
        return [frame.T_world_pano for frame in self.frames]

    def pairs(self, poses: Sequence[np.ndarray]) -> list[tuple[int, int]]:
        return nearest_pairs([frame.place for frame in self.frames], np.array([pose[:3, 3] for pose in poses]))

    def agreement(
        self,
        poses: Sequence[np.ndarray],
        tolerance: Tolerance = DEFAULT_TOLERANCE,
        views: Sequence[RangeView] | None = None,
    ) -> Agreement:
        return mean_agreement(pair_agreements(views or self.views, poses, self.pairs(poses), tolerance))


def pose_notes(
    frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks] = (), *, compares_ranges: bool = True
) -> list[str]:
    """Return one-line warnings if poses contradict the panoramas; empty if they do not.

    The up directions of all frames are checked. The ranges of up to NUM_FRAMES frames are compared in pairs. Frames
    without range and unreadable frames take part in the first check only. docs/explanation/data-checks.md lists what
    these checks detect.

    Args:
        frames: The reference frames.
        floors: The floor masks. Their heights are compared with the heights of the cameras.
        compares_ranges: Whether to compare the range images; False checks the up directions only.

    Raises:
        DataError: According to their poses, many panoramas are not upright.
    """
    tilts = np.array([_tilt_deg(frame.T_world_pano) for frame in frames])
    is_tilted, is_hanging = tilts > MAX_TILT_DEG, tilts > 180 - MAX_TILT_DEG
    notes = []
    if is_hanging.sum() > REFUSED_SHARE * len(frames) and _hang(frames, is_hanging):
        notes.append(
            f"{is_hanging.sum()} of {len(frames)} reference frames (panoramas of the map) hang upside down according "
            "to their poses and to the floor that they show: the images are turned upright"
        )
        is_tilted &= ~is_hanging
    if np.count_nonzero(is_tilted & (tilts > REFUSED_TILT_DEG)) > REFUSED_SHARE * len(frames):
        raise DataError(_tilt_error(frames, tilts))
    if is_tilted.any():
        first = int(is_tilted.argmax())
        notes.append(
            f"{is_tilted.sum()} of {len(frames)} reference frames (panoramas of the map) are tilted by more than "
            f"{MAX_TILT_DEG:g} deg according to their poses ({frames[first].id}: {tilts[first]:.0f} deg). Their images "
            "are levelled: if the camera was upright, check the setting pose_convention"
        )
    if not compares_ranges:
        return notes
    sample = _load(frames)
    if cube := _cube_note(sample):
        return [*notes, cube]
    return [*notes, *(_agreement_notes(sample) or _height_notes(sample, floors))]


def _hang(frames: Sequence[ReferenceFrame], is_hanging: np.ndarray) -> bool:
    """Return whether the range images confirm that the cameras hang upside down, as their poses say.

    They confirm it if the floor, at z = 0, is in the upper half of the images. Poses in a world with z down have the
    same rotations, but a negative z.
    """
    sample = _load([frame for frame, hangs in zip(frames, is_hanging, strict=True) if hangs])
    heights_m = [camera_height(range_m[::-1]) for range_m in sample.ranges]
    is_confirmed = [
        height_m is not None and abs(pose[2, 3] - height_m) <= MAX_FLOOR_ERROR_M
        for height_m, pose in zip(heights_m, sample.poses, strict=True)
    ]
    return bool(is_confirmed) and bool(np.mean(is_confirmed) > 0.5)


def _tilt_deg(pose: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(pose[2, 2], -1, 1))))


def _tilt_error(frames: Sequence[ReferenceFrame], tilts: np.ndarray) -> str:
    worst = int(np.argmax(tilts > REFUSED_TILT_DEG))
    text = (
        f"{(tilts > REFUSED_TILT_DEG).sum()} of {len(frames)} reference frames (panoramas of the map) are not upright "
        f"according to their poses ({frames[worst].id}: the up axis of the panorama is {tilts[worst]:.0f} deg from the "
        "up axis of the world)"
    )
    if np.median(tilts) > 180 - MAX_TILT_DEG:
        return f"{text}, likely the camera hangs upside down: turn the images and the poses by 180 deg about the x axis"
    level = [
        name for name in NAMES if all(_tilt_deg(convert_pose(f.T_world_pano, name)) <= MAX_TILT_DEG for f in frames)
    ]
    if not level:
        return f"{text}, expected T_world_pano with x forward, y left, z up (salframe docs folder-format)"
    sample = _load(frames)
    ratio = {name: sample.agreement([convert_pose(pose, name) for pose in sample.poses]).ratio for name in level}
    best, *rest = sorted(level, key=lambda name: -ratio[name])
    alike = [name for name in rest if ratio[name] >= ratio[best] - 0.02]
    others = f" (or {', '.join(alike)})" if alike else ""
    return (
        f'{text}, likely the poses follow another convention: set "pose_convention": "{best}"{others} in manifest.json'
    )


def _load(frames: Sequence[ReferenceFrame]) -> _Sample:
    """Load the range of some frames: frames at equal distances in the list, each with its nearest neighbour."""
    partner: dict[int, int] = {}
    if len(frames) > NUM_FRAMES:
        positions = np.array([frame.T_world_pano[:3, 3] for frame in frames])
        for first, second in nearest_pairs([frame.place for frame in frames], positions):
            partner.setdefault(first, second)
            partner.setdefault(second, first)
        starts = sorted({round(i) for i in np.linspace(0, len(frames) - 1, NUM_FRAMES // 2)})
        chosen = sorted({index for start in starts for index in (start, partner.get(start, start))})
    else:
        chosen = list(range(len(frames)))
    loaded = []
    for index in chosen:
        range_m = _range_of(frames[index])
        if range_m is not None and np.isfinite((view := RangeView(range_m)).median):
            loaded.append((frames[index], range_m, view))
        elif not loaded and index != chosen[0]:
            break  # if the first two frames have no range, the others usually have none either
    return _Sample(*(tuple(column) for column in zip(*loaded, strict=True))) if loaded else _Sample((), (), ())


def _range_of(frame: ReferenceFrame) -> np.ndarray | None:
    try:
        return frame.load().range_m
    except Exception:  # raised by a plugin; the code that uses the frame later reports the error
        return None


def _cube_note(sample: _Sample) -> str | None:
    """Return a warning if the range images hold z-depth of cube faces: the floor below has one depth."""
    flags = [is_cube_depth(range_m) for range_m in sample.ranges]
    if sum(flags) * 2 <= len(flags):
        return None
    return (
        f"{sum(flags)} of {len(flags)} checked range images contain z-depth of cube faces (depth along the axis of the "
        f"face), such as {sample.frames[flags.index(True)].id}, expected the distance along the ray: "
        'set "range_kind": "cube" in manifest.json'
    )


def _agreement_notes(sample: _Sample) -> list[str]:
    pairs = sample.pairs(sample.poses)
    if not pairs:
        return []
    compared = pair_agreements(sample.views, sample.poses, pairs)
    total = mean_agreement(compared)
    if total.evidence >= MIN_EVIDENCE and total.ratio >= MIN_RATIO:
        if (scale := _close_scale(sample)) is not None:
            return [f"{_contradiction(sample, total)}: {_scale_text(_finer_scale(sample, scale), sample)}"]
        return _pair_notes(sample, pairs, compared)
    shares_a_place = any(sample.frames[first].place == sample.frames[second].place for first, second in pairs)
    if total.evidence < MIN_EVIDENCE and not shares_a_place:
        return []  # frames of different rooms need not see one another
    explanation = _explain(sample, total)
    if total.evidence < MIN_EVIDENCE and (explanation is None or explanation.agreement.on_surface < MIN_ON_SURFACE):
        return []  # a large place whose frames see nothing in common
    if explanation is None and (notes := _pair_notes(sample, pairs, compared)):
        return notes
    if explanation is None:
        cause = "check the positions, headings and unit of the poses, and the unit of the ranges"
    else:
        cause = explanation.text or _scale_text(_finer_scale(sample, explanation.scale), sample)
    return [f"{_contradiction(sample, total)}: {cause}"]


def _contradiction(sample: _Sample, total: Agreement) -> str:
    return (
        f"poses and ranges of {len(sample.frames)} reference frames (panoramas of the map) contradict each other "
        f"({100 * total.ratio:.0f} % of the points that are visible in two frames agree, "
        f"expected at least {100 * MIN_RATIO:.0f} %)"
    )


def _close_scale(sample: _Sample) -> float | None:
    """Return the scale near 1 under which the frames agree better, None if none does."""
    today = sample.agreement(sample.poses, CLOSE).ratio
    ratios = {scale: sample.agreement(_scaled(sample.poses, scale), CLOSE).ratio for scale in CLOSE_SCALES}
    best = max(ratios, key=ratios.__getitem__)
    return best if ratios[best] >= today + MIN_SCALE_GAIN else None


def _pair_notes(sample: _Sample, pairs: Sequence[tuple[int, int]], compared: Sequence[Agreement]) -> list[str]:
    wrong = [
        pair
        for pair, one in zip(pairs, compared, strict=True)
        if one.ratio < MIN_PAIR_RATIO and one.evidence >= MIN_PAIR_EVIDENCE
    ]
    if not wrong:
        return []
    first, second = (sample.frames[index].id for index in wrong[0])
    return [
        f"the poses of {len(wrong)} of {len(pairs)} pairs of neighbouring reference frames (panoramas of the map) "
        f"contradict their ranges (the first pair: {first} and {second}), expected agreement: check the poses and "
        "places of these frames"
    ]


def _explain(sample: _Sample, total: Agreement) -> _Explanation | None:
    """Return the change of poses or ranges under which the frames agree best; None if none agrees much better."""
    candidates = list(_candidates(sample))
    limit = max(candidate.agreement.net for candidate in candidates) - ALIKE_NET
    best = min(
        (candidate for candidate in candidates if candidate.agreement.net >= limit), key=lambda one: one.surprise
    )
    ratio = best.agreement.ratio
    return best if ratio >= MIN_RATIO or ratio >= total.ratio + MIN_NAMED_GAIN else None


def _candidates(sample: _Sample) -> Iterator[_Explanation]:
    poses, floor_m = sample.poses, _floor_distance_m(sample)
    for name in NAMES[1:]:
        converted = [convert_pose(pose, name) for pose in poses]
        if all(_tilt_deg(pose) <= MAX_TILT_DEG for pose in converted):
            below_m = float(np.median([pose[2, 3] for pose in converted])) - (floor_m or 0.0)
            yield _Explanation(sample.agreement(converted), _convention_text(name), surprise=abs(below_m))
    for scale in SCALES:
        yield _Explanation(sample.agreement(_scaled(poses, scale)), "", scale)
    for name, step in (("ros", 5), ("compass", 15)):
        converted = [convert_pose(pose, name) for pose in poses]
        for offset in (angle for angle in range(step - 180, 181, step) if angle):
            turned = [pose @ pose_2d(0, 0, np.radians(offset)) for pose in converted]
            text = (
                f"likely the centre of the images lies {abs(offset)} deg to the {'left' if offset > 0 else 'right'} of "
                "the heading of the poses, expected 0: turn the poses or shift the columns of the images"
            )
            text = text if name == "ros" else f"{_convention_text(name)}, and {text}"
            yield _Explanation(sample.agreement(turned), text, surprise=float(offset % 90 != 0))
    views = [RangeView(range_of_cube_depth(range_m)) for range_m in sample.ranges]
    text = (
        "likely the ranges are z-depth of cube faces (depth along the axis of the face): "
        'set "range_kind": "cube" in manifest.json'
    )
    yield _Explanation(sample.agreement(poses, views=views), text)


def _convention_text(name: PoseConvention) -> str:
    text = f'likely the poses follow the convention "{name}": set "pose_convention": "{name}" in manifest.json'
    return f"{text}, unless the images are mirrored or upside down" if name == "image-plan" else text


def _scaled(poses: Iterable[np.ndarray], scale: float) -> list[np.ndarray]:
    scaled = []
    for pose in poses:
        pose = pose.copy()
        pose[:3, 3] *= scale
        scaled.append(pose)
    return scaled


def _finer_scale(sample: _Sample, scale: float) -> float:
    """Return a scale of UNIT_SCALES if one fits, else the middle of the best scales near a scale of the grid SCALES."""
    scales = scale * np.geomspace(0.93, 1 / 0.93, 31)
    ratios = np.array([sample.agreement(_scaled(sample.poses, value), CLOSE).ratio for value in scales])
    best = scales[ratios >= ratios.max() - 0.005]
    units = [unit for unit in UNIT_SCALES if best.min() * 0.98 <= unit <= best.max() * 1.02]
    return units[0] if units else float(np.median(best))


def _scale_text(scale: float, sample: _Sample) -> str:
    """Return the likely causes in words if positions times `scale` agree with the ranges."""
    times = f"{max(scale, 1 / scale):.4g} times too {'small' if scale > 1 else 'large'}"
    floor_m = _floor_distance_m(sample)
    height = "" if floor_m is None else f" (the floor lies {floor_m:.2f} m below the cameras)"
    return (
        f'the positions are {times} for the ranges: in manifest.json, multiply "pose_unit_m" (default 1) by '
        f"{scale:.4g}, "
        f'or "range_unit_m" (default 0.001) by {1 / scale:.4g}{height}'
    )


def _floor_distance_m(sample: _Sample) -> float | None:
    """Return the median height of the first cameras above the floor; None if no floor is visible."""
    heights = [height for range_m in sample.ranges[:3] if (height := camera_height(range_m)) is not None]
    return float(np.median(heights)) if heights else None


def _height_notes(sample: _Sample, floors: Sequence[FloorMasks]) -> list[str]:
    """Compare the heights of the poses with the distances to the visible floor."""
    rows = [
        (frame, float(frame.T_world_pano[2, 3]), height)
        for frame, range_m in zip(sample.frames, sample.ranges, strict=True)
        if (height := camera_height(range_m)) is not None
    ]
    if not rows:
        return []
    frames, z_m, height_m = zip(*rows, strict=True)
    if len(rows) > 1 and np.allclose(z_m, -np.array(height_m), rtol=0.1):
        return [
            f"the cameras are {height_m[0]:.2f} m above the visible floor, but the z of their poses is {z_m[0]:.2f} m "
            f"({frames[0].id}), expected the opposite sign: {_convention_text('ros-world-to-camera')}"
        ]
    if not floors:
        return []
    floor_z_m = np.array([floor.z_m for floor in floors])
    errors = np.abs(np.subtract(z_m, height_m)[:, None] - floor_z_m).min(axis=1)
    if np.median(errors) <= MAX_FLOOR_ERROR_M:
        return []
    middle = int(np.argsort(errors)[len(errors) // 2])
    visible_z_m = z_m[middle] - height_m[middle]
    expected_z_m = min(floor_z_m, key=lambda floor: abs(floor - visible_z_m))
    return [
        f"the ranges of {frames[middle].id} show the floor at z = {visible_z_m:.2f} m, expected the z_m of the floor "
        f"masks, {expected_z_m:.2f} m: check z_m, the unit of the poses and the unit of the ranges"
    ]
