"""The rules of the role `detector`."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from salframe.framework.components.identity import identity
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.turning import turned_detections
from salframe.panoramas.geometry import wrap_angle
from salframe.panoramas.panorama import Panorama
from salframe.testing.asking import DoesNotApply, ask, attempt, expect, same
from salframe.testing.identities import check_identities
from salframe.testing.rooms import HEIGHT_PX, PARTS, ROOMS, blind, halved, look, stand, turned
from salframe.testing.rules import Rules

YAW_SLACK_M = 0.01
"""What the ends of a box may move beyond the tolerance when the panorama turns: the yaw of a box hangs on single points
of its outline."""
BETWEEN_SHARE, BETWEEN_DEG = 0.95, 2.0
"""Of the objects of panoramas turned by columns between a detector's steps so many come out again, at most so far
beside the turn."""


class DetectorRules(Rules[Detector]):
    """Well-formed detections, none where there is nothing, and none that the panorama's seam changes."""

    @cached_property
    def _detector(self) -> Detector:
        return self.make()

    @cached_property
    def _parts(self) -> frozenset[str]:
        """An instance image says what is where; how far it is, the range image beside it."""
        needs = self._detector.needs
        return needs | ({"range"} if "annotations" in needs else set())

    @cached_property
    def _rooms(self) -> list[tuple[Panorama, Detections]]:
        """The suite's rooms, and what is detected in them."""
        rooms = [look(room, room.name, stand(room), self._parts) for room in ROOMS]
        return [(room, ask(f"detect in the {room.id}", self._detector.detect, room)) for room in rooms]

    def detections_are_well_formed(self) -> None:
        check_needs(self._detector.needs)
        for room, found in self._rooms:
            _check_detections(f"detect in the {room.id}", found)

    def they_turn_with_the_panorama(self) -> None:
        for room, found in self._rooms:
            for columns in turns(self._detector.column_step):
                _check_turn(self._detector, room, found, columns)

    def they_turn_between_steps(self) -> None:
        step = self._detector.column_step
        turned_by = [columns for columns in (step // 2, HEIGHT_PX + 1) if columns % step]
        if not turned_by:
            raise DoesNotApply("every column is a step of it")
        again = total = 0
        for room, found in self._rooms:
            for columns in turned_by:
                expected, after = _turn(self._detector, room, found, columns)
                again, total = again + _alike(expected, after), total + max(len(expected), len(after))
        expect(
            again >= BETWEEN_SHARE * total,
            f"detect in rooms turned by columns between its steps of {step}",
            f"{again} of {total} objects within {BETWEEN_DEG:g} deg",
            f"{BETWEEN_SHARE:.0%}: salframe.graphs.turning.from_near_side sees to it, or a smaller column_step",
        )

    def another_instance_answers_the_same(self) -> None:
        room, found = self._rooms[-1]
        checked = f"detect in the {room.id} by another instance"
        expect(same(found, attempt(checked, self.make().detect, room)), checked, "another answer", "the same")

    def settings_change_what_they_may(self) -> None:
        room, _ = self._rooms[-1]
        check_identities(
            self.make, lambda one: identity(one.config, describing=True), lambda one: one.detect(room), "identity"
        )

    def little_to_see_is_no_error(self) -> None:
        empty = look(ROOMS[-1].emptied(), "empty", stand(ROOMS[-1]), self._parts)
        for what, given in (("an empty room", empty), ("half a panorama", halved(self._rooms[-1][0]))):
            self._check(f"detect in {what}", given)

    def nothing_is_found_where_nothing_is_seen(self) -> None:
        checked = "detect where nothing is seen"
        found = self._check(checked, blind(self._parts))
        expect(len(found) == 0, checked, f"{len(found)} objects", "none: Detections.empty()")

    def its_needs_are_enough(self) -> None:
        needs = self._detector.needs
        if self._parts == needs:
            raise DoesNotApply("the other rules give it no more than it needs")
        seen = look(ROOMS[-1], ROOMS[-1].name, stand(ROOMS[-1]), needs)
        self._check(f"detect with {' and '.join(sorted(needs))} alone", seen)

    def _check(self, checked: str, panorama: Panorama) -> Detections:
        found: Detections = ask(checked, self._detector.detect, panorama)
        _check_detections(checked, found)
        return found


def check_needs(needs: frozenset[str], possible: frozenset[str] = PARTS) -> None:
    """Something is needed, and nothing that a panorama cannot have."""
    expect(needs and needs <= possible, "needs", set(needs), f"some of {', '.join(sorted(possible))}")


def turns(column_step: int) -> list[int]:
    """Columns to turn a panorama by, multiples of column_step: one, half of them, nearly all."""
    return sorted({column_step * max(1, columns // column_step) for columns in (1, HEIGHT_PX, 2 * HEIGHT_PX - 3)})


def _check_detections(checked: str, found: Detections) -> None:
    expect(isinstance(found, Detections), checked, type(found).__name__, "Detections")
    expect(
        all(isinstance(label, str) and label for label in found.labels), checked, f"the labels {found.labels}", "words"
    )
    known = np.isfinite(found.centroid_m).all(1)
    expect(
        (known | np.isnan(found.centroid_m).any(1)).all(),
        checked,
        "an infinite centroid",
        "metres, NaN where the range is not known",
    )
    expect((found.size_m[known] >= 0).all(), checked, f"sizes {found.size_m[known].tolist()}", "metres, at least 0")
    length = np.linalg.norm(found.bearing, axis=1)
    unit = np.isnan(length) | (np.abs(length - 1) < 1e-6)
    expect(
        unit.all(),
        checked,
        f"bearings of length {length[~unit].round(6).tolist()}",
        "unit vectors, NaN where not known",
    )
    for label, points in zip(found.labels, found.points_m or (), strict=False):
        fits = isinstance(points, np.ndarray) and points.ndim == 2 and points.shape[1] == 3 and points.dtype.kind == "f"
        expect(
            fits and len(points),
            checked,
            f"points_m of shape {np.shape(points)} for a {label}",
            "(n, 3) floats, n at least 1",
        )


def _turned_by(panorama: Panorama, columns: int) -> str:
    return f"detect in the {panorama.id} rolled by {columns} columns"


def _turn(detector: Detector, panorama: Panorama, found: Detections, columns: int) -> tuple[Detections, Detections]:
    """What was found, turned as the panorama is, and what is found in the panorama turned."""
    after = ask(_turned_by(panorama, columns), detector.detect, turned(panorama, columns))
    return turned_detections(found, -np.pi * columns / HEIGHT_PX), after


def _check_turn(detector: Detector, panorama: Panorama, found: Detections, columns: int) -> None:
    """The same objects, turned by the angle that the panorama was, and nothing else."""
    from scipy.optimize import linear_sum_assignment

    checked, tolerance_m = _turned_by(panorama, columns), detector.turn_tolerance_m
    expected, after = _turn(detector, panorama, found, columns)
    expect(
        sorted(after.labels) == sorted(found.labels),
        checked,
        sorted(after.labels),
        f"{sorted(found.labels)} as before, or column_step a multiple of its {detector.column_step}",
    )
    distance_m = np.nan_to_num(np.linalg.norm(expected.centroid_m[:, None] - after.centroid_m[None], axis=2))
    other_label = np.array(found.labels)[:, None] != np.array(after.labels)[None]
    rows, partners = linear_sum_assignment(distance_m + 1e3 * other_label)
    for i, j in zip(rows, partners, strict=True):
        seen = f"a {found.labels[i]} that"
        expect(
            np.array_equal(np.isnan(found.centroid_m[i]), np.isnan(after.centroid_m[j]))
            and distance_m[i, j] <= tolerance_m,
            checked,
            f"{seen} moved {distance_m[i, j]:.2g} m",
            f"at most turn_tolerance_m = {tolerance_m:g} m beside the turn",
        )
        change_m = np.nan_to_num(np.abs(found.size_m[i] - after.size_m[j])).max()
        expect(
            change_m <= tolerance_m,
            checked,
            f"{seen} changed its size by {change_m:.2g} m",
            f"at most turn_tolerance_m = {tolerance_m:g} m",
        )
        length, width = found.size_m[i, :2]
        period_rad = np.pi / 2 if length - width <= tolerance_m else np.pi
        turn_rad = (after.yaw_rad[j] - expected.yaw_rad[i]) * 2 * np.pi / period_rad
        off_rad = float(np.abs(wrap_angle(turn_rad))) * period_rad / (2 * np.pi)
        expect(
            not off_rad * length / 2 > tolerance_m + YAW_SLACK_M,
            checked,
            f"{seen} turned {np.degrees(off_rad):.2g} deg within the room",
            f"a box that turns with the panorama, its ends within turn_tolerance_m = {tolerance_m:g} m",
        )


def _alike(one: Detections, other: Detections) -> int:
    """How many objects of both, one to one, have the same label and an azimuth within BETWEEN_DEG, or none."""
    from scipy.optimize import linear_sum_assignment

    azimuth, partner = (np.arctan2(found.centroid_m[:, 1], found.centroid_m[:, 0]) for found in (one, other))
    near = np.abs(wrap_angle(azimuth[:, None] - partner)) <= np.radians(BETWEEN_DEG)
    near |= np.isnan(azimuth)[:, None] & np.isnan(partner)
    near &= np.array(one.labels, str)[:, None] == np.array(other.labels, str)
    return int(near[linear_sum_assignment(near, maximize=True)].sum())
