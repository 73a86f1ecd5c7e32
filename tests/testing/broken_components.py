"""Components that are each broken in one way, and the one line that the conformance suite says about each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ConfigDict, field_validator
from salframe_annotations.detector import AnnotationDetector
from salframe_engines import Inline, Processes
from salframe_graphs.geometric import GeometricMatcher
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.positioning import RobustPositioner
from salframe_graphs.saliency import VolumetricSaliency
from salframe_objects.localizer import ObjectSetLocalizer

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.identity import UserFile, identity
from salframe.framework.errors import DataError, WorkerDied
from salframe.framework.validation import Settings
from salframe.graphs.detections import Detections
from salframe.localization.positioner import PoseEstimate
from salframe.panoramas.geometry import pose_2d
from salframe.testing.rooms import HEIGHT_PX


def columns(found: Detections) -> np.ndarray:
    """(N,) columns of the suite's panoramas that the centroids lie in."""
    return (np.pi - np.arctan2(found.centroid_m[:, 1], found.centroid_m[:, 0])) * HEIGHT_PX / np.pi


class Described(AnnotationDetector):
    """A detector that is broken in one way."""

    name = "broken"


class Shouting(Described):
    """Broken."""

    name = "My Detector"


class Silent(Described):
    pass


class Lenient(Described):
    """Broken."""

    class Config(ComponentConfig):
        model_config = ConfigDict(extra="ignore")


class Undecided(Described):
    """Broken."""

    class Config(ComponentConfig):
        threshold: float


class Clearing(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        panorama.annotations.labels.clear()
        return found


class Overwriting(Described):
    """Broken."""

    def detect(self, panorama):
        panorama.range_m[np.isnan(panorama.range_m)] = 0
        return super().detect(panorama)


class Restless(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        return replace(found, scores=np.random.default_rng().random(len(found)))


class Moody(Described):
    """Broken."""

    def __init__(self, config=None):
        super().__init__(config)
        self.score = np.random.default_rng().random()

    def detect(self, panorama):
        found = super().detect(panorama)
        return replace(found, scores=np.full(len(found), self.score))


class Flat(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        return replace(found, centroid_m=found.centroid_m[:, :2])


class Listing(Described):
    """Broken."""

    def detect(self, panorama):
        return list(super().detect(panorama).labels)


class Certain(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        return replace(found, scores=np.full(len(found), 100.0))


class Seamed(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        return found.take(
            [i for i in range(len(found)) if (found.points_m[i][:, 1] > 0).all() or found.points_m[i][:, 0].max() > 0]
        )


class Offset(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        return replace(found, centroid_m=found.centroid_m + np.array([0.05, 0, 0]))


class AxisAligned(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        sizes = [np.maximum(np.ptp(points, axis=0), 0.05) for points in found.points_m]
        return replace(found, size_m=np.reshape(sizes, (-1, 3)), yaw_rad=np.zeros(len(found)))


class Strided(Described):
    """Broken."""

    column_step = 4

    def detect(self, panorama):
        found = super().detect(panorama)
        return found.take(np.flatnonzero(np.round(columns(found)) % 4))


class Unturned(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        return replace(found, yaw_rad=np.zeros(len(found)))


class Distracted(Described):
    """Broken."""

    class Config(AnnotationDetector.Config):
        steady: Literal["yes", "no"] = match_only("yes")

    def detect(self, panorama):
        found = super().detect(panorama)
        return found if self.config.steady == "yes" else found.take([])


class Haunted(Described):
    """Broken."""

    def detect(self, panorama):
        return (
            super().detect(panorama)
            if panorama.annotations.labels
            else Detections(("ghost",), [1.0], [[1.0, 0, 0]], [[1.0, 1, 1]], [0.0])
        )


class Volume(VolumetricSaliency):
    """Broken."""

    def score(self, detections):
        return detections.size_m.prod(1)


class Single(VolumetricSaliency):
    """Broken."""

    def score(self, detections):
        return super().score(detections).astype(np.float32)


class Unprepared(VolumetricSaliency):
    """Broken."""

    def score(self, detections):
        share = super().score(detections)
        return share / share.max() * share.max()


class Beyond(GeometricMatcher):
    """Broken."""

    def match(self, query, index, top_k):
        return [replace(match, pairs=match.pairs + 1) for match in super().match(query, index, top_k)]


class Polygamous(GeometricMatcher):
    """Broken."""

    def match(self, query, index, top_k):
        return [replace(match, pairs=match.pairs * (0, 1)) for match in super().match(query, index, top_k)]


class Generous(GeometricMatcher):
    """Broken."""

    def match(self, query, index, top_k):
        return super().match(query, index, 5)


class WorstFirst(GeometricMatcher):
    """Broken."""

    def match(self, query, index, top_k):
        return super().match(query, index, top_k)[::-1]


class Contradicting(GeometricMatcher):
    """Broken."""

    def rank(self, query, index, top_k):
        ranked = super().rank(query, index, top_k)
        return replace(ranked, score=ranked.score[::-1])


class Displaced(GeometricMatcher):
    """Broken."""

    def rank(self, query, index, top_k):
        ranked = super().rank(query, index, top_k)
        return replace(ranked, T_scene_query=ranked.T_scene_query + 1)


class Misled(GeometricMatcher):
    """Broken."""

    def match(self, query, index, top_k):
        return [
            replace(match, scene=(match.scene + 1) % len(index.graphs), pairs=match.pairs[:0])
            for match in super().match(query, index, top_k)
        ]


class Hopeful(GeometricMatcher):
    """Broken."""

    def match(self, query, index, top_k):
        return super().match(query, index, top_k) or super().match(index.graphs[0], index, top_k)[:1]


class Inverse(RobustPositioner):
    """Broken."""

    def solve(self, query_m, reference_m, weights=None):
        return super().solve(reference_m, query_m, weights)


class Optimistic(RobustPositioner):
    """Broken."""

    def solve(self, query_m, reference_m, weights=None):
        if len(query_m) > 2:
            return super().solve(query_m, reference_m, weights)
        return PoseEstimate(np.eye(4), "ok", None, np.zeros(len(query_m), bool))


class Poseless(RobustPositioner):
    """Broken."""

    def solve(self, query_m, reference_m, weights=None):
        return replace(super().solve(query_m, reference_m, weights), T_reference_query=None)


class Centring(RobustPositioner):
    """Broken."""

    def solve(self, query_m, reference_m, weights=None):
        query_m -= 0
        return super().solve(query_m, reference_m, weights)


class Backward(RobustPositioner):
    """Broken."""

    def resect(self, bearing, reference_m):
        return super().resect(-bearing, reference_m)


class Rangeless(GeometricMatcher):
    """Broken."""

    def match(self, query, index, top_k):
        return [
            replace(match, score=match.score + query.range_m.mean()) for match in super().match(query, index, top_k)
        ]


class Shuffled(GeometricMatcher):
    """Broken."""

    def open_index(self, graphs, folder):
        return self.index(list(graphs)[::-1])


class Stretched(Described):
    """Broken."""

    def detect(self, panorama):
        found = super().detect(panorama)
        return (
            found if len(found) and np.isfinite(found.centroid_m).all() else replace(found, bearing=2 * found.bearing)
        )


class Mixed(SaliencyGraphLocalizer):
    """Broken."""

    def open_index(self, folder, packed, frames):
        self.index([self.unpack(row) for row in packed[::-1]], frames)


class North(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        answer = super().match(description)
        return (
            answer
            if answer.T_world_query is None
            else replace(answer, T_world_query=pose_2d(*answer.T_world_query[:2, 3], 0.0))
        )


class Scolding(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        if not len(description["labels"]):
            raise ValueError("there is nothing here")
        return super().match(description)


class Modest(SaliencyGraphLocalizer):
    """Broken."""

    needs = frozenset({"rgb"})


class Boastful(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        return replace(super().match(description), status="ok")


class Unordered(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        answer = super().match(description)
        return replace(answer, places=answer.places + answer.places)


def weighed(answer, probabilities):
    """The answer with these probabilities of its first places, 0 of the others, and 0.1 of none of them."""
    padded = [*probabilities, *[0.0] * len(answer.places)]
    places = [place._replace(probability=padded[i]) for i, place in enumerate(answer.places)]
    return replace(answer, places=tuple(places), not_here=0.1) if len(places) > 1 else answer


class Lavish(ObjectSetLocalizer):
    """Broken."""

    def match(self, description):
        return weighed(super().match(description), [0.7, 0.4])


class Contrary(ObjectSetLocalizer):
    """Broken."""

    def match(self, description):
        return weighed(super().match(description), [0.2, 0.7])


class Swayed(SaliencyGraphLocalizer):
    """Broken."""

    class Config(SaliencyGraphLocalizer.Config):
        lossy: bool = match_only(False)

    def graph(self, panorama):
        graph = super().graph(panorama)
        return replace(graph, saliency=graph.saliency / 2) if self.config.lossy else graph


class Scrupulous(SaliencyGraphLocalizer):
    """Broken."""

    def describe_identity(self):
        return identity(self.config)


class Inattentive(SaliencyGraphLocalizer):
    """Broken."""

    class Config(SaliencyGraphLocalizer.Config):
        table: UserFile | None = None

    def describe_identity(self):
        return {"name": self.name}


class Refusing(AnnotationDetector):
    """Broken."""

    name = "broken"

    class Config(AnnotationDetector.Config):
        table: UserFile | None = None

        @field_validator("table")
        @classmethod
        def _plain(cls, value):
            return None if value is None else Path(value)

    def __init__(self, config=None):
        super().__init__(config)
        if self.config.table is not None:
            raise DataError("the table is no table")


class Tables(Settings):
    files: tuple[UserFile, ...] = ()

    @field_validator("files")
    @classmethod
    def _plain(cls, value):
        return tuple(map(str, value))


class Nested(Described):
    """Broken."""

    class Config(AnnotationDetector.Config):
        tables: Tables = Tables()


class Pathed(Described):
    """Broken."""

    class Config(AnnotationDetector.Config):
        table: tuple[Path, ...] | None = None


class Fragile(Inline):
    """Broken."""

    def map(self, function: Callable, items: Sequence) -> Iterator:
        return map(function, items)


class Backwards(Inline):
    """Broken."""

    def map(self, function: Callable, items: Sequence) -> Iterator:
        return reversed(list(super().map(function, items)))


class Vague(Processes):
    """Broken."""

    def map(self, function: Callable, items: Sequence) -> Iterator:
        for answer in super().map(function, items):
            yield None if isinstance(answer, WorkerDied) else answer


BROKEN = [
    (Shouting, "Shouting.name is 'My Detector', expected words of small letters"),
    (Silent, "docstring of Silent: received none"),
    (Lenient, "Config: received a key that it does not have, and took it"),
    (Undecided, "Undecided.Config has no default for threshold"),
    (Clearing, "detect in the bedroom: received a change of its input"),
    (Overwriting, "detect in the bedroom: received ValueError: .*read-only"),
    (Restless, "detect in the bedroom: received two answers to the same input"),
    (Moody, "by another instance: received another answer"),
    (Flat, r"received InvalidAnswer: Detections.centroid_m has shape \(\d, 2\), expected \(\d, 3\)"),
    (Listing, "received list, expected Detections"),
    (Certain, r"received InvalidAnswer: Detections.scores holds 100.0, expected numbers from 0 to 1"),
    (Seamed, r"detect in the \w+ rolled by \d+ columns: received \["),
    (Offset, r"rolled by 1 columns: received a \w+ that moved 0\.0\d+ m"),
    (Strided, r"turned by columns between its steps of 4: received \d+ of \d+ objects within 2 deg, expected 95%"),
    (AxisAligned, r"rolled by \d+ columns: received a \w+ that changed its size by"),
    (Unturned, r"received a \w+ that turned \d.* deg within the room"),
    (Distracted, "identity with another steady: received another description, expected the same: .* match_only"),
    (Haunted, "detect where nothing is seen: received 1 objects, expected none"),
    (Volume, r"score of the objects of a room: received a sum of .* expected shares that sum to 1"),
    (Single, "received dtype float32, expected float64"),
    (Unprepared, "score of no object: received ValueError"),
    (Beyond, "received pairs .* expected indices below"),
    (Polygamous, "expected one-to-one pairs"),
    (Generous, "top_k = 1: received 2 matches, expected at most top_k = 1"),
    (WorstFirst, "received scores .* expected finite ones, best first"),
    (Misled, r"match of the bedroom among 5 graphs: received \[1.*the same graph, 0, first"),
    (Contradicting, "rank of .* with scores .* expected those of `match`"),
    (Displaced, "rank of .* received other poses, expected those of `match`"),
    (Hopeful, "match of a graph without objects: received 1 matches, expected an empty list"),
    (Inverse, "solve of 8 points without noise: received a pose .* m and .* deg off"),
    (Optimistic, "solve of no point: received a pose"),
    (Poseless, "received the status 'ok' without a pose"),
    (Centring, "received .*read-only"),
    (Backward, "resect 8 directions.*: received"),
    (Rangeless, r"match of a graph without range: received scores .*nan"),
    (Shuffled, "match after write_index and open_index: received another answer, expected that of `index`"),
    (Stretched, r"detect with annotations alone: received bearings of length \[2.0"),
    (Mixed, "after save and open: received"),
    (North, "received a pose that moved .* rad off the turn"),
    (Scolding, "received ValueError: there is nothing here"),
    (Modest, "describe of a panorama with rgb alone: received InputMissing"),
    (Boastful, "match where nothing is seen: received InvalidAnswer: a localization has the status ok and no place"),
    (Unordered, "expected one entry a place"),
    (Lavish, "received InvalidAnswer: a localization has probabilities that sum to 1.2, expected 1"),
    (Contrary, r"received the probabilities \[0.2, 0.7.*\], expected the best place's first"),
    (Swayed, "describe_identity with another lossy: received another description, expected the same: .* match_only"),
    (Scrupulous, "describe_identity with another positioner: received another one, expected the same: .* match_only"),
    (Inattentive, "describe_identity with another content of the file table: received the same one, expected another"),
    (Refusing, "identity with another content of the file table: received the same one, expected another"),
    (Nested, "identity with another content of the file tables.files: received the same one, expected another"),
    (Pathed, "setting table: received a plain Path, expected a UserFile"),
    (Fragile, "map: received ValueError: 3 is odd"),
    (Backwards, r"received \[4, 1\], expected \[1, 4\], in order"),
    (Vague, "map over an item that ends its process: received None, expected WorkerDied as its answer"),
    (int, "<class 'int'> is no component: it must subclass one of Dataset"),
]
