"""Tables of graphs against the graphs themselves."""

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.framework.files.columns import read_columns, write_columns
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays, pack_graph, unpack_graph
from salframe.graphs.table import MappedGraphs, MemoryGraphs, write_graphs
from salframe.testing.expectations import same


def some_graph(rng):
    """Of up to 12 objects, none among them."""
    count = int(rng.integers(0, 13))
    pairs = np.column_stack(np.triu_indices(count, 1))
    return SaliencyGraph(
        tuple(rng.choice(["bed", "lamp", "chair", "vase"], count).tolist()),
        rng.uniform(0, 1, count),
        rng.dirichlet(np.ones(count)) if count else np.zeros(0),
        rng.normal(0, 3, (count, 3)),
        rng.uniform(0.1, 3, (count, 3)),
        rng.uniform(0, np.pi, count),
        pairs[rng.random(len(pairs)) < 0.3],
    )


@pytest.fixture(scope="module")
def graphs():
    rng = np.random.default_rng(4)
    return [some_graph(rng) for _ in range(60)]


@pytest.fixture(scope="module")
def mapped(graphs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("table") / "graphs"
    write_graphs(iter(graphs), folder)
    return MappedGraphs(read_columns(folder))


def test_graphs_come_back_as_packing_rounds_them(graphs, mapped):
    assert len(mapped) == len(graphs)
    for kept, graph in zip(mapped, graphs, strict=True):
        assert same(kept, graph_from_arrays(unpack_graph(pack_graph(graph_to_arrays(graph)))))
    assert list(MemoryGraphs(graphs)) == graphs
    with pytest.raises(IndexError):
        mapped[len(graphs)]


@pytest.mark.parametrize("held", [True, False])
def test_adjacency_is_padded_to_the_largest_graph(graphs, mapped, held):
    table, numbers = MemoryGraphs(graphs) if held else mapped, np.array([5, 0, 17, 3])
    linked = table.adjacency(numbers)
    assert linked.shape[1] == max(len(graphs[number]) for number in numbers)
    for graph, of_graph in zip((table[number] for number in numbers.tolist()), linked, strict=True):
        np.testing.assert_array_equal(of_graph[: len(graph), : len(graph)], graph.adjacency)
        assert not of_graph[len(graph) :].any()


@pytest.mark.parametrize("held", [True, False])
def test_nodes_are_taken_graph_by_graph(graphs, mapped, held):
    table, numbers = MemoryGraphs(graphs) if held else mapped, np.array([5, 0, 17, 3])
    chosen, nodes = [table[number] for number in numbers.tolist()], table.take(numbers)
    assert nodes.count.tolist() == [len(graph) for graph in chosen]
    assert [table.labels[i] for i in nodes.label] == [label for graph in chosen for label in graph.labels]
    for name in ("scores", "saliency", "centroid_m", "size_m"):
        expected = np.concatenate([getattr(graph, name) for graph in chosen])
        np.testing.assert_array_equal(getattr(nodes, name), expected)


@pytest.mark.parametrize("held", [True, False])
def test_labels_are_counted_once_a_graph(graphs, mapped, held):
    table = MemoryGraphs(graphs) if held else mapped
    assert table.num_graphs_by_label.tolist() == [
        sum(name in graph.labels for graph in graphs) for name in table.labels
    ]


def test_tables_of_no_graphs_and_of_empty_ones(tmp_path):
    empty = next(graph for graph in map(some_graph, map(np.random.default_rng, range(100))) if not len(graph))
    write_graphs([empty, empty], tmp_path / "graphs")
    for table in (MemoryGraphs([]), MemoryGraphs([empty, empty]), MappedGraphs(read_columns(tmp_path / "graphs"))):
        every = np.arange(len(table))
        assert len(table.take(every)) == 0
        assert table.adjacency(every).shape == (len(table), 0, 0)
        assert table.num_graphs_by_label.tolist() == []
    assert len(table) == 2


def packed(graph):
    return pack_graph(graph_to_arrays(graph))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda row: {"labels": row["labels"], "nodes": row["nodes"]},
            "has no column 'edges', which the graphs of a map need",
        ),
        (lambda row: {**row, "labels": np.arange(len(row["labels"]))}, "have columns of wrong types"),
        (lambda row: {**row, "nodes": row["nodes"]["saliency"]}, "have columns of wrong types"),
        (lambda row: {**row, "nodes": row["nodes"][1:]}, "columns of nodes, edges and labels do not match"),
        (lambda row: {**row, "edges": row["edges"][1:]}, "columns of nodes, edges and labels do not match"),
    ],
)
def test_columns_of_something_else_are_refused(graphs, tmp_path, change, message):
    write_columns(tmp_path / "graphs", [change(packed(graph)) for graph in graphs])
    with pytest.raises(DataError, match=message):
        MappedGraphs(read_columns(tmp_path / "graphs"))
