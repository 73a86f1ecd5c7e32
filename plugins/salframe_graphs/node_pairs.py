"""Pairs of a query's nodes and the nodes of candidate graphs that bear the same label, and what they have in common."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from salframe.graphs.segments import Segments, ranges, run_starts
from salframe.graphs.table import GraphNodes


@dataclass(frozen=True, eq=False)
class NodePairs:
    """P pairs of the nodes of a query, n, and of K graphs, N together, sorted by graph, query node and graph node.

    query, node: (P,) int64, positions among the query's nodes and among the nodes of all graphs. graph: (P,) int64.
    """

    query: np.ndarray
    node: np.ndarray
    graph: np.ndarray
    num_graphs: int

    @classmethod
    def of_same_label(cls, label: np.ndarray, nodes: GraphNodes) -> NodePairs:
        """Return all pairs of the query's labels (n,), -1 of a label that no graph has, with the graphs' nodes."""
        query, node = np.nonzero((label[:, None] == nodes.label) & (label >= 0)[:, None])
        graph = nodes.graph[node]
        order = np.argsort(graph * len(label) + query, kind="stable")
        return cls(query[order], node[order], graph[order], len(nodes.count))

    def __len__(self) -> int:
        return len(self.query)

    @cached_property
    def segments(self) -> Segments:
        """The graphs as groups of pairs."""
        return Segments(np.bincount(self.graph, minlength=self.num_graphs))

    @cached_property
    def first_of_query(self) -> np.ndarray:
        """(Q,) the positions at which the pairs of another query node, or graph, begin."""
        return run_starts(self.query, self.graph)

    def best_per_query(self, value: np.ndarray) -> tuple[np.ndarray, Segments]:
        """Return the maximum of non-negative values (P,) for each query node of each graph, (Q,), and the graphs as
        groups of these."""
        first = self.first_of_query
        graphs = Segments(np.bincount(self.graph[first], minlength=self.num_graphs))
        return (np.maximum.reduceat(value, first) if len(first) else value), graphs

    def min_candidate_ratio(self, mask: np.ndarray, values: np.ndarray) -> tuple[NodePairs, np.ndarray]:
        """Return the pairs of a mask (P,), and their values of `values` (P,)."""
        return replace(self, query=self.query[mask], node=self.node[mask], graph=self.graph[mask]), values[mask]

    def take(self, graphs: np.ndarray) -> tuple[NodePairs, np.ndarray]:
        """Return the pairs of some graphs (T,), in this order, and their positions among these."""
        count = self.segments.count[graphs]
        position = ranges(self.segments.start[graphs], count)
        owner = np.arange(len(graphs)).repeat(count)
        return NodePairs(self.query[position], self.node[position], owner, len(graphs)), position


def label_counts(
    label: np.ndarray, num_labels: int, map_label: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Count the labels of a query in graphs.

    Args:
        label: (n,) the query's, -1 of a label that the vocabulary lacks.
        num_labels: number of labels of the vocabulary, L.
        map_label: (N,) the labels of the nodes of K graphs, one graph after the other.
        count: (K,) number of nodes of each graph.

    Returns:
        (J,) the query's labels, L of those that the vocabulary lacks, (J,) how many of its nodes bear each, and (K, J)
        how many nodes of each graph do.
    """
    number = np.bincount(np.where(label >= 0, label, num_labels), minlength=num_labels + 1)
    used = np.flatnonzero(number)
    column = np.full(num_labels + 1, -1)
    column[used] = np.arange(len(used))
    there = column[map_label]
    cell = there + len(used) * np.arange(len(count)).repeat(count)
    counts = np.bincount(cell[there >= 0], minlength=len(count) * len(used))
    return used, number[used], counts.reshape(len(count), len(used))


def shared_weight(
    pairs: NodePairs, value: np.ndarray, weight: np.ndarray, nodes: GraphNodes, node_weight: np.ndarray
) -> np.ndarray:
    """Return the Jaccard index over nodes of each graph, (K,) float64.

    A node shares as much as it is similar to the most similar node of the other graph; of both sides the lesser counts.

    Args:
        pairs: the pairs that are compared.
        value: (P,) similarity of each pair, 0 to 1; pairs that are not listed have 0.
        weight: (n,) of the query's nodes.
        nodes: the nodes of the graphs.
        node_weight: (N,) their weights.
    """
    best, graphs = pairs.best_per_query(value)
    shared_query = graphs.sum(best * weight[pairs.query[pairs.first_of_query]])
    best_node = np.zeros(len(nodes))
    np.maximum.at(best_node, pairs.node, value)
    shared = np.minimum(shared_query, nodes.segments.sum(best_node * node_weight))
    whole = weight.sum() + nodes.segments.sum(node_weight) - shared
    return np.divide(shared, whole, out=np.zeros(len(shared)), where=whole > 0)
