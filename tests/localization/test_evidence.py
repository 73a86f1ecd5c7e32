"""Evidence and its weights, against draws of a known softmax and sums by hand."""

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.localization.evidence import Evidence, fit_weights


def test_the_score_of_a_place_sums_its_hypotheses():
    evidence = Evidence(("a", "b", "a"), {"near": np.array([1.0, 2.0, 0.5]), "alike": np.array([0.0, 1.0, 2.0])})
    weights = {"alike": 0.5, "near": 1.0}
    assert evidence.scores(weights) == pytest.approx([1.0, 2.5, 1.5])
    assert evidence.place_scores(weights) == pytest.approx({"a": np.log(np.exp(1.0) + np.exp(1.5)), "b": 2.5})


def test_weights_are_those_that_the_answers_were_drawn_with():
    rng, weights = np.random.default_rng(0), np.array([1.5, -0.7, 0.0])
    samples = []
    for _ in range(4000):
        values = rng.normal(size=(6, 3)) * [1, 2, 5]
        share = np.exp(values @ weights)
        place = rng.choice(6, p=share / share.sum())
        samples.append((Evidence([str(k) for k in range(6)], dict(zip("abc", values.T, strict=True))), str(place)))
    fitted, before, after = fit_weights(samples)
    assert fitted == pytest.approx(dict(zip("abc", weights, strict=True)), abs=0.05)
    assert before == pytest.approx(np.log(6))
    assert after < before


def test_hypotheses_of_one_place_share_its_truth():
    """Two hypotheses of the true place beside one other: alike, its share is two thirds."""
    fitted, before, after = fit_weights([(Evidence(("a", "a", "b"), {"near": np.ones(3)}), "a")])
    assert fitted == pytest.approx({"near": 0.0})
    assert before == pytest.approx(after) == pytest.approx(np.log(1.5))


def test_queries_whose_place_nothing_names_are_left_out():
    known = (Evidence(("a", "b"), {"near": np.array([1.0, 0.0])}), "a")
    unknown = (Evidence(("a", "b"), {"near": np.array([0.0, 1.0])}), "c")
    assert fit_weights([known, unknown]) == fit_weights([known])
    with pytest.raises(DataError, match="contains the true place of its query"):
        fit_weights([unknown])
