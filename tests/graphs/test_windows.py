"""The objects around the frames of a place, of all places, against objects placed by hand."""

import numpy as np
import pytest
from salframe_graphs.places.merging import Place
from salframe_graphs.places.place_index import index_places
from salframe_graphs.places.rates import Likelihood, shipped_rates
from salframe_graphs.places.scene_frames import SceneFrames
from salframe_graphs.places.windows import Windows

CAMERAS_M = np.array([[0.0, 0, 1.5], [6.0, 0, 1.9], [0, 0, 9.0]])
"""Of the places hall, study and attic, one frame each."""


def place(number, name, objects):
    """A place of one frame from objects (label, position, variance, sightings)."""
    labels, centroid_m, variance_m2, sightings = zip(*objects, strict=True)
    n = len(labels)
    return Place(
        name,
        (number,),
        labels,
        np.array(centroid_m, float),
        np.array(variance_m2),
        np.zeros((n, 3)),
        np.zeros(n),
        np.array(sightings, float),
    )


@pytest.fixture
def windows():
    places = [
        place(0, "hall", [("door", (3.0, 0, 1.0), 0.01, 1), ("bench", (-2.0, 0, 0.5), 0.01, 1)]),
        place(1, "study", [("door", (3.2, 0, 1.0), 0.03, 4), ("desk", (6.0, 2.0, 0.8), 0.02, 1)]),
        place(2, "attic", [("chest", (0, 0, 8.0), 0.01, 1)]),
    ]
    index = index_places(places, CAMERAS_M[:, None], shipped_rates(), Likelihood())
    return index, Windows(index, SceneFrames.of(places), CAMERAS_M, 5.0)


def objects_of(index, place):
    """{label: row of the index} of a place. The labels differ."""
    names = list(index.vocabulary)
    rows = range(*index.segments.start[place : place + 2])
    assert len({index.label[row] for row in rows}) == len(rows)
    return {names[index.label[row]]: row for row in rows}


def test_a_window_has_the_objects_near_the_frames_of_all_places_and_merges_those_of_several(windows):
    index, of_places = windows
    taken = of_places.take(np.arange(3))
    hall, study, attic = (objects_of(taken, number) for number in range(3))
    assert set(hall) == {"door", "bench"}  # the desk is 6.3 m away, the chest one floor up
    assert set(study) == {"door", "desk"}
    assert set(attic) == {"chest"}
    for rows, camera_m in ((hall, CAMERAS_M[0]), (study, CAMERAS_M[1])):
        door = rows["door"]
        np.testing.assert_allclose(taken.xy_m[door], [np.average([3.0, 3.2], weights=[1 / 0.01, 1 / 0.03]), 0])
        np.testing.assert_allclose(taken.variance_m2[door], 1 / (1 / 0.01 + 1 / 0.03))
        np.testing.assert_allclose(taken.z_m[door], 1.0 - camera_m[2])
        # 4 sightings are easier to detect than 1.
        assert taken.detection_logit[door] == max(index.detection_logit)
    assert taken.vocabulary == index.vocabulary
    np.testing.assert_array_equal(taken.cameras_m, index.cameras_m)


def test_windows_of_a_part_of_the_places(windows):
    _, of_places = windows
    both, one = of_places.take(np.arange(3)), of_places.take(np.array([1]))
    np.testing.assert_array_equal(one.xy_m, both.xy_m[slice(*both.segments.start[1:3])])
    assert len(one) == 1
