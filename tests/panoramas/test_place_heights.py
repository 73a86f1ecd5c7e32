"""Rooms above each other with one name, and rooms whose frames differ in height without being two."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.place_heights import storeys_note
from salframe.testing.rooms import ROOMS, FurnishedRoom, look, map_frames, stand

BEDROOM = ROOMS[0]


def frame(id, base_m=0.0, place="bedroom", room=BEDROOM, camera_m=1.5, seen=None, x_share=0.5):
    """A frame in a room whose floor lies at base_m, with the camera camera_m above it."""
    pose = stand(room, x_share)
    pose[2, 3] = camera_m
    in_world = pose.copy()
    in_world[2, 3] += base_m
    return ReferenceFrame(id, place, in_world, load=partial(seen or look, room, id, pose))


def test_two_storeys_with_one_name_are_named():
    frames = [frame("a"), frame("b", x_share=0.4), frame("c", 3.0), frame("d", 3.0, x_share=0.4)]
    assert storeys_note([*frames, *map_frames()[1:]]) == (
        "the place 'bedroom' has frames on two storeys (b at z = 1.50 m, c at 4.50 m, a floor between them), expected "
        "the frames of one room: use a different place name for each room"
    )


def test_more_places_are_counted():
    frames = [frame(f"{place}-{i}", 3.0 * i, place) for place in ("bed", "hall", "bath") for i in range(3)]
    note = storeys_note(frames)
    assert "the place 'bed' has frames on two storeys (bed-0 at z = 1.50 m, bed-1 at 4.50 m" in note
    assert note.endswith("; the same holds for 2 other places, the next: 'hall'")


def test_storeys_with_their_own_names_are_in_order():
    assert storeys_note([frame("a"), frame("b", 3.0, "upper bedroom")]) is None


@pytest.mark.parametrize("step_m", [0.3, 0.9, 1.7])
def test_split_levels_are_one_room(step_m):
    assert storeys_note([frame("a"), frame("b", step_m)]) is None


def test_cameras_of_very_different_heights_are_one_room():
    hall = FurnishedRoom("hall", (8.0, 6.0, 4.0), ())
    assert storeys_note([frame("robot", room=hall, camera_m=0.4), frame("mast", room=hall, camera_m=3.2)]) is None


def test_a_gallery_in_a_high_hall_is_one_room():
    """The lower frame sees the ceiling above the gallery."""
    hall = FurnishedRoom("hall", (8.0, 6.0, 6.0), ())
    assert storeys_note([frame("floor", room=hall), frame("gallery", 3.0)]) is None


def test_a_long_corridor_and_stairs_with_frames_on_them_are_one_room():
    corridor = FurnishedRoom("corridor", (60.0, 2.0, 2.6), ())
    assert storeys_note([frame(str(x), room=corridor, x_share=x) for x in np.linspace(0.05, 0.95, 10)]) is None
    assert storeys_note([frame(str(step), 0.75 * step) for step in range(5)]) is None


def test_frames_that_show_no_floor_are_passed_over():
    def without_range(room, id, pose):
        return replace(look(room, id, pose), range_m=None)

    def broken(room, id, pose):
        raise RuntimeError

    for seen in (without_range, broken):
        assert storeys_note([frame("a", seen=seen), frame("b", 3.0, seen=seen)]) is None


def test_frames_of_one_height_are_not_loaded():
    def loaded(room, id, pose):
        raise AssertionError

    assert storeys_note([frame(str(x), seen=loaded, x_share=x) for x in (0.4, 0.5, 0.6)]) is None
