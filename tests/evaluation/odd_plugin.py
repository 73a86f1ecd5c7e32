"""Three rooms whose names, queries and objects would break a careless page, and a localizer that sees two objects in
each and weighs two parts of evidence."""

from __future__ import annotations

from functools import partial

import numpy as np

import salframe
from salframe.framework.component import ComponentConfig
from salframe.framework.validation import Settings
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches
from salframe.localization.evidence import Evidence
from salframe.localization.localizer import Localizer
from salframe.localization.ranking import rank_places
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama

PLACES = ("<!--<script>", "</script><img src=x onerror=alert(1)>", """it's "quoted" & 100 %""")
OBJECTS = ("<i>lamp</i>", "table")
STEP_M = 0.5
"""So far ahead of the reference frame each query stands."""


class Odd(Dataset):
    """A reference frame and a query in each room, 10 m apart. The room `unmapped` has no reference frame."""

    name = "odd"
    version = "1"
    fingerprint = "odd"
    provides = frozenset({"rgb"})

    class Config(ComponentConfig):
        unmapped: int = 9

    def _load(self, id, room, ahead):
        return Panorama(id, np.full((320, 640, 3), (40 * room, 100 * ahead, 90), np.uint8))

    def folds(self):
        mapping = tuple(
            ReferenceFrame(f"map <{k}>", place, pose_2d(10.0 * k, 0, 0), load=partial(self._load, f"m{k}", k, 0))
            for k, place in enumerate(PLACES)
            if k != self.config.unmapped
        )
        queries = tuple(QueryFrame(self.id(k), partial(self._load, f"q{k}", k, 1)) for k in range(len(PLACES)))
        return [Fold("all", mapping, queries)]

    @staticmethod
    def id(room):
        return f"<b>query</b> {room}"

    def truth(self, query_id):
        room = int(query_id[-1])
        return Truth(PLACES[room], pose_2d(10.0 * room + STEP_M, 0, 0))

    def floors(self):
        region = np.repeat(np.arange(1, 4, dtype=np.int32)[None].repeat(20, 1), 10, 0)
        regions = {k + 1: place for k, place in enumerate(PLACES)}
        return [FloorMasks(region > 0, region, np.zeros(region.shape, bool), 0.5, (-5.0, 2.5), regions)]


class Weights(Settings):
    near: float = 2.0
    far: float = -1.0


class Weigher(Localizer):
    """Confuses the room `mistaken` with the previous one. Its poses are exact. In the room `no_pose` it has none. It
    rejects the query in the room `rejected`."""

    name = "weigher"
    version = "1"
    needs = frozenset({"rgb"})

    class Config(ComponentConfig):
        mistaken: int = 1
        no_pose: int = 9
        rejected: int = 9
        weights: Weights = Weights()

    def describe(self, panorama):
        room, ahead = panorama.rgb[0, 0, :2].astype(int) // (40, 100)
        centroid_m = np.array([[2.0, 1.0, 0.5], [0.0, -1.5, -0.5]]) - (STEP_M * ahead, 0, 0)
        graph = SaliencyGraph(
            OBJECTS,
            np.ones(2),
            np.array([0.75, 0.25]),
            centroid_m,
            np.full((2, 3), 0.4),
            np.zeros(2),
            np.array([[0, 1]]),
        )
        return {**graph_to_arrays(graph), "room": np.array(room)}

    def index(self, descriptions, frames):
        self.frames = frames

    def match(self, description):
        scores = self._scores(description)
        places = rank_places(self.frames, scores)
        if int(description["room"]) == self.config.rejected:
            return Localization(places, None, LocalizationStatus.OUT_OF_MAP)
        if int(description["room"]) == self.config.no_pose:
            return Localization(places, None, LocalizationStatus.NO_POSE)
        pose = self.frames[int(scores.argmax())].T_world_pano @ pose_2d(STEP_M, 0, 0)
        return Localization(places, pose, LocalizationStatus.OK)

    def evidence(self, description):
        return Evidence([frame.place for frame in self.frames], self._values(description))

    def correspond(self, query, reference):
        query_graph, reference_graph = graph_from_arrays(query), graph_from_arrays(reference)
        return NodeMatches(query_graph.centroid_m, reference_graph.centroid_m, np.array([[0, 0], [1, 1]]))

    def _values(self, description):
        room = int(description["room"])
        room = room - 1 if room == self.config.mistaken else room
        apart = np.abs(np.arange(len(self.frames)) - room)
        return {"near": 4.0 - apart, "far": 0.5 * apart}

    def _scores(self, description):
        return self.evidence(description).scores(self.config.weights.model_dump())


@salframe.hookimpl
def salframe_provides():
    return [Odd, Weigher]
