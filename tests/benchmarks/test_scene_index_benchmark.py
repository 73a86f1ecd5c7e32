"""What a scene index costs at 1,000, 10,000 and 100,000 scenes, in processor time, memory and bytes, and how often the
true scene is among its candidates. `make benchmark`; with `-s` it prints a row a size."""

import time
from collections import deque

import numpy as np
import pytest
from city import city_of_houses
from salframe_graphs import compilation
from salframe_graphs.retrieval.inverted_lists import InvertedLists

from salframe.framework.installation import folder_bytes

pytestmark = pytest.mark.slow
QUERIES = 200


@pytest.fixture(scope="module")
def city():
    return city_of_houses(3)


@pytest.fixture(scope="module", params=[1_000, 10_000, 100_000])
def built(request, city, tmp_path_factory):
    """How many scenes, the folder of their index, and the processor time that building took beside making scenes."""
    count, folder = request.param, tmp_path_factory.mktemp("city") / "index"
    making = _seconds(deque, city.scenes(count), 0)
    return count, folder, _seconds(InvertedLists().build, city.scenes(count), folder) - making


def _seconds(function, *given):
    start = time.process_time()
    function(*given)
    return time.process_time() - start


@pytest.mark.parametrize("compiled", [True, False])
def test_a_query(built, city, compiled, monkeypatch):
    if compiled:
        pytest.importorskip("numba")
    else:
        monkeypatch.setattr(compilation, "compiled", lambda module: None)
    count, folder, build_s = built
    index = InvertedLists()
    open_s = _seconds(index.open, folder)
    asked = np.random.default_rng(0).integers(0, count, QUERIES)
    index.candidates(city.query(0), 500)  # imports numba and compiles
    seconds, rank = [], []
    for number in asked.tolist():
        query = city.query(number)
        start = time.process_time()
        found = index.candidates(query, 500)
        seconds.append(time.process_time() - start)
        rank.append(int(np.argmax(found.scene == number)) if number in found.scene else count)
    median_ms, late_ms = 1e3 * np.percentile(seconds, [50, 95])
    within = {best: np.mean(np.array(rank) < best) for best in (1, 50, 500)}
    size = folder_bytes(folder) / count
    print(
        f"\n{count} scenes{', compiled' if compiled else ''}: build {build_s:.2f} s, {size:.1f} B a scene, "
        f"open {1e3 * open_s:.1f} ms, query {median_ms:.2f} / {late_ms:.2f} ms, true scene "
        + ", ".join(f"among {best}: {share:.3f}" for best, share in within.items())
    )
    assert size < 80
    assert within[50] >= 0.9
    assert within[500] >= 0.99
    assert median_ms < (10 if compiled else 25)
