"""Tables of graphs against the graphs themselves."""

import json

import numpy as np
import pytest

from salframe.framework.errors import ConfigError, DataError
from salframe.graphs import table as tables
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays, pack_graph, unpack_graph
from salframe.graphs.table import HeldGraphs, MappedGraphs, write_graphs
from salframe.testing.asking import same


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
    return MappedGraphs(folder)


def test_graphs_come_back_as_packing_rounds_them(graphs, mapped):
    assert len(mapped) == len(graphs)
    for kept, graph in zip(mapped, graphs, strict=True):
        assert same(kept, graph_from_arrays(unpack_graph(pack_graph(graph_to_arrays(graph)))))
    assert list(HeldGraphs(graphs)) == graphs
    with pytest.raises(IndexError):
        mapped[len(graphs)]


@pytest.mark.parametrize("held", [True, False])
def test_a_batch_holds_what_its_graphs_do(graphs, mapped, held):
    table, numbers = HeldGraphs(graphs) if held else mapped, np.array([5, 0, 17, 3])
    batch, linked = table.batch(numbers), table.adjacency(numbers)
    assert batch.label.shape == (4, max(len(graphs[number]) for number in numbers))
    for k, number in enumerate(numbers):
        graph, nodes = table[int(number)], batch.count[k]
        assert [table.labels[i] for i in batch.label[k, :nodes]] == list(graph.labels)
        for name, empty in (("scores", 0), ("saliency", 0), ("centroid_m", 0), ("size_m", 1)):
            np.testing.assert_array_equal(getattr(batch, name)[k, :nodes], getattr(graph, name))
            assert (getattr(batch, name)[k, nodes:] == empty).all()
        assert (batch.label[k, nodes:] == -1).all()
        np.testing.assert_array_equal(linked[k, :nodes, :nodes], graph.adjacency)
        assert not linked[k, nodes:].any()
    few = batch.take(np.array([False, True, False, True]))
    assert few.label.shape == (2, max(len(graphs[0]), len(graphs[3])))
    np.testing.assert_array_equal(few.count, [len(graphs[0]), len(graphs[3])])


@pytest.mark.parametrize("held", [True, False])
def test_labels_are_counted_once_a_graph(graphs, mapped, held):
    table = HeldGraphs(graphs) if held else mapped
    assert table.having.tolist() == [sum(name in graph.labels for graph in graphs) for name in table.labels]


def test_a_table_is_the_same_written_in_pieces(graphs, mapped, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "_CHUNK", 7)
    write_graphs(iter(graphs), tmp_path / "graphs")
    assert all(map(same, MappedGraphs(tmp_path / "graphs"), mapped))


def test_tables_of_no_graphs_and_of_empty_ones(tmp_path):
    empty = next(graph for graph in map(some_graph, map(np.random.default_rng, range(100))) if not len(graph))
    for graphs in ([], [empty, empty]):
        write_graphs(graphs, tmp_path / str(len(graphs)))
        for table in (HeldGraphs(graphs), MappedGraphs(tmp_path / str(len(graphs)))):
            assert len(table) == len(graphs)
            assert table.batch(np.arange(len(graphs))).label.shape == (len(graphs), 0)
            assert table.adjacency(np.arange(len(graphs))).shape == (len(graphs), 0, 0)


def test_what_is_not_a_whole_table_is_refused(graphs, tmp_path):
    folder = tmp_path / "graphs"
    write_graphs(graphs, folder)
    with pytest.raises(ConfigError, match="there already"):
        write_graphs(graphs, folder)
    content = json.loads((folder / "graphs.json").read_text())
    (folder / "graphs.json").write_text(json.dumps({**content, "format": 0}))
    with pytest.raises(DataError, match="format 0, expected 1"):
        MappedGraphs(folder)
    (folder / "graphs.json").write_text(json.dumps(content))
    np.save(folder / "count.npy", np.load(folder / "count.npy")[:-1])
    with pytest.raises(DataError, match="other lengths"):
        MappedGraphs(folder)
    np.save(folder / "count.npy", np.zeros(len(graphs)))
    with pytest.raises(DataError, match="other types"):
        MappedGraphs(folder)
    (folder / "edges.npy").unlink()
    with pytest.raises(DataError, match="not whole"):
        MappedGraphs(folder)
    with pytest.raises(DataError, match="holds no graphs"):
        MappedGraphs(tmp_path / "elsewhere")
