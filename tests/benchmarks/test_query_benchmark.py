"""A query of `proposed` after its graph: compiled by numba the same answers in two thirds of the time, and those of
matching all places and panoramas."""

import os
from pathlib import Path

import numpy as np
import pytest
from query_time import SIDES, asked, milliseconds
from salframe_graphs import compilation

pytestmark = pytest.mark.slow
REAL = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")) / "matterport3d"
FEW = ["candidates=6", "matcher.most=20"]
"""Candidates of a small map: it is asked through the scene index, as large ones are."""


@pytest.fixture(scope="module", params=[("house-12", FEW), ("house-42", []), (str(REAL), [])], ids=lambda p: p[0][-9:])
def built(request):
    pytest.importorskip("numba")
    data, settings = request.param
    if data == str(REAL) and not REAL.is_dir():
        pytest.skip(f"no real buildings at {REAL} (set SALFRAME_SHARED_DATA)")
    return asked(data, settings)


def test_both_give_the_same_answers(built, monkeypatch):
    known, queries = built
    for query in queries:
        answers = []
        for side in SIDES.values():
            monkeypatch.setattr(compilation, "compiled", side)
            answers.append(known.answer(query))
        plain, fast = answers
        assert plain.status == fast.status
        assert [place.frame for place in plain.places] == [place.frame for place in fast.places]
        scores, probabilities = (
            np.array([[getattr(place, name) for place in answer.places] for answer in answers], float)
            for name in ("score", "probability")
        )
        np.testing.assert_allclose(*scores, atol=2e-5)
        np.testing.assert_allclose(*probabilities, atol=1e-6)
        if plain.T_world_query is not None:
            np.testing.assert_allclose(plain.T_world_query, fast.T_world_query, atol=1e-6)
            np.testing.assert_allclose(plain.covariance, fast.covariance, rtol=1e-5, atol=1e-9)


def test_compiled_takes_two_thirds_of_the_time_at_most(built):
    ms = milliseconds(*built)
    assert ms["compiled"].mean() < 2 / 3 * ms["numpy"].mean()


@pytest.mark.parametrize("data", ["house-42", "house-106"])
def test_the_candidates_hold_what_matching_all_finds(data):
    """Of at most one query of 500 the first place is another."""
    answers = []
    for settings in ([], ["candidates=100000", "matcher.most=null"]):
        known, queries = asked(data, settings)
        answers.append([[place.place for place in known.answer(query).places[:1]] for query in queries])
    assert sum(one != other for one, other in zip(*answers, strict=True)) <= len(queries) / 500
