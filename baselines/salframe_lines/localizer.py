"""The localizer `lines`: compares line distance functions of a query and of 3D lines, then aligns the lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from salframe.framework.component import match_only
from salframe.framework.errors import InputMissing
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, LevelledConfig, Localizer, range_slot
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.line_segments import find_segments
from salframe.panoramas.panorama import Panorama
from salframe_lines.alignment import AGREE_RAD, agreement, refine, search
from salframe_lines.arcs import (
    Arcs,
    Lines3d,
    arcs_along_axes,
    lift_arcs,
    line_distances,
    principal_yaw,
    rotate_by_quarter_turn,
)
from salframe_lines.distances import agreeing_share, distance_codes, distance_codes_from, sphere_points

OUTLIER_SHARE = 0.05
"""Fraction of line ends that is ignored on each side when the extent of a room is estimated by quantiles, as in LDL."""


class _MapLines(NamedTuple):
    """The 3D lines of one reference frame.

    Attributes:
        T_world_principal: (4, 4) pose of the principal frame.
        lines: Lines along each axis.
        has_range: Whether the distances of the lines are known.
        positions_m: (T, 3) candidate positions of a query in the principal frame.
    """

    T_world_principal: np.ndarray
    lines: tuple[Lines3d, Lines3d, Lines3d]
    has_range: bool
    positions_m: np.ndarray


class Lines(Localizer):
    """Compares line segments of query and map on the sphere, as in LDL (Kim et al. 2023) and FGPL (Kim et al. 2024).

    A line distance function gives, for each direction, the angle to the nearest line. The function of the query is
    compared with the functions at the points of a grid around each reference frame. Only lines along three principal
    directions are used. The principal directions of two upright panoramas can be aligned by four rotations, and all
    four are tested. Each pair of a reference frame and a rotation is a candidate. Its position is the grid point whose
    function is most similar to that of the query.

    The lines of the best candidates (setting `shortlist`) are then aligned with the lines of the query. The answer is
    the place and the pose of the candidate that explains the largest share of the query's lines.
    """

    name = "lines"
    version = "1"
    column_step: ClassVar[int | None] = None  # views of a rotated panorama are sampled at other pixels

    class Config(LevelledConfig):
        range: range_slot()  # type: ignore[valid-type]
        max_lines: int = Field(
            100,
            ge=1,
            description="maximum number of line segments along each of the three principal directions; the longest "
            "segments are used",
        )
        sphere_points: int = match_only(
            162,
            ge=1,
            le=100_000,
            description="number of points on the unit sphere at which line distance functions are compared",
        )
        step_m: float = match_only(0.35, ge=0.01, description="spacing (m) of the grid around a reference frame")
        reach_m: float = match_only(
            5.0,
            ge=0,
            description="maximum distance (m) of the points of the grid from the reference frame, along x and along y",
        )
        inlier_rad: float = match_only(
            0.1,
            gt=0,
            le=0.3,
            description="maximum difference (radians) at which two values of line distance functions count as equal",
        )
        shortlist: int = match_only(
            8,
            ge=1,
            description="number of candidates whose lines are aligned with the lines of the query. A candidate is a "
            "reference frame with one of the four rotations",
        )
        min_agreement: float = match_only(
            0.1,
            ge=0,
            le=1,
            description="minimum share (0 to 1) of the total length of the query's lines that agrees with lines of "
            "the map under a pose. If the share is smaller, the pose is rejected",
        )

    uses: ClassVar[frozenset[str]] = frozenset({"range"})
    """Parts of a panorama that reference frames need for a pose: the range."""

    @property
    def needs(self) -> frozenset[str]:
        return frozenset({"rgb"})

    def describe(self, panorama: Panorama) -> Description:
        """Return the lines of a panorama in its principal frame, 17 bytes per line.

        The entries are `yaw_rad` (), the yaw of the principal frame; `axis` (N,) uint8; `around_rad` (N,) and
        `along_rad` (N, 2) float32, see salframe_lines.arcs; and `distance_m` (N,) float32, the distance of the camera
        from the line, NaN where unknown.
        """
        if panorama.rgb is None:
            raise InputMissing(f"{panorama.display_name} has no colour image, which the method {self.name!r} needs")
        ends = find_segments(panorama.rgb, panorama.valid)
        yaw_rad = principal_yaw(ends)
        arcs = arcs_along_axes(ends, yaw_rad, self.config.max_lines)
        if panorama.range_m is None:
            distance_m = [np.full(len(along.around_rad), np.nan) for along in arcs]
        else:
            distance_m = [line_distances(along, axis, yaw_rad, panorama.range_m) for axis, along in enumerate(arcs)]
        return {
            "yaw_rad": np.array(yaw_rad),
            "axis": np.repeat(np.arange(3, dtype=np.uint8), [len(along.around_rad) for along in arcs]),
            "around_rad": np.concatenate([along.around_rad for along in arcs]).astype(np.float32),
            "along_rad": np.concatenate([along.along_rad for along in arcs]).astype(np.float32),
            "distance_m": np.concatenate(distance_m).astype(np.float32),
        }

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        """Compute the 3D lines of the reference frames, and their distance functions at all candidate positions.

        The distance functions are not part of a saved map.
        """
        self._frames = list(frames)
        self._points = sphere_points(self.config.sphere_points)
        self._map = [
            self._map_lines(description, frame) for description, frame in zip(descriptions, frames, strict=True)
        ]
        self._codes = np.concatenate(
            [distance_codes_from(reference.lines, reference.positions_m, self._points) for reference in self._map]
        )
        self._starts = np.cumsum([0, *(len(reference.positions_m) for reference in self._map)])

    def match(self, description: Description) -> Localization:
        """Compare the distances to lines in the query with those at all candidate positions, and align the best frames.

        The score of a frame is the fraction of its distances that agree with the query. If the frame is aligned
        successfully, its score is 1 + the agreement of the aligned lines.
        """
        if not len(description["axis"]):
            return Localization((), None, LocalizationStatus.NO_FEATURES)
        rotated = [_arcs(description)]
        for _ in range(3):
            rotated.append(rotate_by_quarter_turn(rotated[-1]))
        query = [distance_codes(arcs, self._points) for arcs in rotated]
        shares = np.stack([agreeing_share(self._codes, codes, self.config.inlier_rad) for codes in query], axis=1)
        best = np.maximum.reduceat(shares, self._starts[:-1])
        scores, pose, max_explained = best.max(axis=1), None, 0.0
        for candidate in np.argsort(-best, axis=None, kind="stable")[: self.config.shortlist]:
            frame, quarter = divmod(int(candidate), 4)
            reference = self._map[frame]
            if not reference.has_range:
                continue
            start = shares[self._starts[frame] : self._starts[frame + 1], quarter].argmax()
            position_m = search(rotated[quarter], reference.lines, reference.positions_m[start])
            position_m, turn_rad = refine(rotated[quarter], reference.lines, position_m)
            explained = float(agreement(rotated[quarter], reference.lines, position_m[None], AGREE_RAD)[0])
            if explained < self.config.min_agreement:
                continue
            scores[frame] = max(scores[frame], 1 + explained)
            if explained > max_explained:
                x_m, y_m, z_m = position_m
                yaw_rad = turn_rad + quarter * np.pi / 2 - float(description["yaw_rad"])
                pose, max_explained = reference.T_world_principal @ pose_2d(x_m, y_m, yaw_rad, z_m), explained
        return Localization(
            rank_places(self._frames, scores, pose),
            pose,
            LocalizationStatus.NO_POSE if pose is None else LocalizationStatus.OK,
        )

    def _map_lines(self, description: Description, frame: ReferenceFrame) -> _MapLines:
        """Return the lines of a frame, and a grid of candidate positions over the area that the lines cover.

        Without range, the distance of all lines is set to 1 m, which is correct only at the position of the frame.
        """
        distance_m = description["distance_m"]
        has_range = bool(np.isfinite(distance_m).any())
        if not has_range:
            distance_m = np.ones_like(distance_m)
        along = zip(_arcs(description), _along_axes(description, distance_m), strict=True)
        x, y, z = (lift_arcs(arcs, distances_m) for arcs, distances_m in along)
        lines = x, y, z
        T_world_principal = frame.T_world_pano @ pose_2d(0, 0, float(description["yaw_rad"]))
        positions_m = self._grid(lines) if has_range else np.zeros((1, 3))
        return _MapLines(T_world_principal, lines, has_range, positions_m)

    def _grid(self, lines: Sequence[Lines3d]) -> np.ndarray:
        """Return a grid of positions (T, 3) around a reference frame, at its height and including its own position."""
        ticks = []
        for axis in (0, 1):
            across_m = [lines[k].across_m[:, (axis - k) % 3 - 1] for k in range(3) if k != axis]
            low_m, high_m = np.quantile(
                np.concatenate([lines[axis].along_m.ravel(), *across_m]), [OUTLIER_SHARE, 1 - OUTLIER_SHARE]
            )
            low_m, high_m = max(min(low_m, 0), -self.config.reach_m), min(max(high_m, 0), self.config.reach_m)
            ticks.append(
                np.arange(np.ceil(low_m / self.config.step_m), np.floor(high_m / self.config.step_m) + 1)
                * self.config.step_m
            )
        return np.stack(np.meshgrid(*ticks, 0.0), axis=-1).reshape(-1, 3)


def _along_axes(description: Description, values: np.ndarray) -> list[np.ndarray]:
    """Split values of all lines by the direction of the line: x, y or z."""
    return np.split(values, np.searchsorted(description["axis"], (1, 2)))


def _arcs(description: Description) -> tuple[Arcs, Arcs, Arcs]:
    around_rad, along_rad = (_along_axes(description, description[name]) for name in ("around_rad", "along_rad"))
    x, y, z = map(Arcs, around_rad, along_rad)
    return x, y, z
