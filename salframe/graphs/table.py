"""Many graphs as columns, their nodes one after the other: in memory, or mapped from a folder that a stream of them was
written to."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np

from salframe.framework.array_files import map_array
from salframe.framework.config import Settings
from salframe.framework.errors import DataError
from salframe.framework.files import new_folder, read_model, write_json
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

_FORMAT = 1
_TABLE, _COUNT, _LABEL, _NODES, _EDGES = "graphs.json", "count.npy", "label.npy", "nodes.npy", "edges.npy"
_CHUNK = 1024
"""So many graphs of a stream are held at once."""


@dataclass(frozen=True, eq=False)
class GraphBatch:
    """K graphs padded to the largest of them, m nodes. count (K,) int64, nodes of each; label (K, m) int64, -1 where
    padded; scores, saliency (K, m), centroid_m (K, m, 3) float64, 0 where padded; size_m (K, m, 3) float64, 1 where
    padded."""

    count: np.ndarray
    label: np.ndarray
    scores: np.ndarray
    saliency: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray

    @property
    def is_node(self) -> np.ndarray:
        """(K, m) bool: not padded."""
        return np.arange(self.label.shape[1]) < self.count[:, None]

    def take(self, graphs: np.ndarray) -> GraphBatch:
        """Some of these graphs, padded to the largest of them."""
        count = self.count[graphs]
        most = count.max(initial=0)
        return GraphBatch(count, *(getattr(self, field.name)[graphs][:, :most] for field in fields(self)[1:]))


def starts(lengths: np.ndarray) -> np.ndarray:
    """(N + 1,) int64: where each of N parts begins, and where the last ends."""
    return np.concatenate([[0], lengths.cumsum(dtype=np.int64)])


def ranges(first: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """(sum of lengths,) int64: as many numbers as each length says, from each of `first` on."""
    begins = starts(lengths)
    return np.repeat(first - begins[:-1], lengths) + np.arange(begins[-1])


class GraphTable(Sequence[SaliencyGraph]):
    """S graphs with range, each by its number, or some as a batch.

    sizes (S,) int64: nodes of each; labels: L names; vocabulary: name -> number; having (L,) int64: how many graphs
    have each label; scenes: an index of these graphs, open, None where there is none.
    """

    scenes: SceneLookup | None = None

    def __init__(
        self, labels: Sequence[str], having: np.ndarray, count: np.ndarray, label: np.ndarray, edges: np.ndarray
    ) -> None:
        """count (S,) int64, nodes of each graph; label (P,), their numbers; edges (B,) uint8, the bits of each graph's
        edges as in `pack_graph`."""
        self.labels, self.having = tuple(labels), having
        self.vocabulary = {name: number for number, name in enumerate(labels)}
        self.sizes, self._label, self._edges = count, label, edges
        self._start, self._first_byte = starts(count), starts(_edge_bytes(count))

    def __len__(self) -> int:
        return len(self.sizes)

    @abstractmethod
    def _values(self, nodes: np.ndarray) -> Mapping[str, np.ndarray]:
        """The scores, saliency, centroid_m and size_m of nodes (N,)."""

    def nodes(self, graphs: np.ndarray) -> np.ndarray:
        """(N,) int64 positions of the nodes of graphs (K,) among the nodes of all, graph by graph."""
        return ranges(self._start[graphs], self.sizes[graphs])

    def batch(self, graphs: np.ndarray) -> GraphBatch:
        """The graphs of these numbers (K,)."""
        count, nodes = self.sizes[graphs], self.nodes(graphs)
        is_node = np.arange(count.max(initial=0)) < count[:, None]
        label = np.full(is_node.shape, -1)
        label[is_node] = self._label[nodes]
        padded = {}
        for name, values in self._values(nodes).items():
            padded[name] = np.full((*is_node.shape, *values.shape[1:]), float(name == "size_m"))
            padded[name][is_node] = values
        return GraphBatch(count, label, **padded)

    def adjacency(self, graphs: np.ndarray) -> np.ndarray:
        """(K, m, m) bool, symmetric: which nodes of a batch of these graphs are in context."""
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
        super().__init__(labels, _having(count, label, len(labels)), count, label, edges)
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
    """The table of the graphs that `write_graphs` wrote, to the rounding of `pack_graph`."""

    def __init__(self, folder: Path, scenes: SceneLookup | None = None) -> None:
        """Map what is in a folder into memory. Raises DataError where there are no graphs, of another format, or not
        whole."""
        if not (folder / _TABLE).exists():
            raise DataError(f"{folder} holds no graphs: write them with write_graphs")
        table = read_model(folder / _TABLE, _Table)
        if table.format != _FORMAT:
            raise DataError(f"{folder} has graphs of format {table.format}, expected {_FORMAT}: write them again")
        try:
            count, label, self._packed, edges = (
                np.asarray(map_array(folder / name)) for name in (_COUNT, _LABEL, _NODES, _EDGES)
            )
        except (OSError, ValueError) as error:
            raise DataError(f"{folder} is not whole ({error}): write the graphs again") from None
        kinds = (count.dtype.kind, label.dtype.kind, self._packed.dtype, edges.dtype)
        if kinds != ("u", "u", NODE, np.uint8):
            raise DataError(f"{folder} has columns of other types than write_graphs writes: write the graphs again")
        super().__init__(table.labels, np.array(table.having, np.int64), count.astype(np.int64), label, edges)
        lengths = (len(label), len(self._packed), len(edges), len(table.having))
        if lengths != (self._start[-1], self._start[-1], self._first_byte[-1], len(table.labels)):
            raise DataError(f"{folder} has columns of other lengths than {_COUNT} says: write the graphs again")
        self.scenes = scenes

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


class _Table(Settings):
    """graphs.json: the labels in the order of their numbers, and how many graphs have each."""

    format: int
    labels: tuple[str, ...]
    having: tuple[int, ...]


def write_graphs(graphs: Iterable[SaliencyGraph], folder: Path) -> None:
    """Write a stream of graphs to a new folder, which appears whole; memory does not grow with their number. Raises
    ConfigError where the folder is there, DataError as `pack_graph`."""
    vocabulary: dict[str, int] = {}
    having = np.zeros(0, np.int64)
    with new_folder(folder) as parts:
        with (
            _Column(parts / _COUNT, np.dtype("<u2")) as counts,
            _Column(parts / _LABEL, np.dtype("<u2")) as labels,
            _Column(parts / _NODES, NODE) as nodes,
            _Column(parts / _EDGES, np.dtype("u1")) as edges,
        ):
            for chunk in _chunks(graphs):
                packed = [pack_graph(graph_to_arrays(graph)) for graph in chunk]
                count = np.array([len(graph) for graph in chunk])
                number = [vocabulary.setdefault(name, len(vocabulary)) for graph in chunk for name in graph.labels]
                label = np.array(number, np.int64)
                having = np.concatenate([having, np.zeros(len(vocabulary) - len(having), np.int64)])
                having += _having(count, label, len(vocabulary))
                counts.append(count)
                labels.append(label)
                nodes.append(np.concatenate([one["nodes"] for one in packed]))
                edges.append(np.concatenate([one["edges"] for one in packed]))
        content = {"format": _FORMAT, "labels": list(vocabulary), "having": having.tolist()}
        write_json(parts / _TABLE, content)


class _Column:
    """A .npy file of one dimension that is written piece by piece. Raises DataError on numbers that its type does not
    hold."""

    def __init__(self, path: Path, dtype: np.dtype) -> None:
        self._path, self._dtype, self._length = path, dtype, 0

    def __enter__(self) -> _Column:
        self._file: BinaryIO = self._path.open("wb")
        self._write_header()
        return self

    def append(self, values: np.ndarray) -> None:
        if self._dtype.kind == "u" and values.max(initial=0) > np.iinfo(self._dtype).max:
            raise DataError(f"{self._path.stem} of {values.max()}, expected at most {np.iinfo(self._dtype).max}")
        values.astype(self._dtype).tofile(self._file)
        self._length += len(values)

    def _write_header(self) -> None:
        shape = (self._length,)
        header = {"descr": np.lib.format.dtype_to_descr(self._dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(self._file, header)

    def __exit__(self, *_: object) -> None:
        self._file.seek(0)
        self._write_header()  # numpy leaves room for the length to grow
        self._file.close()


def _chunks(graphs: Iterable[SaliencyGraph]) -> Iterator[list[SaliencyGraph]]:
    stream = iter(graphs)
    while chunk := list(islice(stream, _CHUNK)):
        yield chunk


def _having(count: np.ndarray, label: np.ndarray, labels: int) -> np.ndarray:
    """(L,) int64 how many graphs have each label, of graphs of `count` nodes each and their labels one after the
    other."""
    graph = np.repeat(np.arange(len(count)), count)
    return np.bincount(np.unique(graph * labels + label) % max(labels, 1), minlength=labels)


def _edge_bytes(count: np.ndarray) -> np.ndarray:
    """Bytes of the edges of graphs of so many nodes: a bit a pair."""
    return -(-count * (count - 1) // 16)
