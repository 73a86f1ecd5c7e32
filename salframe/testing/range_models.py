"""The rules of the role `range-model`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from salframe.framework.identity import identity
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import RangeModel
from salframe.testing.asking import ask, expect, same
from salframe.testing.detectors import turns
from salframe.testing.identities import check_identities
from salframe.testing.rooms import PARTS, ROOMS, blind, halved, look, stand, turned

TURN_SHARE = 0.95
"""So much of a range image stays as it is, within the tolerance, when the panorama turns."""


def check_range_model(make: Callable[[], RangeModel]) -> None:
    """Well-formed range images, also where there is nothing to see, which the panorama's seam does not change."""
    model = make()
    possible = PARTS - {"range"}
    expect(model.needs and model.needs <= possible, "needs", set(model.needs), f"some of {', '.join(sorted(possible))}")
    for room in ROOMS:
        panorama = look(room, room.name, stand(room), model.needs)
        range_m = ask(f"estimate of the {room.name}", model.estimate, panorama)
        _check_range(f"estimate of the {room.name}", panorama, range_m)
        for columns in turns(1):
            _check_turn(model, panorama, range_m, columns)
    expect(
        same(range_m, make().estimate(panorama)),
        f"estimate of the {room.name} by another instance",
        "another answer",
        "the same",
    )
    check_identities(
        make, lambda one: identity(one.config, describing=True), lambda one: one.estimate(panorama), "identity"
    )
    empty = look(room.emptied(), "empty", stand(room), model.needs)
    nothing = blind(model.needs)
    for what, odd in (("an empty room", empty), ("half a panorama", halved(panorama)), ("nothing at all", nothing)):
        _check_range(f"estimate of {what}", odd, ask(f"estimate of {what}", model.estimate, odd))


def _check_range(checked: str, panorama: Panorama, range_m: np.ndarray) -> None:
    expect(isinstance(range_m, np.ndarray), checked, type(range_m).__name__, "an array")
    image = panorama.rgb if panorama.rgb is not None else panorama.annotations.instance_id  # type: ignore[union-attr]
    shape = image.shape[:2]  # type: ignore[union-attr]
    expect(
        range_m.dtype == np.float32 and range_m.shape == shape,
        checked,
        f"{range_m.dtype} {range_m.shape}",
        f"float32 {shape}, as the panorama",
    )
    known = range_m[~np.isnan(range_m)]
    wrong = known[~((known > 0) & (known < np.inf))]
    expect(not len(wrong), checked, f"a range of {wrong[:1]} m", "metres over 0, NaN where it is not known")


def _check_turn(model: RangeModel, panorama: Panorama, before: np.ndarray, columns: int) -> None:
    """The same ranges, rolled as the panorama is."""
    checked = f"estimate of the {panorama.id} rolled by {columns} columns"
    after = np.roll(ask(checked, model.estimate, turned(panorama, columns)), -columns, 1)
    near = np.abs(after - before) <= model.turn_tolerance * before
    share = float((near | (np.isnan(after) & np.isnan(before))).mean())
    expect(
        share >= TURN_SHARE,
        checked,
        f"{1 - share:.0%} of the ranges changed",
        f"at most {1 - TURN_SHARE:.0%} by more than turn_tolerance = {model.turn_tolerance:g} of themselves: "
        "salframe.panoramas.range_model.from_bright_side sees to it",
    )
