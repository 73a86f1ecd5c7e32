"""Tables of many graphs, in memory or packed in the folder of a map. Each attribute is one array over the nodes of all
graphs."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.columns import Columns, write_columns
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import (
    NODE,
    edge_bits,
    graph_from_arrays,
    graph_to_arrays,
    pack_graph,
    unpack_graph,
    unpack_nodes,
)
from salframe.graphs.scene_index import SceneLookup
from salframe.graphs.segments import Segments, ranges, starts

_CHUNK = 1024
"""Number of graphs whose labels are counted at once, which limits memory."""


@dataclass(frozen=True, eq=False)
class GraphNodes:
    """The concatenated nodes of K graphs, N nodes in total. Matchers use this layout.

    Attributes:
        count: (K,) int64, number of nodes of each graph.
        label: (N,) int64, indices of labels in a vocabulary, -1 for a label that is not in it.
        scores: (N,) float64, scores of the detector.
        saliency: (N,) float64.
        centroid_m: (N, 3) float64, in metres, in the panorama frame of each graph.
        size_m: (N, 3) float64, length, width and height in metres.
    """

    count: np.ndarray
    label: np.ndarray
    scores: np.ndarray
    saliency: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray

    @classmethod
    def of(cls, graph: SaliencyGraph, vocabulary: Mapping[str, int]) -> GraphNodes:
        """Return the nodes of one graph, with labels numbered by a vocabulary."""
        label = np.array([vocabulary.get(name, -1) for name in graph.labels], np.int64)
        columns = (graph.scores, graph.saliency, graph.centroid_m, graph.size_m)
        return cls(np.array([len(graph)]), label, *columns)

    def __len__(self) -> int:
        return len(self.label)

    @cached_property
    def segments(self) -> Segments:
        """The nodes grouped by graph."""
        return Segments(self.count)

    @cached_property
    def graph(self) -> np.ndarray:
        """(N,) int64: index of the graph of each node."""
        return np.arange(len(self.count)).repeat(self.count)

    @cached_property
    def range_m(self) -> np.ndarray:
        """(N,) float64: distances of the centroids from the camera, in metres."""
        return np.linalg.norm(self.centroid_m, axis=1)

    @cached_property
    def log_size(self) -> np.ndarray:
        """(N, 3) float64: natural logarithms of length, width and height in metres."""
        return np.log(self.size_m)


def count_graphs_by_label(count: np.ndarray, label: np.ndarray, labels: int) -> np.ndarray:
    """Return the number of graphs in which each label occurs, (L,) int64.

    Args:
        count: (S,) int, number of nodes of each graph.
        label: (P,) int, label ids of the nodes, graph by graph.
        labels: L, number of different labels.
    """
    graph_labels = np.sort(np.repeat(np.arange(len(count)), count) * labels + label)
    return np.bincount(graph_labels[np.diff(graph_labels, prepend=-1) > 0] % max(labels, 1), minlength=labels)


class GraphTable(Sequence[SaliencyGraph]):
    """A sequence of S graphs whose nodes all have a range. It also returns the nodes of several graphs at once.

    Attributes:
        sizes: (S,) int64, number of nodes of each graph.
        labels: Names of the L labels; the index of a name is its label id.
        vocabulary: Label id of each name.
        scenes: An open scene index of these graphs, None if there is none.
    """

    scenes: SceneLookup | None = None

    def __init__(self, labels: Sequence[str], count: np.ndarray, label: np.ndarray, edges: np.ndarray) -> None:
        """Create a table.

        Args:
            labels: Names of the L labels.
            count: (S,) int64, number of nodes of each of the S graphs.
            label: (P,), index in `labels` of the label of each node, graph by graph; P is the number of all nodes.
            edges: (B,) uint8, edges of all graphs, graph by graph, packed as in `pack_graph`.
        """
        self.labels = tuple(labels)
        self.vocabulary = {name: number for number, name in enumerate(labels)}
        self.sizes, self._label, self._edges = count, label, edges
        self._start, self._first_byte = starts(count), starts(_edge_bytes(count))

    def __len__(self) -> int:
        return len(self.sizes)

    @cached_property
    def num_graphs_by_label(self) -> np.ndarray:
        """(L,) int64: number of graphs in which each label occurs."""
        num_graphs_by_label = np.zeros(len(self.labels), np.int64)
        for low in range(0, len(self), _CHUNK):
            count = self.sizes[low : low + _CHUNK]
            label = self._label[self._start[low] : self._start[low + len(count)]]
            num_graphs_by_label += count_graphs_by_label(count, label, len(num_graphs_by_label))
        return num_graphs_by_label

    @abstractmethod
    def _values(self, nodes: np.ndarray) -> Mapping[str, np.ndarray]:
        """Return scores, saliency, centroid_m and size_m of the nodes with these row numbers (N,)."""

    def nodes(self, graphs: np.ndarray) -> np.ndarray:
        """Return the row numbers, in the table, of the nodes of the graphs with these indices (K,), graph by graph,
        (N,) int64."""
        return ranges(self._start[graphs], self.sizes[graphs])

    def take(self, graphs: np.ndarray) -> GraphNodes:
        """Return the nodes of the graphs with these indices (K,)."""
        nodes = self.nodes(graphs)
        return GraphNodes(self.sizes[graphs], self._label[nodes].astype(np.int64), **self._values(nodes))

    def adjacency(self, graphs: np.ndarray) -> np.ndarray:
        """Return the adjacency matrices of the graphs with these indices (K,), (K, m, m) bool, symmetric. m is the
        number of nodes of the largest graph; the other matrices are padded with False."""
        count = self.sizes[graphs][:, None]
        max_count = count.max(initial=0)
        low, high = np.triu_indices(max_count, 1)
        exists = high < count
        bit = low * (2 * count - low - 1) // 2 + high - low - 1
        byte = self._edges[(self._first_byte[graphs][:, None] + bit // 8)[exists]]
        linked = np.zeros((len(graphs), max_count, max_count), bool)
        upper = np.zeros(exists.shape, bool)
        upper[exists] = byte >> (7 - bit[exists] % 8) & 1
        linked[:, low, high] = linked[:, high, low] = upper
        return linked


class MemoryGraphs(GraphTable):
    """A table of graphs in memory, with unrounded values."""

    def __init__(self, graphs: Sequence[SaliencyGraph]) -> None:
        labels = sorted({label for graph in graphs for label in graph.labels})
        number = {name: i for i, name in enumerate(labels)}
        count = np.array([len(graph) for graph in graphs], np.int64)
        label = np.array([number[name] for graph in graphs for name in graph.labels], np.int64)
        bits = [edge_bits(graph.edges, len(graph)) for graph in graphs]
        edges = np.concatenate([np.zeros(0, np.uint8), *bits])
        super().__init__(labels, count, label, edges)
        self._graphs = graphs
        self._columns = {
            name: np.concatenate([np.zeros((0, *more)), *(getattr(graph, name) for graph in graphs)])
            for name, more in (("scores", ()), ("saliency", ()), ("centroid_m", (3,)), ("size_m", (3,)))
        }

    def __getitem__(self, number: int) -> SaliencyGraph:  # type: ignore[override]  # several graphs: `take`
        return self._graphs[number]

    def _values(self, nodes: np.ndarray) -> Mapping[str, np.ndarray]:
        return {name: column[nodes] for name, column in self._columns.items()}


class MappedGraphs(GraphTable):
    """A table of packed graphs in memory-mapped columns on disk."""

    def __init__(self, rows: Columns, scenes: SceneLookup | None = None) -> None:
        """Open packed graphs.

        Args:
            rows: Table with the arrays of `pack_graph` as columns. Other columns are ignored.
            scenes: An open scene index of these graphs; None: there is none.

        Raises:
            DataError: A column of packed graphs is missing or has another type.
        """
        try:
            names, nodes, edges = (rows.columns[name] for name in ("labels", "nodes", "edges"))
        except KeyError as error:
            raise DataError(
                f"{rows.folder} has no column {error}, which the graphs of a map need: build the map again"
            ) from None
        if names.words is None or (nodes.values.dtype, edges.values.dtype) != (NODE, np.uint8):
            raise DataError(f"the tables of graphs in {rows.folder} have columns of wrong types: build the map again")
        count = np.diff(names.start)
        super().__init__(names.words, count, names.values, edges.values)
        self._packed, self.scenes = nodes.values, scenes
        if not (np.array_equal(nodes.start, self._start) and np.array_equal(edges.start, self._first_byte)):
            raise DataError(
                f"{rows.folder} is damaged, its columns of nodes, edges and labels do not match: build the map again"
            )

    def __getitem__(self, number: int) -> SaliencyGraph:  # type: ignore[override]  # several graphs: `take`
        if not 0 <= number < len(self):
            raise IndexError(number)
        rows, bits = (slice(*start[number : number + 2]) for start in (self._start, self._first_byte))
        labels = np.array([self.labels[i] for i in self._label[rows]], np.str_)
        packed = {"labels": labels, "nodes": self._packed[rows], "edges": self._edges[bits]}
        return graph_from_arrays(unpack_graph(packed))

    def _values(self, nodes: np.ndarray) -> Mapping[str, np.ndarray]:
        values = unpack_nodes(self._packed[nodes])
        return {name: values[name] for name in ("scores", "saliency", "centroid_m", "size_m")}


def write_graphs(graphs: Iterable[SaliencyGraph], folder: Path) -> None:
    """Pack a stream of graphs, and write it to a new folder in the format of `write_columns`.

    Raises:
        DataError: As in `pack_graph`.
    """
    write_columns(folder, (pack_graph(graph_to_arrays(graph)) for graph in graphs))


def _edge_bytes(count: np.ndarray) -> np.ndarray:
    """Return the number of bytes of the packed edges of each graph, from its number of nodes."""
    return -(-count * (count - 1) // 16)
