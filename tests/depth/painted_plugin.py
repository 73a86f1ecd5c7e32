"""The suite's rooms painted with their range, with annotations and without a range image."""

from __future__ import annotations

from dataclasses import replace

from painted_rooms import paint

import salframe
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold
from salframe.testing.rooms import map_frames, query_frames, query_truths


def without_range(frame):
    """The frame, its panorama painted and its range image taken away."""
    return replace(frame, load=lambda: replace(paint(frame.load()), range_m=None))


class PaintedRooms(Dataset):
    """Three rooms, a reference frame and a query in each."""

    name, version = "painted-rooms", "1"
    provides = frozenset({"rgb", "annotations"})
    fingerprint = "painted"

    def folds(self):
        mapping, queries = (tuple(map(without_range, frames)) for frames in (map_frames(), query_frames()))
        return [Fold("all", mapping, queries)]

    def truth(self, query_id):
        return query_truths()[query_id]


@salframe.hookimpl
def salframe_provides():
    return [PaintedRooms]
