"""Conformance rules for components of the role `detector`."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from salframe.framework.components.identity import identity
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.turning import rotate_detections
from salframe.panoramas.geometry import wrap_angle
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.turning import turned
from salframe.testing.expectations import DoesNotApply, attempt, call_twice, expect, same
from salframe.testing.identities import check_identities
from salframe.testing.rooms import HEIGHT_PX, PARTS, ROOMS, blank_panorama, halved, look, stand
from salframe.testing.rules import Rules

YAW_SLACK_M = 0.01
"""Distance that the ends of a box may move beyond the tolerance when the panorama turns. The yaw of a box depends on
single points of its outline."""
BETWEEN_SHARE, BETWEEN_DEG = 0.95, 2.0
"""Minimum share of objects that are detected again, and maximum angle between an object and its expected position,
when a panorama is rolled by a number of columns that is not a multiple of the detector's column_step."""


class DetectorRules(Rules[Detector]):
    """Detections are well formed, independent of the panorama's seam, and empty for a blank panorama."""

    @cached_property
    def _detector(self) -> Detector:
        return self.make()

    @cached_property
    def _parts(self) -> frozenset[str]:
        """Parts of the panoramas. An instance image holds no distances, so annotations come with a range image."""
        needs = self._detector.needs
        return needs | ({"range"} if "annotations" in needs else set())

    @cached_property
    def _rooms(self) -> list[tuple[Panorama, Detections]]:
        """Panoramas of the suite's rooms, each with its detections."""
        rooms = [look(room, room.name, stand(room), self._parts) for room in ROOMS]
        return [(room, call_twice(f"detect in the {room.id}", self._detector.detect, room)) for room in rooms]

    def detections_are_well_formed(self) -> None:
        check_needs(self._detector.needs)
        for room, detections in self._rooms:
            _check_detections(f"detect in the {room.id}", detections)

    def detections_rotate_with_the_panorama(self) -> None:
        for room, detections in self._rooms:
            for columns in turns(self._detector.column_step):
                _check_turn(self._detector, room, detections, columns)

    def detections_rotate_between_column_steps(self) -> None:
        step = self._detector.column_step
        turned_by = [columns for columns in (step // 2, HEIGHT_PX + 1) if columns % step]
        if not turned_by:
            raise DoesNotApply(
                "the column_step of the detector is 1, so no number of columns lies between two multiples of it"
            )
        redetected = total = 0
        for room, detections in self._rooms:
            for columns in turned_by:
                expected, after = _turn(self._detector, room, detections, columns)
                redetected += _count_matches(expected, after)
                total += max(len(expected), len(after))
        expect(
            redetected >= BETWEEN_SHARE * total,
            f"detect in panoramas rolled by columns that are not multiples of column_step = {step}",
            f"{redetected} of {total} objects within {BETWEEN_DEG:g} deg",
            f"at least {BETWEEN_SHARE:.0%}: decorate detect with salframe.graphs.turning.from_near_side, "
            "or set a smaller column_step",
        )

    def another_instance_gives_the_same_answer(self) -> None:
        room, detections = self._rooms[-1]
        checked = f"detect in the {room.id} by another instance"
        expect(
            same(detections, attempt(checked, self.make().detect, room)),
            checked,
            "different detections",
            "the same detections",
        )

    def identity_covers_the_settings(self) -> None:
        room, _ = self._rooms[-1]
        check_identities(
            self.make, lambda made: identity(made.config, describing=True), lambda made: made.detect(room), "identity"
        )

    def sparse_input_raises_no_error(self) -> None:
        empty = look(ROOMS[-1].emptied(), "empty", stand(ROOMS[-1]), self._parts)
        for what, panorama in (("an empty room", empty), ("half a panorama", halved(self._rooms[-1][0]))):
            self._check(f"detect in {what}", panorama)

    def a_blank_panorama_has_no_detections(self) -> None:
        checked = "detect in a blank panorama"
        detections = self._check(checked, blank_panorama(self._parts))
        expect(len(detections) == 0, checked, f"{len(detections)} objects", "Detections.empty()")

    def its_needs_suffice(self) -> None:
        needs = self._detector.needs
        if self._parts == needs:
            raise DoesNotApply("the panoramas of the other checks already have only the images that the detector needs")
        panorama = look(ROOMS[-1], ROOMS[-1].name, stand(ROOMS[-1]), needs)
        self._check(f"detect with {' and '.join(sorted(needs))} alone", panorama)

    def _check(self, checked: str, panorama: Panorama) -> Detections:
        detections: Detections = call_twice(checked, self._detector.detect, panorama)
        _check_detections(checked, detections)
        return detections


def check_needs(needs: frozenset[str], possible: frozenset[str] = PARTS) -> None:
    """Check that `needs` is not empty and names only parts that a panorama can have."""
    expect(needs and needs <= possible, "needs", set(needs), f"one or more of {', '.join(sorted(possible))}")


def turns(column_step: int) -> list[int]:
    """Return numbers of columns to roll a panorama by, multiples of column_step: one, half of the width, nearly all."""
    return sorted({column_step * max(1, columns // column_step) for columns in (1, HEIGHT_PX, 2 * HEIGHT_PX - 3)})


def _check_detections(checked: str, detections: Detections) -> None:
    expect(isinstance(detections, Detections), checked, type(detections).__name__, "Detections")
    expect(
        all(isinstance(label, str) and label for label in detections.labels),
        checked,
        f"the labels {detections.labels}",
        "strings that are not empty",
    )
    has_position = np.isfinite(detections.centroid_m).all(1)
    expect(
        (has_position | np.isnan(detections.centroid_m).any(1)).all(),
        checked,
        "an infinite centroid",
        "metres, or NaN where the range is unknown",
    )
    size_m = detections.size_m[has_position]
    expect((size_m >= 0).all(), checked, f"sizes {size_m.tolist()}", "metres, at least 0")
    length = np.linalg.norm(detections.bearing, axis=1)
    unit = np.isnan(length) | (np.abs(length - 1) < 1e-6)
    expect(
        unit.all(),
        checked,
        f"bearings of length {length[~unit].round(6).tolist()}",
        "unit vectors, or NaN where the bearing is unknown",
    )
    for label, points in zip(detections.labels, detections.points_m or (), strict=False):
        fits = isinstance(points, np.ndarray) and points.ndim == 2 and points.shape[1] == 3 and points.dtype.kind == "f"
        expect(
            fits and len(points),
            checked,
            f"points_m of shape {np.shape(points)} for the object {label!r}",
            "floats of shape (n, 3), n at least 1",
        )


def _name_turn(panorama: Panorama, columns: int) -> str:
    return f"detect in the {panorama.id} rolled by {columns} columns"


def _turn(
    detector: Detector, panorama: Panorama, detections: Detections, columns: int
) -> tuple[Detections, Detections]:
    """Return the detections rotated with the panorama, and the detections in the rotated panorama."""
    after = call_twice(_name_turn(panorama, columns), detector.detect, turned(panorama, columns))
    return rotate_detections(detections, -np.pi * columns / HEIGHT_PX), after


def _check_turn(detector: Detector, panorama: Panorama, detections: Detections, columns: int) -> None:
    """Check that the rotated panorama gives the same objects, rotated by the same angle."""
    from scipy.optimize import linear_sum_assignment

    checked, tolerance_m = _name_turn(panorama, columns), detector.turn_tolerance_m
    expected, after = _turn(detector, panorama, detections, columns)
    expect(
        sorted(after.labels) == sorted(detections.labels),
        checked,
        sorted(after.labels),
        f"{sorted(detections.labels)} as before, or a column_step that is a larger multiple of {detector.column_step}",
    )
    distance_m = np.nan_to_num(np.linalg.norm(expected.centroid_m[:, None] - after.centroid_m[None], axis=2))
    other_label = np.array(detections.labels)[:, None] != np.array(after.labels)[None]
    rows, partners = linear_sum_assignment(distance_m + 1e3 * other_label)
    for i, j in zip(rows, partners, strict=True):
        subject = f"an object {detections.labels[i]!r} that"
        expect(
            np.array_equal(np.isnan(detections.centroid_m[i]), np.isnan(after.centroid_m[j]))
            and distance_m[i, j] <= tolerance_m,
            checked,
            f"{subject} moved {distance_m[i, j]:.2g} m",
            f"at most turn_tolerance_m = {tolerance_m:g} m in addition to the rotation",
        )
        change_m = np.nan_to_num(np.abs(detections.size_m[i] - after.size_m[j])).max()
        expect(
            change_m <= tolerance_m,
            checked,
            f"{subject} changed its size by {change_m:.2g} m",
            f"at most turn_tolerance_m = {tolerance_m:g} m",
        )
        length, width = detections.size_m[i, :2]
        period_rad = np.pi / 2 if length - width <= tolerance_m else np.pi
        turn_rad = (after.yaw_rad[j] - expected.yaw_rad[i]) * 2 * np.pi / period_rad
        off_rad = float(np.abs(wrap_angle(turn_rad))) * period_rad / (2 * np.pi)
        expect(
            not off_rad * length / 2 > tolerance_m + YAW_SLACK_M,
            checked,
            f"{subject} turned {np.degrees(off_rad):.2g} deg relative to the room",
            f"a box that rotates with the panorama, its ends within turn_tolerance_m = {tolerance_m:g} m",
        )


def _count_matches(first: Detections, second: Detections) -> int:
    """Return the number of one-to-one pairs with the same label whose azimuths differ by at most BETWEEN_DEG.

    Two objects without azimuth also pair.
    """
    from scipy.optimize import linear_sum_assignment

    azimuth, partner = (np.arctan2(side.centroid_m[:, 1], side.centroid_m[:, 0]) for side in (first, second))
    near = np.abs(wrap_angle(azimuth[:, None] - partner)) <= np.radians(BETWEEN_DEG)
    near |= np.isnan(azimuth)[:, None] & np.isnan(partner)
    near &= np.array(first.labels, str)[:, None] == np.array(second.labels, str)
    return int(near[linear_sum_assignment(near, maximize=True)].sum())
