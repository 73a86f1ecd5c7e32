"""The matcher `geometric`: similarity of nodes, and verification that one pose explains them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from salframe.graphs.graph import SaliencyGraph, without_range
from salframe.graphs.matcher import GraphMatch, RankedGraphs
from salframe_graphs.alignment import align
from salframe_graphs.bearings import verify_bearings
from salframe_graphs.node_matcher import Candidates, GraphIndex, NodeMatcher, NodeMatcherConfig
from salframe_graphs.node_pairs import NodePairs, shared_weight
from salframe_graphs.verification import ScaleBound, VerifiedPoses, verify


@dataclass(frozen=True, eq=False)
class _VerifiedRanking:
    """The ranked candidates of a query.

    Attributes:
        candidates: The K graphs that the query is compared with.
        best: (T,) indices of the candidates with the highest scores, best first.
        score: (K,) score of each candidate.
        pairs: The P node pairs with a similarity of at least `min_similarity`.
        similarity: (P,) similarity of each pair.
        verified: The pose of each candidate.
    """

    candidates: Candidates
    best: np.ndarray
    score: np.ndarray
    pairs: NodePairs
    similarity: np.ndarray
    verified: VerifiedPoses


class GeometricMatcher(NodeMatcher):
    """Compares nodes by height, size and the labels nearby, and searches for one pose that explains their positions.

    The score of a match is a weighted sum of two Jaccard indices. The first one counts similar nodes. The second one
    counts similar nodes that coincide under one pose (geometric verification).
    """

    name = "geometric"
    version = "1"

    class Config(NodeMatcherConfig):
        similarity_score: float = Field(
            1.0, ge=0, description="weight of the first Jaccard index (similar nodes) in the score of a match"
        )
        geometry_score: float = Field(
            2.0,
            ge=0,
            description="weight of the second Jaccard index (similar nodes that coincide under one pose) in the score "
            "of a match; 0: there is no geometric verification",
        )
        tolerance_m: float = Field(
            0.3,
            gt=0,
            description="geometric verification: maximum distance (m) between two nodes that coincide, if their range "
            "is 0. `tolerance_share` adds to it",
        )
        tolerance_share: float = Field(
            0.05,
            ge=0,
            description="geometric verification: increase of the maximum distance with the range. Two nodes with the "
            "ranges a and b coincide if their distance is at most `tolerance_m` + `tolerance_share` * sqrt(a^2 + b^2)",
        )
        max_scale_error: float = Field(
            0.0,
            ge=0,
            lt=1,
            description="geometric verification: maximum relative error of the scale of the ranges of a query (0.1: "
            "10 %). over 0: the scale is estimated together with the pose; 0: the scale is taken as correct, as for a "
            "depth sensor",
        )
        max_shift_m: float = Field(
            6.0,
            gt=0,
            description="geometric verification: maximum distance (m) between the query and the reference frame that "
            "it is compared with",
        )

    @property
    def _estimates_scale(self) -> bool:
        """Whether the ranges of a query may be wrong by one unknown factor."""
        return bool(self.config.max_scale_error)

    def match(self, query: SaliencyGraph, index: GraphIndex, top_k: int) -> list[GraphMatch]:
        ranking = self._rank(query, index, top_k)
        if ranking is None:
            return []
        candidates, best = ranking.candidates, ranking.best
        pairs, position = ranking.pairs.take(best)
        kernel = ranking.verified.kernel[position]
        first_node = candidates.nodes.segments.start[best]
        aligned = align(pairs, first_node, ranking.similarity[position], kernel)
        poses = ranking.verified.poses(best)
        return [
            GraphMatch(
                scene, score, nodes, pose if np.isfinite(pose).all() else None, self._scale(candidates, row, nodes)
            )
            for scene, score, row, nodes, pose in zip(
                candidates.graphs[best].tolist(),
                ranking.score[best].tolist(),
                best.tolist(),
                aligned,
                poses,
                strict=True,
            )
        ]

    def rank(self, query: SaliencyGraph, index: GraphIndex, top_k: int) -> RankedGraphs:
        ranking = self._rank(query, index, top_k)
        if ranking is None:
            return RankedGraphs(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 4, 4)))
        best = ranking.best
        return RankedGraphs(ranking.candidates.graphs[best], ranking.score[best], ranking.verified.poses(best))

    def _shortlist(self, graph: SaliencyGraph, index: GraphIndex) -> np.ndarray:
        # Heights and sizes have the same scale error as ranges, so the scene index must not use them.
        labels_only = without_range(graph) if self._estimates_scale and not graph.bearings_only else graph
        return super()._shortlist(labels_only, index)

    def _rank(self, query: SaliencyGraph, index: GraphIndex, top_k: int) -> _VerifiedRanking | None:
        candidates = self._candidates(query, index)
        if candidates is None:
            return None
        value = self._similarity(candidates, index)
        score = np.zeros(len(candidates.graphs))
        if self.config.similarity_score:
            shared = shared_weight(candidates.pairs, value, candidates.weight, candidates.nodes, candidates.node_weight)
            score += self.config.similarity_score * shared
        pairs, value = candidates.pairs.select((value > 0) & (value >= self.config.min_similarity), value)
        verified = VerifiedPoses.none(pairs)
        if self.config.geometry_score:
            verified = self._verify(candidates, pairs, value)
            shared = shared_weight(pairs, verified.kernel, candidates.weight, candidates.nodes, candidates.node_weight)
            score += self.config.geometry_score * shared
        best = np.lexsort((-candidates.jaccard, -score))[:top_k]
        return _VerifiedRanking(candidates, best, score, pairs, value, verified)

    def _similarity(self, candidates: Candidates, index: GraphIndex) -> np.ndarray:
        """Return the similarity (P,) of each node pair, 0 to 1; 1 for a query without range, which has labels only."""
        if candidates.graph.bearings_only:
            return np.ones(len(candidates.pairs))
        value = self._attribute_similarity(candidates, self.config.max_scale_error)
        if self._has_rings:
            weight = self.config.structure_weight
            value *= (1 + weight * self._ring_products(candidates, index)) / (1 + weight)
        return value

    def _verify(self, candidates: Candidates, pairs: NodePairs, similarity: np.ndarray) -> VerifiedPoses:
        query, nodes, config = candidates.query, candidates.nodes, self.config
        if candidates.graph.bearings_only:
            tolerance = config.tolerance_m, config.tolerance_share
            bearing = candidates.graph.bearing
            return verify_bearings(
                bearing, nodes.centroid_m, pairs, similarity, candidates.weight, tolerance, config.max_shift_m
            )
        ranges_m = np.hypot(query.range_m[pairs.query], nodes.range_m[pairs.node])
        return verify(
            query.centroid_m[:, :2],
            nodes.centroid_m[:, :2],
            pairs,
            similarity,
            config.tolerance_m + config.tolerance_share * ranges_m,
            candidates.weight,
            config.max_shift_m,
            self._scale_bound(candidates),
        )

    def _scale_bound(self, candidates: Candidates) -> ScaleBound | None:
        """Return the bounds of the scale of the query's ranges; None if it is known or the query has no range."""
        if not self._estimates_scale or candidates.graph.bearings_only:
            return None
        heights = candidates.query.centroid_m[:, 2], candidates.nodes.centroid_m[:, 2]
        return ScaleBound(self.config.max_scale_error, *heights, self.config.height_scale_m)

    def _scale(self, candidates: Candidates, row: int, nodes: np.ndarray) -> float:
        """Return the scale, within its bounds, at which the query's aligned nodes have the same spread as the nodes of
        candidate `row`."""
        bound = self._scale_bound(candidates)
        if bound is None or len(nodes) < 2:
            return 1.0
        query_m = candidates.query.centroid_m[nodes[:, 0], :2]
        map_m = candidates.nodes.centroid_m[candidates.nodes.segments.start[row] + nodes[:, 1], :2]
        spread, map_spread = (float(np.linalg.norm(np.std(points, axis=0))) for points in (query_m, map_m))
        return float(bound.clip(map_spread / max(spread, 1e-9)))
