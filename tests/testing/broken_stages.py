"""Stages and engines that each break one rule, and the message of the conformance suite about each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from salframe_engines import Inline, Processes
from salframe_graphs.geometric import GeometricMatcher
from salframe_graphs.positioning import LeastSquaresPositioner, RobustPositioner
from salframe_graphs.saliency import VolumetricSaliency

from salframe.framework.errors import WorkerDied
from salframe.localization.positioner import PoseEstimate


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


class Facing(LeastSquaresPositioner):
    """Broken."""

    def solve(self, query_m, reference_m, weights=None):
        return super().solve(query_m, reference_m, np.exp(query_m[:, 0]))


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


BROKEN_STAGES = [
    (Volume, r"score of the objects of a room: received a sum of .* expected shares that sum to 1"),
    (Single, "received dtype float32, expected float64"),
    (Unprepared, "score of no object: received ValueError"),
    (Beyond, "received pairs .* expected indices below"),
    (Polygamous, "expected one-to-one pairs"),
    (Generous, "top_k = 1: received 2 matches, expected at most top_k = 1"),
    (WorstFirst, "received scores .* expected finite scores, best first"),
    (Misled, r"match of the bedroom among 5 graphs: received \[1.*scene 0 first, because its graph is the query"),
    (Contradicting, "rank of .* with scores .* expected the scenes and scores of `match`"),
    (Displaced, "rank of .* received other poses, expected the poses of `match`"),
    (Hopeful, "match of a graph without objects: received 1 matches, expected an empty list"),
    (Inverse, "solve of 8 points without noise: received a pose that is off by"),
    (Facing, "solve of 8 turned points with noise: received a pose that is .* off the turn"),
    (Optimistic, "solve of no point: received a pose"),
    (Poseless, "received the status 'ok' without a pose"),
    (Centring, "received .*read-only"),
    (Backward, "resect of 8 directions.*: received"),
    (Rangeless, r"match of a graph without range: received scores .*nan"),
    (Shuffled, "match after write_index and open_index: received other matches, expected the matches of `index`"),
    (Fragile, "map: received ValueError: the item 3 is odd"),
    (Backwards, r"received \[4, 1\], expected \[1, 4\], in order"),
    (Vague, "map over an item that ends its process: received None, expected WorkerDied as the answer of this item"),
]
