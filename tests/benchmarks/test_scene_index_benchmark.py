"""The cost of a scene index at 1,000, 10,000 and 100,000 scenes in processor time, memory and bytes, and how often the
true scene is among its candidates. `make benchmark`; with `-s` it prints a row per size."""

import time
from collections import deque

import numpy as np
import pytest
from house_map import map_of_houses
from salframe_graphs.retrieval.compiled_lists import CompiledLists
from salframe_graphs.retrieval.inverted_lists import InvertedLists

from salframe.framework.components.installation import folder_bytes

pytestmark = pytest.mark.slow
QUERIES, CANDIDATES = 200, 100
MAX_MEDIAN_MS = {"inverted-lists": 5, "compiled-lists": 10}
MIN_FIRST = {"inverted-lists": 0.7, "compiled-lists": 0.9}
"""Minimum share of queries whose scene comes first."""


@pytest.fixture(scope="module")
def synthetic_map():
    return map_of_houses(3)


def _seconds(function, *arguments):
    start = time.process_time()
    function(*arguments)
    return time.process_time() - start


@pytest.mark.parametrize(
    ("component", "count"),
    [(InvertedLists, 1_000), (InvertedLists, 10_000), (CompiledLists, 10_000), (CompiledLists, 100_000)],
)
def test_a_query(component, count, synthetic_map, tmp_path):
    if component is CompiledLists:
        pytest.importorskip("numba")
    index, folder = component(), tmp_path / "index"
    making_s = _seconds(deque, synthetic_map.scenes(count), 0)
    build_s = _seconds(index.build, synthetic_map.scenes(count), folder) - making_s
    open_s = _seconds(index.open, folder)
    seconds, rank = [], []
    for number in np.random.default_rng(0).integers(0, count, QUERIES).tolist():
        query = synthetic_map.query(number)
        start = time.process_time()
        found = index.candidates(query, CANDIDATES)
        seconds.append(time.process_time() - start)
        rank.append(int(np.argmax(found.scene == number)) if number in found.scene else count)
    median_ms, p95_ms = 1e3 * np.percentile(seconds, [50, 95])
    first, among = (float(np.mean(np.array(rank) < best)) for best in (1, CANDIDATES))
    size = folder_bytes(folder) / count
    print(
        f"\n{component.name}, {count} scenes: build {build_s:.2f} s, {size:.1f} B per scene, "
        f"open {1e3 * open_s:.1f} ms, query {median_ms:.2f} / {p95_ms:.2f} ms, "
        f"true scene first: {first:.3f}, among {CANDIDATES}: {among:.3f}"
    )
    assert size < 100
    assert first > MIN_FIRST[component.name]
    assert among > 0.97
    assert median_ms < MAX_MEDIAN_MS[component.name]
