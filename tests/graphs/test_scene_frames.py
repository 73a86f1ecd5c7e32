"""Which scene frames of a map belong to a name, and which of them is near."""

import numpy as np
from salframe_graphs.places.scene_frames import SceneFrames

HALLS = SceneFrames(["hall", "attic"], np.array([0, 1, 0]), np.array([4, 2, 0, 3]), np.array([0, 2, 3, 4]))
"""Two places called hall, of the frames 4 and 2 and of 3, and an attic of 0."""
STOOD_M = np.array([[9.0, 9.0], [0.0, 0.0], [3.0, 0.0], [6.0, 0.0], [0.0, 0.0]])


def test_the_last_frame_of_a_place_is_repeated():
    np.testing.assert_array_equal(HALLS.padded, [[4, 2], [0, 0], [3, 3]])
    np.testing.assert_array_equal(HALLS.place, [0, 0, 1, 2])


def test_the_nearest_frame_of_all_places_of_a_name():
    names, near_m = np.array([0, 1, 0, 0]), np.array([[5.0, 1.0], [0.0, 0.0], [3.2, 0.0], [-8.0, 0.0]])
    np.testing.assert_array_equal(HALLS.nearest(names, STOOD_M, near_m), [3, 0, 2, 4])


def test_without_a_position_the_first_frame_of_a_name():
    unknown = np.full((2, 2), np.nan)
    np.testing.assert_array_equal(HALLS.nearest(np.array([1, 0]), STOOD_M, unknown), [0, 4])
