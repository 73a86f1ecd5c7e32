"""Merging of the detections in views, on hand-made overlaps."""

import numpy as np

from salframe.graphs.image_detections import group, outline

# A sphere of ten pixels; view 0 shows the first six of them, view 1 the last six, view 2 all.
SEEN = np.zeros((3, 10), bool)
SEEN[0, :6] = SEEN[1, 4:] = SEEN[2] = True
AREA = np.ones(10)


def marks(*spans):
    footprint = np.zeros((len(spans), 10), bool)
    for row, (first, last) in zip(footprint, spans, strict=True):
        row[first : last + 1] = True
    return footprint


def groups(footprint, view, cut=None):
    cut = np.zeros(len(view), bool) if cut is None else np.array(cut)
    return [members.tolist() for members in group(footprint, np.array(view), cut, SEEN, AREA)]


def test_parts_that_agree_where_both_views_look_are_one():
    footprint = marks((2, 5), (4, 8))  # cut by the border of view 0, and by that of view 1
    assert groups(footprint, [0, 1]) == [[0, 1]]
    assert outline(footprint, np.array([0, 1]), SEEN).tolist() == marks((2, 8))[0].tolist()


def test_parts_that_do_not_agree_stay_apart():
    assert groups(marks((2, 3), (6, 8)), [0, 1]) == [[0], [1]]  # neither is where the other view looks
    assert groups(marks((4, 4), (5, 8)), [0, 1]) == [[0], [1]]


def test_a_view_shows_an_object_once():
    footprint = marks((0, 2), (2, 5), (0, 5))  # two in view 0, and one in view 2 over both
    assert groups(footprint, [0, 0, 2]) == [[0], [1, 2]]  # the second agrees more


def test_a_sliver_belongs_to_the_object_that_it_lies_in():
    footprint = marks((5, 5), (0, 9))  # they agree on one pixel of the six that both views show
    assert groups(footprint, [0, 2]) == [[0], [1]]
    assert groups(footprint, [0, 2], cut=[True, False]) == [[0, 1]]
    assert groups(footprint, [0, 2], cut=[False, True]) == [[0], [1]]
    footprint = marks((5, 5), (0, 4), (0, 9))
    assert groups(footprint, [0, 0, 2], cut=[True, False, False]) == [[0], [1, 2]]  # view 0 shows the large one already


def test_an_outline_is_where_most_views_put_it():
    footprint = marks((1, 5), (1, 4), (0, 4))
    assert outline(footprint, np.array([0, 2, 2]), SEEN).tolist() == marks((1, 4))[0].tolist()
