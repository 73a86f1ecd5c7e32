"""Which frames are hidden when the frames of a map are localized in it."""

from __future__ import annotations

import numpy as np
from spied_map import POSTERIOR, Spy, spied_map

from salframe.localization.map import LocalizationMap
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d


def test_a_frame_is_never_in_the_map_that_it_is_localized_in():
    spied = spied_map([4, 2, 1, 3])
    matches, indexed = spied.localizer.matches, {frame.id for frame in spied.frames}
    present, absent = [], []
    for value, shown in matches:
        place, number = divmod(int(value), 10)
        assert f"{place}-{number}" not in shown
        kind = present if any(id.startswith(f"{place}-") for id in shown) else absent
        kind.append(f"{place}-{number}")
        assert "door" in shown
    scenes = sorted(indexed - {"door"})
    assert sorted(absent) == scenes  # every scene frame once, in the map without its place
    assert sorted(present) == [id for id in scenes if id != "2-0"]  # a place of one frame has no other
    assert len(spied.localizer.frames) == len(indexed)  # the whole map is indexed afterwards


def test_doorways_to_a_hidden_place_are_hidden_too():
    region = np.repeat([[1, 2]], 10, 1).repeat(10, 0).astype(np.int32)
    floor = FloorMasks(np.ones((10, 20), bool), region, np.zeros((10, 20), bool), 1.0, (-5.0, 5.0), {1: "a", 2: "b"})
    frames = [
        ReferenceFrame("a", "a", pose_2d(0, 0, 0, 1.5)),
        ReferenceFrame("b", "b", pose_2d(10, 0, 0, 1.5)),
        ReferenceFrame("door", "door", pose_2d(5, 0, 0, 1.5), FrameKind.TRANSITION),
        ReferenceFrame("far", "far", pose_2d(12, 0, 0, 1.5), FrameKind.TRANSITION),
    ]
    descriptions = [{"value": np.array([float(i)])} for i in range(4)]
    localizer = Spy(Spy.Config(posterior=POSTERIOR.model_dump()))
    type(localizer).uses_floors = True
    try:
        LocalizationMap.from_descriptions(localizer, descriptions, frames, [floor], calibrate=True)
    finally:
        type(localizer).uses_floors = False
    assert sorted(map(tuple, (shown for _, shown in localizer.matches))) == [("a",), ("b", "far")]
