"""Conformance rules for components of the role `range-model`."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from salframe.framework.components.identity import identity
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import RangeModel
from salframe.panoramas.turning import turned
from salframe.testing.detectors import check_needs, turns
from salframe.testing.expectations import attempt, call_twice, expect, same
from salframe.testing.identities import check_identities
from salframe.testing.rooms import PARTS, ROOMS, blank_panorama, halved, look, stand
from salframe.testing.rules import Rules

TURN_SHARE = 0.95
"""Minimum share of the ranges that stay the same, within the tolerance, when the panorama rotates."""


class RangeModelRules(Rules[RangeModel]):
    """Range images are well formed, also for blank panoramas, and independent of the panorama's seam."""

    @cached_property
    def _model(self) -> RangeModel:
        return self.make()

    @cached_property
    def _rooms(self) -> list[tuple[Panorama, np.ndarray]]:
        """Panoramas of the suite's rooms, each with its estimated range image."""
        rooms = [look(room, room.name, stand(room), self._model.needs) for room in ROOMS]
        return [(room, call_twice(f"estimate of the {room.id}", self._model.estimate, room)) for room in rooms]

    def ranges_are_well_formed(self) -> None:
        check_needs(self._model.needs, PARTS - {"range"})
        for room, range_m in self._rooms:
            _check_range(f"estimate of the {room.id}", room, range_m)

    def ranges_rotate_with_the_panorama(self) -> None:
        for room, range_m in self._rooms:
            for columns in turns(1):
                _check_turn(self._model, room, range_m, columns)

    def another_instance_gives_the_same_answer(self) -> None:
        room, range_m = self._rooms[-1]
        checked = f"estimate of the {room.id} by another instance"
        expect(same(range_m, attempt(checked, self.make().estimate, room)), checked, "other ranges", "the same ranges")

    def identity_covers_the_settings(self) -> None:
        room, _ = self._rooms[-1]
        check_identities(
            self.make, lambda made: identity(made.config, describing=True), lambda made: made.estimate(room), "identity"
        )

    def sparse_input_raises_no_error(self) -> None:
        needs, room = self._model.needs, ROOMS[-1]
        inputs = {
            "an empty room": look(room.emptied(), "empty", stand(room), needs),
            "half a panorama": halved(self._rooms[-1][0]),
            "a blank panorama": blank_panorama(needs),
        }
        for what, panorama in inputs.items():
            _check_range(
                f"estimate of {what}", panorama, call_twice(f"estimate of {what}", self._model.estimate, panorama)
            )


def _check_range(checked: str, panorama: Panorama, range_m: np.ndarray) -> None:
    expect(isinstance(range_m, np.ndarray), checked, type(range_m).__name__, "an array")
    image = panorama.rgb if panorama.rgb is not None else panorama.annotations.instance_id  # type: ignore[union-attr]
    shape = image.shape[:2]  # type: ignore[union-attr]
    expect(
        range_m.dtype == np.float32 and range_m.shape == shape,
        checked,
        f"{range_m.dtype} {range_m.shape}",
        f"float32 {shape}, the size of the panorama",
    )
    finite_m = range_m[~np.isnan(range_m)]
    invalid_m = finite_m[~((finite_m > 0) & (finite_m < np.inf))]
    expect(
        not len(invalid_m),
        checked,
        f"a range of {invalid_m[0] if len(invalid_m) else None} m",
        "positive metres, or NaN where unknown",
    )


def _check_turn(model: RangeModel, panorama: Panorama, before: np.ndarray, columns: int) -> None:
    """Check that the rolled panorama gives the same ranges, rolled by the same number of columns."""
    checked = f"estimate of the {panorama.id} rolled by {columns} columns"
    after = np.roll(call_twice(checked, model.estimate, turned(panorama, columns)), -columns, 1)
    near = np.abs(after - before) <= model.turn_tolerance * before
    share = float((near | (np.isnan(after) & np.isnan(before))).mean())
    expect(
        share >= TURN_SHARE,
        checked,
        f"{1 - share:.0%} of the ranges changed",
        f"at most {1 - TURN_SHARE:.0%} by more than the relative turn_tolerance = {model.turn_tolerance:g}: "
        "decorate estimate with salframe.panoramas.range_model.from_bright_side",
    )
