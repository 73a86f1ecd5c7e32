"""Base class of graph matchers that compare nodes of the same label: selection of candidates, and node similarity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.errors import DataError
from salframe.framework.files.array_files import map_array
from salframe.framework.files.reading import reading
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatcher
from salframe.graphs.scene_index import SceneIndex, SceneLookup
from salframe.graphs.table import GraphNodes, GraphTable, MappedGraphs, MemoryGraphs
from salframe_graphs.features import feature_products, ring_hop_histograms
from salframe_graphs.node_pairs import NodePairs, label_counts

_CHUNK = 64
"""Number of graphs whose structural features are computed at once."""
MAX_PRECOMPUTED = 1000
"""Maximum number of graphs on disk whose structural features are computed when a map is opened. For larger maps the
features of the candidates are computed for each query."""
_RARITY, _SCENES = "rarity.npy", "scenes"


def _ascending(edges_m: tuple[float, ...]) -> tuple[float, ...]:
    if any(low >= high for low, high in pairwise((0.0, *edges_m))):
        raise ValueError(f"received {list(edges_m)}, expected positive values in ascending order, such as [1, 2, 4]")
    return edges_m


class NodeMatcherConfig(ComponentConfig):
    """Settings of the selection of candidate graphs, and of the similarity of two nodes."""

    rarity: bool = Field(
        True,
        description="true: rare labels have larger weights. The weight of a label is ln((1 + G) / (1 + g)) + 1, where "
        "G is the number of graphs of the map, and g is the number of those with the label; false: all labels have "
        "the weight 1",
    )
    confidence: bool = Field(
        True,
        description="true: the weight of a node is the weight of its label times the confidence score of the "
        "detector; false: it is the weight of the label only",
    )
    min_candidate_ratio: float = Field(
        0.25,
        ge=0,
        le=1,
        description="minimum ratio J / J_max (0 to 1) of a graph that is compared with the query node by node. J is "
        "the Jaccard index of the labels of this graph and the query. J_max is the maximum of J over all graphs of the "
        "map; 0: no minimum. The paper uses 0.6",
    )
    max_candidates: int | None = Field(
        100,
        ge=1,
        description="maximum number of graphs that are compared with a query node by node. In a larger map, the scene "
        "index selects them; null: all graphs (as in the paper)",
    )
    scene_index: slot(  # type: ignore[valid-type]
        "scene-index",
        "by-size",
        description="index that selects the graphs to compare, in a map with more than `max_candidates` graphs. "
        "by-size: an index that suits the size of the map",
    )
    height_scale_m: float | None = Field(
        0.2,
        gt=0,
        description="difference in height (m) between the centres of two nodes that halves their similarity; null: "
        "heights are ignored",
    )
    size_scale: tuple[float, float] | None = Field(
        (0.8, 0.5),
        description="scales [a, b] of the differences in size. The similarity of two nodes is halved if one box is "
        "exp(a) times as long as the other, and also if one box is exp(b) times as high as the other; null: sizes are "
        "ignored",
    )
    ring_edges_m: Annotated[tuple[float, ...], AfterValidator(_ascending)] = Field(
        (1.0, 2.0, 4.0),
        description="outer radii (m) of rings around a node, ascending. The structural feature of the node counts the "
        "labels of the nodes in each ring, and the labels of the nodes that are 1 to `hops` edges away",
    )
    hops: int = Field(
        2,
        ge=0,
        le=16,
        description="maximum number of edges between a node and the nodes whose labels its structural feature counts "
        "(see `ring_edges_m`); 0: only nodes in rings are counted",
    )
    structure_weight: float = Field(
        0.3,
        ge=0,
        description="weight of the structural feature (see `ring_edges_m`) in the similarity of two nodes. The label "
        "has the weight 1; 0: the feature is not used",
    )
    min_similarity: float = Field(
        0.1, ge=0, le=1, description="minimum similarity (0 to 1) of two nodes that can be matched"
    )


@dataclass(frozen=True, eq=False)
class GraphIndex:
    """The graphs of a map in the layout for matching.

    Attributes:
        graphs: The graphs.
        scenes: The index that returns candidates; None if every graph is a candidate.
        nodes: The nodes of all graphs; None if `scenes` returns candidates.
        rarity: (L + 1,) inverse document frequency of each label. The last value is for labels that no graph has.
        structure: csr_array of the structural features of all nodes; None if the features of the candidates are
            computed for each query.
    """

    graphs: GraphTable
    scenes: SceneLookup | None
    nodes: GraphNodes | None
    rarity: np.ndarray
    structure: Any


@dataclass(frozen=True, eq=False)
class Candidates:
    """K graphs of a map that a query is compared with.

    Attributes:
        graph: The query's graph.
        query: The query's nodes, with labels numbered by the map's vocabulary.
        weight: (n,) weights of the query's nodes.
        graphs: (K,) indices of the graphs in the map, ascending.
        jaccard: (K,) Jaccard index of the labels of the query and each graph.
        nodes: The nodes of the graphs.
        node_weight: (N,) weights of these nodes.
    """

    graph: SaliencyGraph
    query: GraphNodes
    weight: np.ndarray
    graphs: np.ndarray
    jaccard: np.ndarray
    nodes: GraphNodes
    node_weight: np.ndarray

    @cached_property
    def pairs(self) -> NodePairs:
        """The pairs of query and graph nodes with the same label."""
        return NodePairs.of_same_label(self.query.label, self.nodes)


class NodeMatcher(GraphMatcher):
    """Base class of matchers that select candidates by their labels and compare nodes of the same label.

    The Config of a subclass inherits from NodeMatcherConfig.
    """

    uses_scene_index = True

    def index(self, graphs: Sequence[SaliencyGraph]) -> GraphIndex:
        table = graphs if isinstance(graphs, GraphTable) else MemoryGraphs(graphs)
        scenes = table.scenes
        if scenes is None and self._looks_up(table):
            scenes = self._new_scene_index()
            scenes.take(table)
        return self._graph_index(table, scenes, self._rarity(table))

    def write_index(self, graphs: Sequence[SaliencyGraph], folder: Path) -> None:
        table = graphs if isinstance(graphs, GraphTable) else MemoryGraphs(graphs)
        folder.mkdir(parents=True)
        np.save(folder / _RARITY, self._rarity(table))
        if self._looks_up(table):
            self._new_scene_index().build(table, folder / _SCENES)

    def open_index(self, graphs: MappedGraphs, folder: Path) -> GraphIndex:
        with reading(folder / _RARITY, "an array of numpy"):
            rarity = map_array(folder / _RARITY)
        if rarity.shape != (len(graphs.labels) + 1,) or rarity.dtype != np.float64:
            expected = f"float64 and ({len(graphs.labels) + 1},)"
            raise DataError(
                f"{folder / _RARITY} has dtype {rarity.dtype} and shape {rarity.shape}, expected {expected}: build "
                "the map again"
            )
        max_rarity = np.log(1 + len(graphs)) + 1  # rarity of a label that no graph has
        if not ((rarity > 0) & (rarity <= max_rarity + 1e-9)).all():
            raise DataError(
                f"{folder / _RARITY} has values from {rarity.min():g} to {rarity.max():g}, expected values above 0 "
                f"and at most {max_rarity:g}: build the map again"
            )
        scenes = graphs.scenes
        if scenes is None and self._looks_up(graphs):
            scenes = self._new_scene_index()
            scenes.open(folder / _SCENES)
        return self._graph_index(graphs, scenes, np.array(rarity))

    def _graph_index(self, table: GraphTable, scenes: SceneLookup | None, rarity: np.ndarray) -> GraphIndex:
        nodes = table.take(np.arange(len(table))) if scenes is None else None
        return GraphIndex(table, scenes, nodes, rarity, self._structure_of_all(table))

    def _looks_up(self, table: GraphTable) -> bool:
        """Return whether a scene index is needed because there are more graphs than candidates."""
        return self.config.max_candidates is not None and len(table) > self.config.max_candidates

    def _new_scene_index(self) -> SceneIndex:
        scene_index: SceneIndex = registry().build(SceneIndex.role, self.config.scene_index)
        return scene_index

    def _rarity(self, table: GraphTable) -> np.ndarray:
        """Return the rarity (L + 1,) of each label as in GraphIndex; all 1 if the setting `rarity` is false."""
        if not self.config.rarity:
            return np.ones(len(table.labels) + 1)
        num_graphs_with_label = np.append(table.num_graphs_by_label, 0)
        rarity: np.ndarray = np.log((1 + len(table)) / (1 + num_graphs_with_label)) + 1
        return rarity

    @property
    def _has_rings(self) -> bool:
        """Whether nodes have structural features that are independent of the query."""
        return self.config.structure_weight > 0

    def _structure_of_all(self, table: GraphTable) -> Any:
        if not self._has_rings or not len(table) or (isinstance(table, MappedGraphs) and len(table) > MAX_PRECOMPUTED):
            return None
        from scipy.sparse import csr_array, vstack

        by_size = np.argsort(table.sizes, kind="stable")  # graphs of similar size need little padding
        chunks = np.split(by_size, range(_CHUNK, len(table), _CHUNK))
        labels = np.arange(len(table.labels))
        rows = [csr_array(self._structure(table.take(chunk), table.adjacency(chunk), labels)) for chunk in chunks]
        return vstack(rows, format="csr")[np.argsort(table.nodes(by_size))]

    def _structure(self, nodes: GraphNodes, adjacency: np.ndarray, labels: np.ndarray) -> np.ndarray:
        """Return the structural features (N, F) of nodes. They count only neighbours with the requested labels."""
        return ring_hop_histograms(nodes, adjacency, labels, self.config.ring_edges_m, self.config.hops)

    def _candidates(self, graph: SaliencyGraph, index: GraphIndex) -> Candidates | None:
        """Return the graphs to compare the query with; None if no label of the query is in the map."""
        query = GraphNodes.of(graph, index.graphs.vocabulary)
        if not (query.label >= 0).any():
            return None
        numbers = self._shortlist(graph, index)
        nodes = index.graphs.take(numbers) if index.nodes is None else index.nodes
        jaccard = self._label_jaccard(graph, query, nodes, index.rarity)
        is_candidate = (jaccard > 0) & (jaccard >= self.config.min_candidate_ratio * jaccard.max(initial=0))
        if not is_candidate.all():
            rows = is_candidate[nodes.graph]
            of_nodes = ("label", "scores", "saliency", "centroid_m", "size_m")
            nodes = replace(
                nodes, count=nodes.count[is_candidate], **{name: getattr(nodes, name)[rows] for name in of_nodes}
            )
        weight = self._confidence(query) * index.rarity[query.label]
        node_weight = self._confidence(nodes) * index.rarity[nodes.label]
        return Candidates(graph, query, weight, numbers[is_candidate], jaccard[is_candidate], nodes, node_weight)

    def _shortlist(self, graph: SaliencyGraph, index: GraphIndex) -> np.ndarray:
        """Return the indices (K,) of the graphs to match, ascending: all, or the candidates of the scene index."""
        if index.scenes is None:
            return np.arange(len(index.graphs))
        return np.sort(index.scenes.candidates(graph, self.config.max_candidates).scene)

    def _label_jaccard(
        self, graph: SaliencyGraph, query: GraphNodes, nodes: GraphNodes, rarity: np.ndarray
    ) -> np.ndarray:
        """Return the Jaccard index (K,) of the labels of the query and each graph, weighted by rarity."""
        distinct, number, counts = label_counts(query.label, len(rarity) - 1, nodes.label, nodes.count)
        shared = np.minimum(counts, number) @ rarity[distinct]
        union = nodes.segments.sum(rarity[nodes.label]) + number @ rarity[distinct] - shared
        return np.divide(shared, union, out=np.zeros(len(shared)), where=union > 0)

    def _confidence(self, nodes: GraphNodes) -> np.ndarray:
        """Return the confidence (N,) of each node: the detector's score, or 1 if the setting `confidence` is false."""
        return nodes.scores if self.config.confidence else np.ones(len(nodes))

    def _ring_products(self, candidates: Candidates, index: GraphIndex) -> np.ndarray:
        """Return the dot products (P,) of the structural features of each node pair."""
        i, node, table, adjacency = (
            candidates.pairs.query,
            candidates.pairs.node,
            index.graphs,
            candidates.graph.adjacency[None],
        )
        if index.structure is not None:
            query = self._structure(candidates.query, adjacency, np.arange(len(table.labels)))
            return feature_products(query, index.structure, i, table.nodes(candidates.graphs)[node])
        labels = np.unique(
            candidates.query.label[candidates.query.label >= 0]
        )  # other labels contribute 0 to a product
        query = self._structure(candidates.query, adjacency, labels)
        features = self._structure(candidates.nodes, table.adjacency(candidates.graphs), labels)
        return (features @ query.T)[node, i]

    def _attribute_similarity(self, candidates: Candidates, max_scale_error: float = 0.0) -> np.ndarray:
        """Return the similarity (P,) of heights and sizes of each node pair, 0 to 1.

        The query's heights may have a scale error of up to `max_scale_error`; the most favourable scale is used.
        """
        i, node, value = candidates.pairs.query, candidates.pairs.node, np.ones(len(candidates.pairs))
        if self.config.height_scale_m is not None:
            query_z = candidates.query.centroid_m[i, 2]
            difference_m = query_z - candidates.nodes.centroid_m[node, 2]
            if max_scale_error:
                difference_m = np.maximum(np.abs(difference_m) - max_scale_error * np.abs(query_z), 0)
            value /= 1 + (difference_m / self.config.height_scale_m) ** 2
        if self.config.size_scale is not None:
            for side, scale in zip((0, 2), self.config.size_scale, strict=True):
                log_ratio = candidates.query.log_size[i, side] - candidates.nodes.log_size[node, side]
                value /= 1 + (log_ratio / scale) ** 2
        return value
