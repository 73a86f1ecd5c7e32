"""A data set of rendered rooms and localizers whose matches are off by as much as they are told, for the tests of
matching accuracy."""

from __future__ import annotations

import numpy as np
from salframe_annotations.detector import AnnotationDetector

import salframe
from salframe.evaluation.tasks.matching.judging import PIXEL_RAD
from salframe.framework.component import ComponentConfig
from salframe.framework.errors import WeightsError
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches, PointMatches
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, FrameKind, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d, sample_nearest, transform_points
from salframe.testing.rooms import ROOMS, look, stand

STEP = pose_2d(0.3, 0.2, 0.5)
"""Where a query stands in the axes of the reference frame next to it."""


def turned_by(bearings, angle_rad):
    """Unit vectors at this great-circle angle from unit vectors (M, 3)."""
    across = np.cross(bearings, (0.3, -0.5, 0.8))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.cos(angle_rad) * bearings + np.sin(angle_rad) * across


class Furnished(Dataset):
    """Rooms with a reference frame in the middle and in a corner, a transition, and a query a step from the middle."""

    name = "furnished"
    version = "1"
    fingerprint = "furnished"

    class Config(ComponentConfig):
        ranges: bool = True
        instances: bool = True
        posed: bool = True
        unmapped: bool = False

    @property
    def provides(self):
        return frozenset(
            {"rgb", *(["range"] if self.config.ranges else []), *(["annotations"] if self.config.instances else [])}
        )

    def _look(self, id, room, T_world_pano):
        return lambda: look(room, id, T_world_pano, self.provides)

    def _map_frame(self, id, room, T_world_pano, place, kind=FrameKind.SCENE):
        return ReferenceFrame(id, place, T_world_pano, kind, self._look(id, room, T_world_pano))

    def folds(self):
        mapping, queries = [], []
        for room in ROOMS[:2]:
            place = "nowhere" if self.config.unmapped and room is ROOMS[1] else room.name
            mapping.append(self._map_frame(f"{room.name}-corner", room, stand(room, 0.3, 0.8), place))
            door = FrameKind.TRANSITION
            mapping.append(self._map_frame(f"{room.name}-door", room, stand(room) @ STEP, place, door))
            mapping.append(self._map_frame(f"{room.name}-middle", room, stand(room), place))
            id = f"{room.name}-query"
            queries.append(QueryFrame(id, self._look(id, room, stand(room) @ STEP)))
        return [Fold("all", tuple(mapping), tuple(queries))]

    def truth(self, query_id):
        room = next(room for room in ROOMS if query_id.startswith(room.name))
        return Truth(room.name, stand(room) @ STEP if self.config.posed else None)


class Points(Localizer):
    """Matches points as the truth would, each off by so many pixels."""

    name = "points"
    version = "1"
    needs = frozenset({"range"})

    class Config(ComponentConfig):
        off_px: float = 0.0
        count: int = 40
        fail_after: int = 99

    def __init__(self, config=None):
        super().__init__(config)
        self.left = getattr(self.config, "fail_after", None)

    def describe(self, panorama):
        return {"range_m": panorama.range_m}

    def index(self, descriptions, frames):
        pass

    def match(self, description):
        return Localization((), None, LocalizationStatus.NO_MATCH)

    def correspond(self, query, reference):
        if not self.left:
            raise ValueError("no more")
        self.left -= 1
        bearings = np.random.default_rng(5).normal(size=(self.config.count, 3))
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
        points_m = transform_points(STEP, bearings * sample_nearest(query["range_m"], bearings)[:, None])
        seen = points_m / np.linalg.norm(points_m, axis=1, keepdims=True)
        return PointMatches(bearings, turned_by(seen, self.config.off_px * PIXEL_RAD))


class Nodes(Points):
    """Matches the first objects of a room by their labels, the last two of them crosswise where it is told so."""

    name = "nodes"
    needs = frozenset({"annotations", "range"})

    class Config(ComponentConfig):
        first: int = 5
        crossed: bool = False

    def describe(self, panorama):
        objects = AnnotationDetector(AnnotationDetector.Config(noise="none")).detect(panorama)
        return {"labels": np.array(objects.labels), "centroid_m": objects.centroid_m}

    def correspond(self, query, reference):
        both = [label for label in query["labels"] if label in reference["labels"]][: self.config.first]
        other = both[:-2] + both[:-3:-1] if self.config.crossed else both
        position = [
            [side.tolist().index(label) for label in labels]
            for side, labels in ((query["labels"], both), (reference["labels"], other))
        ]
        return NodeMatches(query["centroid_m"], reference["centroid_m"], np.array(position, int).reshape(2, -1).T)


class Neither(Points):
    """Matches neither points nor nodes."""

    name = "neither"

    def correspond(self, query, reference):
        return None


class Confused(Points):
    """Matches, and does not say what."""

    name = "confused"

    def correspond(self, query, reference):
        return [(0, 1)]


class Leaving(Points):
    """Exits where it should match."""

    name = "leaving"

    def correspond(self, query, reference):
        raise SystemExit("it leaves")


class Weightless(Points):
    """Its weights are never there."""

    name = "weightless"

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        raise WeightsError("weightless.pth is not at hand: salframe weights fetch weightless")


@salframe.hookimpl
def salframe_provides():
    return [Furnished, Points, Nodes, Neither, Confused, Leaving, Weightless]
