"""The graph matcher: candidates, node alignment, weighted triplets, geometric verification (method.md 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.config import ComponentConfig
from salframe.roles import GraphMatcher
from salframe.types import GraphMatch, SaliencyGraph
from salframe_graphs.features import node2vec, ring_hop_histograms
from salframe_graphs.verification import Verified, verify


@dataclass(frozen=True)
class GraphIndex:
    """A map's S graphs, laid out for matching: counts (L, S) rows by label; the rest padded to the largest graph, m nodes.

    label (S, m) int64, -1 where padded; xy_m (S, m, 2), range_m, saliency (S, m); features (S, m, F); rarity (L,) inverse document frequency.
    """

    graphs: tuple[SaliencyGraph, ...]
    vocabulary: dict[str, int]
    counts: np.ndarray
    rarity: np.ndarray
    label: np.ndarray
    xy_m: np.ndarray
    range_m: np.ndarray
    saliency: np.ndarray
    features: np.ndarray


class TripletMatcher(GraphMatcher):
    """Label-set candidates, one-to-one node alignment, weighted triplets, and geometric verification of the survivors."""

    name = "triplet"
    version = "1"

    class Config(ComponentConfig):
        labels: Literal["set", "multiset"] = Field("multiset", description="Jaccard index over which labels are there, or how many of each")
        rarity: bool = Field(True, description="weigh labels by inverse document frequency over the map")
        keep: float = Field(0.5, ge=0, le=1, description="candidates: Jaccard index at least this share of the best (paper: 0.6)")
        structure: Literal["rings", "node2vec"] = Field("rings", description="structural feature of a node")
        ring_edges_m: tuple[float, ...] = Field((1.0, 2.0, 4.0), description="outer edges of the distance rings")
        hops: int = Field(2, ge=0, description="context hops whose labels are counted")
        saliency_weight: float = Field(0.3, ge=0, description="weight of the saliency ratio in node similarity (label: 1)")
        structure_weight: float = Field(1.0, ge=0, description="weight of the structural feature in node similarity (label: 1)")
        least_similarity: float = Field(0.5, ge=0, le=1, description="node pairs below this similarity are rejected")
        normalise: bool = Field(True, description="divide the triplet score by the query's edge mass (paper: raw sum)")
        verify: bool = Field(True, description="geometric verification (ours)")
        tolerance_m: float = Field(0.4, gt=0, description="verification: distance at which two nodes cannot be one, at no range")
        tolerance_share: float = Field(0.15, ge=0, description="verification: added tolerance, a share of the nodes' ranges")
        largest_shift_m: float = Field(4.0, gt=0, description="verification: a query this far from a map frame is not matched to it")
        label_score: float = Field(1.0, ge=0, description="weight of the Jaccard index in the score")
        triplet_score: float = Field(0.3, ge=0, description="weight of the triplets in the score")
        geometry_score: float = Field(1.0, ge=0, description="weight of the consistent node mass in the score")
        shift_scale_m: float = Field(3.0, gt=0, description="verification: consistent mass counts exp(-shift / scale)")
        seed: int = Field(0, ge=0, description="seed of node2vec")

    def index(self, graphs: Sequence[SaliencyGraph]) -> GraphIndex:
        vocabulary = {label: i for i, label in enumerate(sorted({label for graph in graphs for label in graph.labels}))}
        largest = max((len(graph) for graph in graphs), default=0)
        counts = np.zeros((len(vocabulary), len(graphs)))
        label = np.full((len(graphs), largest), -1)
        xy, distance, saliency = (np.zeros((len(graphs), largest, *tail)) for tail in ((2,), (), ()))
        blocks = []
        for s, graph in enumerate(graphs):
            n = len(graph)
            label[s, :n] = [vocabulary[name] for name in graph.labels]
            np.add.at(counts[:, s], label[s, :n], 1)
            xy[s, :n], distance[s, :n], saliency[s, :n] = graph.centroid_m[:, :2], graph.range_m, graph.saliency
            blocks.append(self._rings(graph, vocabulary))
        features = np.zeros((len(graphs), largest, blocks[0].shape[1] if blocks else 0))
        for s, block in enumerate(blocks):
            features[s, : len(block)] = block
        seen = (counts > 0).sum(1)
        rarity = np.log((1 + len(graphs)) / (1 + seen)) + 0.1 if self.config.rarity else np.ones(len(vocabulary))
        return GraphIndex(tuple(graphs), vocabulary, counts, rarity, label, xy, distance, saliency, features)

    def match(self, query: SaliencyGraph, index: GraphIndex, top_k: int) -> list[GraphMatch]:
        known = np.array([index.vocabulary.get(label, -1) for label in query.labels], int)
        jaccard = self._jaccard(known, query.labels, index)
        candidates = np.flatnonzero((jaccard > 0) & (jaccard >= self.config.keep * jaccard.max(initial=0)))
        if not len(candidates):
            return []
        similarity = self._similarity(query, known, index, candidates)
        pairs = [self._align(s) for s in similarity]
        found = None
        if self.config.verify:
            found, pairs = self._verify(query, known, index, candidates, similarity, pairs)
        triplets = np.array([self._triplets(query, index.graphs[s], p) for s, p in zip(candidates, pairs, strict=True)])
        score = triplets
        if found is not None:
            nearness = np.exp(-np.hypot(*np.nan_to_num(found.shift_m).T) / self.config.shift_scale_m)
            score = (
                self.config.label_score * jaccard[candidates]
                + self.config.triplet_score * triplets
                + self.config.geometry_score * found.consistency * nearness
            )
        order = np.lexsort((-jaccard[candidates], -score))[:top_k]
        return [GraphMatch(int(candidates[o]), float(score[o]), pairs[o]) for o in order]

    def _rings(self, graph: SaliencyGraph, vocabulary: dict[str, int]) -> np.ndarray:
        if self.config.structure == "node2vec":
            return np.zeros((len(graph), 0))
        return ring_hop_histograms(graph, vocabulary, self.config.ring_edges_m, self.config.hops)

    def _jaccard(self, known: np.ndarray, labels: tuple[str, ...], index: GraphIndex) -> np.ndarray:
        """(S,) Jaccard index of the query's labels with each map graph's, weighed by rarity; a label the map lacks is as rare as can be."""
        stranger = np.log(1 + len(index.graphs)) + 0.1 if self.config.rarity else 1.0
        unknown = [label for label, k in zip(labels, known, strict=True) if k < 0]
        asked, number = np.unique(known[known >= 0], return_counts=True)
        counts, total = index.counts, index.rarity @ index.counts
        outside = stranger * len(unknown)
        if self.config.labels == "set":
            number, counts, outside = np.ones(len(asked)), index.counts > 0, stranger * len(set(unknown))
            total = index.rarity @ counts
        shared = index.rarity[asked] @ np.minimum(counts[asked], number[:, None])
        union = total + index.rarity[asked] @ number + outside - shared
        return np.divide(shared, union, out=np.zeros(len(shared)), where=union > 0)

    def _similarity(self, query: SaliencyGraph, known: np.ndarray, index: GraphIndex, candidates: np.ndarray) -> np.ndarray:
        """(K, n, m) node similarity in [0, 1]: label, saliency ratio, structural feature; 0 where labels differ."""
        same = (known[None, :, None] == index.label[candidates][:, None]) & (known >= 0)[None, :, None]
        a, b = query.saliency[None, :, None], index.saliency[candidates][:, None]
        ratio = np.minimum(a, b) / np.maximum(np.maximum(a, b), 1e-12)
        if self.config.structure == "rings":
            structure = np.einsum("nf,kmf->knm", self._rings(query, index.vocabulary), index.features[candidates], optimize=True)
        else:
            structure = np.zeros(same.shape)
            vectors = node2vec([query, *(index.graphs[s] for s in candidates)], self.config.seed)
            for k, block in enumerate(vectors[1:]):
                structure[k, :, : len(block)] = np.maximum(vectors[0] @ block.T, 0)
        whole = 1 + self.config.saliency_weight + self.config.structure_weight
        return same * (1 + self.config.saliency_weight * ratio + self.config.structure_weight * structure) / whole

    def _align(self, similarity: np.ndarray) -> np.ndarray:
        """(M, 2) one-to-one node pairs of greatest total similarity, those below the least similarity rejected."""
        from scipy.optimize import linear_sum_assignment

        rows, columns = linear_sum_assignment(similarity, maximize=True)
        accepted = similarity[rows, columns] >= max(self.config.least_similarity, 1e-9)
        return np.column_stack([rows[accepted], columns[accepted]])

    def _verify(self, query, known, index, candidates, similarity, pairs) -> tuple[Verified, list[np.ndarray]]:
        """The best pose of each candidate, and the node pairs that agree with it where there are any."""
        rarity = np.where(known >= 0, index.rarity[known], index.rarity.max(initial=1.0))
        tolerance = self.config.tolerance_m + self.config.tolerance_share * np.hypot(
            query.range_m[None, :, None], index.range_m[candidates][:, None]
        )
        found = verify(
            query.centroid_m[:, :2], index.xy_m[candidates], similarity, tolerance, rarity / rarity.sum(), self.config.largest_shift_m
        )
        agreeing = [self._align_kernel(kernel) for kernel in found.kernel]
        return found, [new if len(new) >= 2 else old for new, old in zip(agreeing, pairs, strict=True)]

    def _align_kernel(self, kernel: np.ndarray) -> np.ndarray:
        from scipy.optimize import linear_sum_assignment

        if not kernel.any():
            return np.zeros((0, 2), int)
        rows, columns = linear_sum_assignment(kernel, maximize=True)
        accepted = kernel[rows, columns] > 0
        return np.column_stack([rows[accepted], columns[accepted]])

    def _triplets(self, query: SaliencyGraph, reference: SaliencyGraph, pairs: np.ndarray) -> float:
        """I = sum(W o M) over edges present in both graphs between aligned nodes; without edges in the query, the aligned saliency."""
        if not len(query.edges):
            return float(query.saliency[pairs[:, 0]].sum())
        a, b = np.triu_indices(len(pairs), 1)
        both = query.adjacency[pairs[a, 0], pairs[b, 0]] & reference.adjacency[pairs[a, 1], pairs[b, 1]]
        weight = np.sqrt(query.saliency[pairs[a, 0]] * query.saliency[pairs[b, 0]])
        return float(weight[both].sum()) / (float(query.weights.sum()) if self.config.normalise else 1.0)
