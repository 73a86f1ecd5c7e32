"""The matcher `triplet`: weighted triplets as in the paper, with options for ablations."""

from __future__ import annotations

import importlib.util
from typing import Any, Literal

import numpy as np
from pydantic import Field

from salframe.framework.errors import RequirementMissing
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatch
from salframe.graphs.table import GraphNodes
from salframe_graphs.alignment import align
from salframe_graphs.features import node2vec
from salframe_graphs.node_matcher import Candidates, GraphIndex, NodeMatcher, NodeMatcherConfig
from salframe_graphs.node_pairs import shared_weight


class TripletMatcher(NodeMatcher):
    """Aligns the nodes of two graphs one-to-one, as in the paper.

    A triplet is an edge with its two nodes. The score is the sum of the weights of the triplets that both graphs have
    between aligned nodes. There is no geometric verification: the positioner estimates the pose from the aligned nodes.
    """

    name = "triplet"
    version = "4"

    class Config(NodeMatcherConfig):
        labels: Literal["set", "multiset"] = Field(
            "multiset",
            description="how labels are counted when graphs are selected by `min_candidate_ratio`. set: each label "
            "counts once; multiset: each label counts as often as it occurs",
        )
        structure: Literal["rings", "node2vec"] = Field(
            "rings",
            description="structural feature of a node. rings: for each label, the number of nodes in each ring around "
            "the node (see `ring_edges_m`), and the number of nodes that are 1, 2, ... edges away; node2vec: an "
            "embedding of the node, as in the paper",
        )
        saliency_weight: float = Field(
            0.0,
            ge=0,
            description="weight of the ratio of the saliencies in the similarity of two nodes. The label has the "
            "weight 1; 0: saliencies are not compared",
        )
        normalise: bool = Field(
            True,
            description="true: the score is divided by the sum of the edge weights of the query; false: it is not "
            "divided, as in the paper",
        )
        edge_weights: Literal["saliency", "unit"] = Field(
            "saliency",
            description="weight of a triplet. saliency: sqrt(S_a S_b), where S_a and S_b are the saliencies of its "
            "nodes; unit: 1",
        )
        similarity_score: float = Field(
            0.0,
            ge=0,
            description="weight of a Jaccard index of the nodes, which is added to the score. The triplets have the "
            "weight 1; 0: only triplets count, as in the paper",
        )
        seed: int = Field(0, ge=0, description="random seed of the node2vec training")

    @classmethod
    def check(cls, config: Any) -> None:
        super().check(config)
        if config.structure == "node2vec" and importlib.util.find_spec("gensim") is None:
            raise RequirementMissing(
                "the setting structure=node2vec needs the package gensim, which is not installed: pip install "
                "'salframe[node2vec]'"
            )

    @property
    def _has_rings(self) -> bool:
        return self.config.structure == "rings" and super()._has_rings  # node2vec depends on the query

    def match(self, query: SaliencyGraph, index: GraphIndex, top_k: int) -> list[GraphMatch]:
        candidates = self._candidates(query, index)
        if candidates is None:
            return []
        value = self._similarity(candidates, index)
        pairs, similar = candidates.pairs.select((value > 0) & (value >= self.config.min_similarity), value)
        aligned = align(pairs, candidates.nodes.segments.start[:-1], similar, np.zeros(len(pairs)))
        graphs = [index.graphs[number] for number in candidates.graphs.tolist()]
        score = np.array([self._triplets(query, graph, nodes) for graph, nodes in zip(graphs, aligned, strict=True)])
        if self.config.similarity_score:
            shared = shared_weight(candidates.pairs, value, candidates.weight, candidates.nodes, candidates.node_weight)
            score = score + self.config.similarity_score * shared
        best = np.lexsort((-candidates.jaccard, -score))[:top_k]
        return [GraphMatch(int(candidates.graphs[row]), float(score[row]), aligned[row]) for row in best.tolist()]

    def _label_jaccard(
        self, graph: SaliencyGraph, query: GraphNodes, nodes: GraphNodes, rarity: np.ndarray
    ) -> np.ndarray:
        if self.config.labels == "multiset":
            return super()._label_jaccard(graph, query, nodes, rarity)
        num_unknown = len(set(graph.labels)) - len(np.unique(query.label[query.label >= 0]))
        has_label = np.zeros((len(nodes.count), len(rarity)), bool)
        has_label[nodes.graph, nodes.label] = True
        in_query = np.zeros(len(rarity), bool)
        in_query[query.label[query.label >= 0]] = True
        shared = (has_label & in_query) @ rarity
        union = has_label @ rarity + in_query @ rarity + num_unknown * rarity[-1] - shared
        return np.divide(shared, union, out=np.zeros(len(shared)), where=union > 0)

    def _similarity(self, candidates: Candidates, index: GraphIndex) -> np.ndarray:
        """Return the similarity (P,) of each node pair, from label, saliency ratio, structure, height and size."""
        if candidates.graph.bearings_only:
            return np.ones(len(candidates.pairs))
        saliency_weight, structure_weight = self.config.saliency_weight, self.config.structure_weight
        i, node = candidates.pairs.query, candidates.pairs.node
        a, b = candidates.query.saliency[i], candidates.nodes.saliency[node]
        ratio = np.minimum(a, b) / np.maximum(np.maximum(a, b), 1e-12)
        value = 1 + saliency_weight * ratio
        if structure_weight:
            value += structure_weight * self._structure_products(candidates, index)
        return value / (1 + saliency_weight + structure_weight) * self._attribute_similarity(candidates)

    def _structure_products(self, candidates: Candidates, index: GraphIndex) -> np.ndarray:
        """Return the similarity (P,) of the structural features of each node pair."""
        if self._has_rings:
            return self._ring_products(candidates, index)
        graphs = [index.graphs[number] for number in candidates.graphs.tolist()]
        query, *others = node2vec([candidates.graph, *graphs], self.config.seed)
        map_nodes = np.concatenate([np.zeros((0, query.shape[1])), *others])
        return np.maximum((query[candidates.pairs.query] * map_nodes[candidates.pairs.node]).sum(1), 0)

    def _triplets(self, query: SaliencyGraph, reference: SaliencyGraph, nodes: np.ndarray) -> float:
        """Return the triplet score, I = sum(W o M) over the edges that both graphs have between aligned nodes (paper,
        triplet matching).

        If the query has no edge, the score is the sum of the saliencies of the aligned query nodes.
        """
        if not len(query.edges):
            return float(query.saliency[nodes[:, 0]].sum())
        a, b = np.triu_indices(len(nodes), 1)
        both = query.adjacency[nodes[a, 0], nodes[b, 0]] & reference.adjacency[nodes[a, 1], nodes[b, 1]]
        if self.config.edge_weights == "unit":
            return float(both.sum()) / (len(query.edges) if self.config.normalise else 1.0)
        weight = np.sqrt(query.saliency[nodes[a, 0]] * query.saliency[nodes[b, 0]])
        return float(weight[both].sum()) / (float(query.weights.sum()) if self.config.normalise else 1.0)
