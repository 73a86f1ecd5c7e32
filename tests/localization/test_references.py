"""Reference frames that are completed by each other, and those that cannot be in a map."""

from __future__ import annotations

import numpy as np
from fake_plugin import Reader

from salframe.localization.references import complete_references
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d


class Halving(Reader):
    """Describes a frame by a number of objects. Completing a description halves it; 1 object does not fit."""

    name = "halving"

    def complete(self, descriptions, frames):
        return [{"count": one["count"] // 2} if one["count"] > 1 else one for one in descriptions]

    def unfit_for_map(self, description):
        return "one object is too few" if description["count"] <= 1 else None

    def count_objects(self, description):
        return int(description["count"])


def frames(count: int) -> list[ReferenceFrame]:
    return [ReferenceFrame(f"frame-{i}", "room", pose_2d(i, 0, 0)) for i in range(count)]


def test_completed_frames_are_counted_and_unfit_ones_are_left_out():
    counts = [8, 1, 2, 6]
    done = complete_references(Halving(), [{"count": np.array(count)} for count in counts], frames(4))
    assert [int(one["count"]) for one in done.descriptions] == [4, 3]
    assert [frame.id for frame in done.frames] == ["frame-0", "frame-3"]
    assert {id: str(error) for id, error in done.unusable_frames.items()} == {
        name: f"panorama {name} cannot be a reference frame: one object is too few" for name in ("frame-1", "frame-2")
    }
    (note,) = done.notes
    assert note.startswith("8 of 16 objects in 3 reference frames without range are left out")
