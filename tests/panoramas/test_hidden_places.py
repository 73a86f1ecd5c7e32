"""Maps without the place of their queries."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Fold, FrameKind, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.hidden_places import add_hidden_places


def frame(id, place, x_m, kind=FrameKind.SCENE):
    return ReferenceFrame(id, place, pose_2d(x_m, 1.0, 0), kind)


# Three rooms in a row, 4 m x 2 m each, with a door between neighbours.
MAPPING = (
    frame("a", "room-a", 2.0),
    frame("b1", "room-b", 5.0),
    frame("b2", "room-b", 7.0),
    frame("c", "room-c", 10.0),
    frame("a-b", "door-1", 4.0, FrameKind.TRANSITION),
    frame("b-c", "door-2", 8.0, FrameKind.TRANSITION),
)
REGION = np.repeat(np.arange(1, 4, dtype=np.int32), 8)[None].repeat(4, 0)
FLOOR = FloorMasks(REGION > 0, REGION, REGION < 0, 0.5, (0.0, 2.0), {1: "room-a", 2: "room-b", 3: "room-c"})
QUERIES = {"q1": "room-a", "q2": "room-b", "q3": "room-a"}


def folds(references=MAPPING, floors=(FLOOR,)):
    queries = tuple(QueryFrame(id, lambda: None) for id in QUERIES)
    return add_hidden_places([Fold("all", references, queries)], lambda id: Truth(QUERIES[id]), floors)


def test_each_query_is_asked_again_of_a_map_without_its_place_and_the_doors_to_it():
    whole, without_a, without_b = folds()
    assert (whole.id, whole.references) == ("all", MAPPING)
    assert [query.id for query in whole.queries] == ["q1", "q2", "q3"]
    assert [query.id for query in without_a.queries] == ["q1", "q3"]
    assert [frame.id for frame in without_a.references] == ["b1", "b2", "c", "b-c"]
    assert [query.id for query in without_b.queries] == ["q2"]
    assert [frame.id for frame in without_b.references] == ["a", "c"]
    assert len({fold.id for fold in folds()}) == 3


def test_a_door_on_another_storey_leads_nowhere_near():
    upstairs = FloorMasks(FLOOR.free, np.full_like(REGION, 4), FLOOR.obstacle, 0.5, (0.0, 2.0), {4: "attic"}, z_m=3.0)
    above = ReferenceFrame("up", "door-3", pose_2d(4.0, 1.0, 0, 4.5), FrameKind.TRANSITION)
    _, without_a, _ = folds((*MAPPING, above), (upstairs, FLOOR))
    assert [frame.id for frame in without_a.references] == ["b1", "b2", "c", "b-c", "up"]


def test_without_floors_doors_stay():
    _, without_a, without_b = folds(floors=())
    assert [frame.id for frame in without_a.references] == ["b1", "b2", "c", "a-b", "b-c"]
    assert "room-b" not in {frame.place for frame in without_b.references}


def test_a_map_of_one_place_is_not_asked_without_it():
    assert [fold.id for fold in folds(MAPPING[1:3])] == ["all", "all without room-a"]
