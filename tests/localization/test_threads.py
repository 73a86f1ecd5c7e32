"""One open map, asked from several threads at once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from tiny_folder import write_tiny_folder

import salframe

ROUNDS, THREADS = 8, 4


@pytest.mark.parametrize("method", ["proposed", "saliency-graph", "objects"])
def test_threads_get_the_answers_that_one_gets(tmp_path, monkeypatch, method):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    folder = write_tiny_folder(tmp_path / "tiny")
    salframe.build_map(folder, tmp_path / "map", method, overrides=["detector.kind=annotations"])
    opened = salframe.open_map(tmp_path / "map")
    fold = salframe.find_dataset(folder).folds()[0]
    asked = [frame.load() for frame in (*fold.queries, *fold.references)]
    alone = [opened.localize(panorama) for panorama in asked]
    assert any(answer.status.names_a_place for answer in alone)
    with ThreadPoolExecutor(THREADS) as threads:
        answers = list(threads.map(opened.localize, asked * ROUNDS))
    for one, other in zip(alone * ROUNDS, answers, strict=True):
        assert (one.status, one.places) == (other.status, other.places)
        if one.T_world_query is not None:
            np.testing.assert_array_equal(one.T_world_query, other.T_world_query)
