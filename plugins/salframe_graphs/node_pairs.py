"""Pairs of query nodes and candidate nodes with the same label, and the Jaccard index over them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from salframe.graphs.segments import Segments, ranges, run_starts
from salframe.graphs.table import GraphNodes


@dataclass(frozen=True, eq=False)
class NodePairs:
    """P pairs of a node of a query and a node of one of K graphs, sorted by graph, query node and graph node.

    Attributes:
        query: (P,) int64, indices of the query nodes.
        node: (P,) int64, indices of the graph nodes among the nodes of all graphs.
        graph: (P,) int64, index of the graph of each pair.
        num_graphs: Number of graphs, K.
    """

    query: np.ndarray
    node: np.ndarray
    graph: np.ndarray
    num_graphs: int

    @classmethod
    def of_same_label(cls, label: np.ndarray, nodes: GraphNodes) -> NodePairs:
        """Return all pairs of query and graph nodes with the same label.

        Args:
            label: (n,) labels of the query's nodes, -1 for a label that no graph has.
            nodes: The nodes of the graphs.
        """
        query, node = np.nonzero((label[:, None] == nodes.label) & (label >= 0)[:, None])
        graph = nodes.graph[node]
        order = np.argsort(graph * len(label) + query, kind="stable")
        return cls(query[order], node[order], graph[order], len(nodes.count))

    def __len__(self) -> int:
        return len(self.query)

    @cached_property
    def segments(self) -> Segments:
        """The pairs grouped by graph."""
        return Segments(np.bincount(self.graph, minlength=self.num_graphs))

    @cached_property
    def first_of_query(self) -> np.ndarray:
        """(Q,) index of the first pair of each of the Q combinations of query node and graph that have pairs."""
        return run_starts(self.query, self.graph)

    def best_per_query(self, value: np.ndarray) -> tuple[np.ndarray, Segments]:
        """Return the maximum value of the pairs of each combination of query node and graph.

        Args:
            value: (P,) values of the pairs, at least 0.

        Returns:
            (Q,) maxima, in the order of `first_of_query`, and their grouping by graph.
        """
        first = self.first_of_query
        graphs = Segments(np.bincount(self.graph[first], minlength=self.num_graphs))
        return (np.maximum.reduceat(value, first) if len(first) else value), graphs

    def select(self, mask: np.ndarray, values: np.ndarray) -> tuple[NodePairs, np.ndarray]:
        """Return the pairs and the values (P,) where a mask (P,) is true."""
        return replace(self, query=self.query[mask], node=self.node[mask], graph=self.graph[mask]), values[mask]

    def take(self, graphs: np.ndarray) -> tuple[NodePairs, np.ndarray]:
        """Return the pairs of graphs (T,), in the order of the argument, and the indices of these pairs in `self`."""
        count = self.segments.count[graphs]
        position = ranges(self.segments.start[graphs], count)
        owner = np.arange(len(graphs)).repeat(count)
        return NodePairs(self.query[position], self.node[position], owner, len(graphs)), position


def label_counts(
    label: np.ndarray, num_labels: int, map_label: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each label of a query, count the nodes with this label, in the query and in each of K graphs.

    Args:
        label: (n,) labels of the query's nodes, -1 for a label outside the vocabulary.
        num_labels: Number of labels of the vocabulary, L.
        map_label: (N,) labels of the nodes of K graphs, one graph after the other.
        count: (K,) number of nodes of each graph.

    Returns:
        Three arrays: (J,) the distinct labels of the query, with L for all labels outside the vocabulary; (J,) the
        number of query nodes of each label; (K, J) the number of nodes of each label in each graph.
    """
    number = np.bincount(np.where(label >= 0, label, num_labels), minlength=num_labels + 1)
    distinct = np.flatnonzero(number)
    column = np.full(num_labels + 1, -1)
    column[distinct] = np.arange(len(distinct))
    column_of_node = column[map_label]
    cell = column_of_node + len(distinct) * np.arange(len(count)).repeat(count)
    counts = np.bincount(cell[column_of_node >= 0], minlength=len(count) * len(distinct))
    return distinct, number[distinct], counts.reshape(len(count), len(distinct))


def shared_weight(
    pairs: NodePairs, value: np.ndarray, weight: np.ndarray, nodes: GraphNodes, node_weight: np.ndarray
) -> np.ndarray:
    """Return the weighted Jaccard index over the nodes of the query and each graph, (K,) float64.

    Each node of the query contributes its weight times its similarity to the most similar node of the graph, and vice
    versa. The intersection is the smaller of the two sums.

    Args:
        pairs: The node pairs to compare.
        value: (P,) similarity of each pair, 0 to 1. All other pairs have similarity 0.
        weight: (n,) weights of the query's nodes.
        nodes: The nodes of the graphs.
        node_weight: (N,) weights of the graphs' nodes.
    """
    best, graphs = pairs.best_per_query(value)
    shared_query = graphs.sum(best * weight[pairs.query[pairs.first_of_query]])
    best_node = np.zeros(len(nodes))
    np.maximum.at(best_node, pairs.node, value)
    shared = np.minimum(shared_query, nodes.segments.sum(best_node * node_weight))
    union = weight.sum() + nodes.segments.sum(node_weight) - shared
    return np.divide(shared, union, out=np.zeros(len(shared)), where=union > 0)
