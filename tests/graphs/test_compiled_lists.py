"""Compiled lists against the definition, object by object, and against inverted lists."""

import hashlib
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from salframe_graphs.retrieval import kernel_cache
from salframe_graphs.retrieval.compiled_lists import GEOMETRY_WEIGHT, MAX_VERIFIED, CompiledLists
from salframe_graphs.retrieval.inverted_lists import InvertedLists
from salframe_graphs.retrieval.postings import POSITION_M
from scene_scores import list_scores, pose_scores, refurnished, similarity, some_graph, turned

from salframe.framework.errors import DataError
from salframe.graphs.graph import SaliencyGraph, without_range
from salframe.graphs.synthetic_map import SyntheticMap
from salframe.panoramas.geometry import pose_2d, transform_points
from salframe.testing.expectations import same

pytest.importorskip("numba")
MANY = 20_000
"""More scenes than the kernel scores at a time, and than are verified."""


def built(component, graphs, folder, **settings):
    index = component(component.Config(**settings))
    index.build(iter(graphs), folder)
    index.open(folder)
    return index


def rooms(count, seed=1):
    rng = np.random.default_rng(seed)
    found = (some_graph(rng, 10) for _ in range(10 * count))
    return tuple([graph for graph in found if len(graph) >= 6][:count])


@pytest.fixture(scope="module")
def synthetic_map():
    return SyntheticMap(2, rooms(40))


@pytest.fixture(scope="module")
def folders(synthetic_map, tmp_path_factory):
    """The folders of a compiled and of an inverted index of MANY scenes."""
    folder = tmp_path_factory.mktemp("indexes")
    graphs = [*synthetic_map.scenes(MANY)]
    CompiledLists().build(graphs, folder / "compiled")
    InvertedLists().build(graphs, folder / "inverted")
    return folder


def opened(component, folder, **settings):
    index = component(component.Config(**settings))
    index.open(folder)
    return index


def test_the_score_is_that_of_the_lists_and_of_the_best_pose(tmp_path):
    rng = np.random.default_rng(3)
    room_of = [some_graph(rng, 7) for _ in range(20)]
    graphs = [refurnished(room_of[number % 20], rng) for number in range(200)]
    index, differs, posed = built(CompiledLists, graphs, tmp_path / "index"), [], 0
    for number in range(40):
        query = turned(refurnished(graphs[number], rng), rng)
        few = [np.count_nonzero(similarity(query, graph) >= 0.1) <= 16 for graph in graphs]  # all make hypotheses
        geometry = pose_scores(query, graphs)
        found = index.candidates(query, len(graphs))
        score = np.zeros(len(graphs))
        score[found.scene] = found.score
        differs.extend(np.abs(score - list_scores(query, graphs) - GEOMETRY_WEIGHT * geometry)[few] > 0.02)
        posed += np.count_nonzero(geometry > 0.05)
    assert posed > 200
    assert np.mean(differs) < 0.001  # rounded similarities decide between two poses, or are just below the minimum


def test_an_object_of_the_scene_is_explained_once(tmp_path):
    """The query has the scene's chair twice: of both sides the smaller sum counts, of the lists and under the pose."""
    x_m, y_m = POSITION_M[[90, 170]]

    def graph(*labels):
        centroid_m = np.array([(x_m, y_m, 0.3) if label == "table" else (y_m, x_m, -0.2) for label in labels])
        ones = np.ones(len(labels))
        return SaliencyGraph(labels, ones, ones, centroid_m, np.ones((len(labels), 3)), ones, np.zeros((0, 2), int))

    index = built(CompiledLists, [graph("table", "chair")], tmp_path / "index")
    for query in (graph("table", "chair", "chair"), turned(graph("chair", "table", "chair"), np.random.default_rng(0))):
        jaccard = 2 / (3 + 2 - 2)  # every label is in the only scene: rarity 1
        assert index.candidates(query, 1).score == pytest.approx([jaccard + GEOMETRY_WEIGHT * jaccard])


def test_of_the_same_objects_those_that_stand_alike_come_first(tmp_path):
    """All scenes have the same objects, shuffled; the lists cannot tell them apart."""
    rng = np.random.default_rng(4)
    room = rooms(1)[0]
    graphs = []
    for _ in range(50):
        centroid_m = room.centroid_m.copy()
        centroid_m[:, :2] = rng.uniform(-4, 4, (len(room), 2))
        graphs.append(replace(room, centroid_m=centroid_m, bearing=None))
    index = built(CompiledLists, graphs, tmp_path / "index")
    for scene in range(50):
        seen_m = transform_points(pose_2d(1.5, -0.7, 2.0), graphs[scene].centroid_m)
        query = replace(graphs[scene], centroid_m=seen_m, bearing=None)
        assert index.candidates(query, 1).scene.tolist() == [scene]
        far_m = transform_points(pose_2d(9.0, 0.0, 0.0), graphs[scene].centroid_m)  # beyond max_shift_m
        query = replace(graphs[scene], centroid_m=far_m, bearing=None)
        assert index.candidates(query, 50).score[0] < 1 + GEOMETRY_WEIGHT / 2


@pytest.mark.parametrize("count", [1, 100, MAX_VERIFIED, MANY])
def test_without_range_the_candidates_are_those_of_inverted_lists(folders, synthetic_map, count):
    compiled, inverted = opened(CompiledLists, folders / "compiled"), opened(InvertedLists, folders / "inverted")
    for number in range(0, MANY, 1500):
        query = without_range(synthetic_map.query(number))
        assert same(compiled.candidates(query, count), inverted.candidates(query, count))


@pytest.mark.parametrize("count", [3, 100, 3000])
def test_where_no_pose_is_near_enough_the_candidates_are_those_of_inverted_lists(folders, synthetic_map, count):
    compiled = opened(CompiledLists, folders / "compiled", max_shift_m=1e-9)
    inverted = opened(InvertedLists, folders / "inverted")
    for number in range(0, MANY, 1500):
        assert same(
            compiled.candidates(synthetic_map.query(number), count),
            inverted.candidates(synthetic_map.query(number), count),
        )


def test_fewer_candidates_are_the_first_of_more_than_are_verified(folders, synthetic_map):
    compiled = opened(CompiledLists, folders / "compiled")
    for number in range(0, MANY, 4000):
        more = compiled.candidates(synthetic_map.query(number), 2 * MAX_VERIFIED)
        assert len(more) == 2 * MAX_VERIFIED
        assert (np.diff(more.score) <= 0).all()
        few = compiled.candidates(synthetic_map.query(number), 50)
        assert few.scene.tolist() == more.scene[:50].tolist()


def test_the_scene_of_a_query_comes_first_more_often_than_in_inverted_lists(folders, synthetic_map):
    compiled, inverted = opened(CompiledLists, folders / "compiled"), opened(InvertedLists, folders / "inverted")
    numbers = np.random.default_rng(0).permutation(MANY)[:100].tolist()
    first = {
        index: np.mean([index.candidates(synthetic_map.query(number), 1).scene[0] == number for number in numbers])
        for index in (compiled, inverted)
    }
    assert first[compiled] > 0.9
    assert first[compiled] > first[inverted] + 0.1


@pytest.mark.parametrize(
    "settings",
    [{"height_scale_m": 1.0}, {"size_scale": (0.2, 0.2)}, {"tolerance_m": 1.0}, {"tolerance_share": 0.3},
     {"max_shift_m": 0.3}],
)  # fmt: skip
def test_every_setting_changes_the_candidates(folders, synthetic_map, settings):
    default = opened(CompiledLists, folders / "compiled")
    other = opened(CompiledLists, folders / "compiled", **settings)
    assert not same(other.candidates(synthetic_map.query(5), 100), default.candidates(synthetic_map.query(5), 100))


def test_an_index_without_positions_is_refused(folders):
    with pytest.raises(DataError, match="no positions"):
        opened(CompiledLists, folders / "inverted")


def test_a_query_does_not_compile(folders, synthetic_map):
    index = opened(CompiledLists, folders / "compiled")
    kernels = kernel_cache.load_kernels()
    compiled = [*kernels.scan_lists.signatures, *kernels.verify_scenes.signatures]
    index.candidates(synthetic_map.query(3), 100)
    index.candidates(without_range(synthetic_map.query(3)), 5000)
    assert [*kernels.scan_lists.signatures, *kernels.verify_scenes.signatures] == compiled


def test_the_key_of_the_kernels_is_their_text(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    one, edited, same_text = (tmp_path / name for name in ("one.py", "edited.py", "same.py"))
    one.write_text("LIMIT = 1\n")
    edited.write_text("LIMIT = 2\n")
    same_text.write_text("LIMIT = 1\n")
    folder = kernel_cache.kernel_folder(one)
    assert folder == tmp_path / "cache" / "kernels" / hashlib.sha256(b"LIMIT = 1\n").hexdigest()
    assert kernel_cache.kernel_folder(edited) != folder
    assert kernel_cache.kernel_folder(same_text) == folder
    one.write_text("LIMIT = 10\n")
    assert kernel_cache.kernel_folder(one) != folder


OPEN = """
import sys
from pathlib import Path
from salframe_graphs.retrieval.compiled_lists import CompiledLists
from salframe_graphs.retrieval.kernel_cache import load_kernels
CompiledLists().open(Path(sys.argv[1]))
kernels = (load_kernels().scan_lists, load_kernels().verify_scenes)
print(*(sum(kernel.stats.cache_hits.values()) for kernel in kernels), *(len(kernel.signatures) for kernel in kernels))
"""


def hits(folder, cache):
    """What a process read from the cache of each of two kernels, and in how many versions it has them."""
    environment = {**os.environ, "SALFRAME_CACHE": str(cache)}
    done = subprocess.run([sys.executable, "-c", OPEN, folder], env=environment, capture_output=True, text=True)
    assert done.stderr == ""
    return [int(number) for number in done.stdout.split()]


@pytest.fixture(scope="module")
def cache(folders, tmp_path_factory):
    """A cache folder with the kernels as a process compiled them."""
    cache = tmp_path_factory.mktemp("cache")
    assert hits(folders / "compiled", cache) == [0, 0, 1, 1]
    return cache


def test_a_second_process_does_not_compile_again(folders, cache):
    assert hits(folders / "compiled", cache) == [1, 1, 1, 1]


def test_a_damaged_cache_is_replaced(folders, cache, tmp_path):
    copied = shutil.copytree(cache, tmp_path / "cache")
    for path in copied.rglob("*.nbc"):
        path.write_bytes(path.read_bytes()[:50])
    assert hits(folders / "compiled", copied)[2:] == [1, 1]
    assert all(path.stat().st_size > 50 for path in copied.rglob("*.nbc"))


def test_without_a_cache_folder_it_compiles_in_memory(folders):
    assert hits(folders / "compiled", os.devnull) == [0, 0, 1, 1]
