"""Many graphs as columns, their nodes one after the other: in memory, or packed in the folder of a map."""

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
"""Labels of so many graphs are counted at once."""


@dataclass(frozen=True, eq=False)
class GraphNodes:
    """The nodes of K graphs, one graph after the other: the flat layout that matching works on.

    count: (K,) int64, number of nodes of each graph. label: (N,) int64, numbers of a vocabulary, -1 of a label that it
    lacks. scores, saliency: (N,) float64. centroid_m, size_m: (N, 3) float64, in each graph's panorama frame.
    """

    count: np.ndarray
    label: np.ndarray
    scores: np.ndarray
    saliency: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray

    @classmethod
    def of(cls, graph: SaliencyGraph, vocabulary: Mapping[str, int]) -> GraphNodes:
        """Return the nodes of one graph, their labels numbered by a vocabulary."""
        label = np.array([vocabulary.get(name, -1) for name in graph.labels], np.int64)
        columns = (graph.scores, graph.saliency, graph.centroid_m, graph.size_m)
        return cls(np.array([len(graph)]), label, *columns)

    def __len__(self) -> int:
        return len(self.label)

    @cached_property
    def segments(self) -> Segments:
        """The graphs as groups of nodes."""
        return Segments(self.count)

    @cached_property
    def graph(self) -> np.ndarray:
        """(N,) int64: the graph of each node."""
        return np.arange(len(self.count)).repeat(self.count)

    @cached_property
    def range_m(self) -> np.ndarray:
        """(N,) float64: distance of the centroids."""
        return np.linalg.norm(self.centroid_m, axis=1)

    @cached_property
    def log_size(self) -> np.ndarray:
        """(N, 3) float64: logarithms of length, width and height."""
        return np.log(self.size_m)


def count_having(count: np.ndarray, label: np.ndarray, labels: int) -> np.ndarray:
    """(L,) int64: how many graphs have each of so many labels, of `count` (S,) nodes each, label (P,) graph by
    graph."""
    owned = np.sort(np.repeat(np.arange(len(count)), count) * labels + label)
    return np.bincount(owned[np.diff(owned, prepend=-1) > 0] % max(labels, 1), minlength=labels)


class GraphTable(Sequence[SaliencyGraph]):
    """S graphs with range, each by its number, or some as a batch.

    sizes (S,) int64: nodes of each; labels: L names, in order; vocabulary: name -> number; scenes: an index of these
    graphs, open, None where there is none.
    """

    scenes: SceneLookup | None = None

    def __init__(self, labels: Sequence[str], count: np.ndarray, label: np.ndarray, edges: np.ndarray) -> None:
        """count (S,) int64, nodes of each graph; label (P,), their numbers; edges (B,) uint8, the bits of each graph's
        edges as in `pack_graph`."""
        self.labels = tuple(labels)
        self.vocabulary = {name: number for number, name in enumerate(labels)}
        self.sizes, self._label, self._edges = count, label, edges
        self._start, self._first_byte = starts(count), starts(_edge_bytes(count))

    def __len__(self) -> int:
        return len(self.sizes)

    @cached_property
    def having(self) -> np.ndarray:
        """(L,) int64: how many graphs have each label."""
        having = np.zeros(len(self.labels), np.int64)
        for low in range(0, len(self), _CHUNK):
            count = self.sizes[low : low + _CHUNK]
            label = self._label[self._start[low] : self._start[low + len(count)]]
            having += count_having(count, label, len(having))
        return having

    @abstractmethod
    def _values(self, nodes: np.ndarray) -> Mapping[str, np.ndarray]:
        """The scores, saliency, centroid_m and size_m of nodes (N,)."""

    def nodes(self, graphs: np.ndarray) -> np.ndarray:
        """(N,) int64 positions of the nodes of graphs (K,) among the nodes of all, graph by graph."""
        return ranges(self._start[graphs], self.sizes[graphs])

    def take(self, graphs: np.ndarray) -> GraphNodes:
        """The graphs of these numbers (K,), one after the other."""
        nodes = self.nodes(graphs)
        return GraphNodes(self.sizes[graphs], self._label[nodes].astype(np.int64), **self._values(nodes))

    def adjacency(self, graphs: np.ndarray) -> np.ndarray:
        """Return which nodes of these graphs are in context, (K, m, m) bool, symmetric, padded to the largest graph."""
        count = self.sizes[graphs][:, None]
        most = count.max(initial=0)
        low, high = np.triu_indices(most, 1)
        known = high < count
        bit = low * (2 * count - low - 1) // 2 + high - low - 1
        byte = self._edges[(self._first_byte[graphs][:, None] + bit // 8)[known]]
        linked = np.zeros((len(graphs), most, most), bool)
        upper = np.zeros(known.shape, bool)
        upper[known] = byte >> (7 - bit[known] % 8) & 1
        linked[:, low, high] = linked[:, high, low] = upper
        return linked


class HeldGraphs(GraphTable):
    """The table of graphs in memory, exact."""

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

    def __getitem__(self, number: int) -> SaliencyGraph:  # type: ignore[override]  # some at once: `batch`
        return self._graphs[number]

    def _values(self, nodes: np.ndarray) -> Mapping[str, np.ndarray]:
        return {name: column[nodes] for name, column in self._columns.items()}


class MappedGraphs(GraphTable):
    """The table of packed graphs in columns on disk, mapped into memory."""

    def __init__(self, rows: Columns, scenes: SceneLookup | None = None) -> None:
        """rows: of `pack_graph`, and whatever else was packed with it. Raises DataError where they are not."""
        try:
            names, nodes, edges = (rows.columns[name] for name in ("labels", "nodes", "edges"))
        except KeyError as error:
            raise DataError(f"{rows.folder} has no column {error}, expected packed graphs") from None
        if names.words is None or (nodes.values.dtype, edges.values.dtype) != (NODE, np.uint8):
            raise DataError(f"{rows.folder} has columns of other types than packed graphs have")
        count = np.diff(names.start)
        super().__init__(names.words, count, names.values, edges.values)
        self._packed, self.scenes = nodes.values, scenes
        if not (np.array_equal(nodes.start, self._start) and np.array_equal(edges.start, self._first_byte)):
            raise DataError(f"{rows.folder} has graphs with more or fewer nodes or edges than labels")

    def __getitem__(self, number: int) -> SaliencyGraph:  # type: ignore[override]  # some at once: `batch`
        if not 0 <= number < len(self):
            raise IndexError(number)
        own, bits = (slice(*start[number : number + 2]) for start in (self._start, self._first_byte))
        labels = np.array([self.labels[i] for i in self._label[own]], np.str_)
        packed = {"labels": labels, "nodes": self._packed[own], "edges": self._edges[bits]}
        return graph_from_arrays(unpack_graph(packed))

    def _values(self, nodes: np.ndarray) -> Mapping[str, np.ndarray]:
        values = unpack_nodes(self._packed[nodes])
        return {name: values[name] for name in ("scores", "saliency", "centroid_m", "size_m")}


def write_graphs(graphs: Iterable[SaliencyGraph], folder: Path) -> None:
    """Write a stream of graphs, packed, to a new folder of columns. Raises DataError as `pack_graph`."""
    write_columns(folder, (pack_graph(graph_to_arrays(graph)) for graph in graphs))


def _edge_bytes(count: np.ndarray) -> np.ndarray:
    """Bytes of the edges of graphs of so many nodes: a bit a pair."""
    return -(-count * (count - 1) // 16)
