"""From scores to probabilities: closed forms, and parameters that are known."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.errors import ConfigError, DataError
from salframe.framework.validation import validate
from salframe.localization.answers import Localization, RankedPlace
from salframe.localization.posterior import (
    Head,
    Posterior,
    ScoredAnswer,
    fit_posterior,
    head_features,
    read_fitted,
    shares,
)

NEUTRAL = {"bias": 0.0, "top_score": 0.0, "top_probability": 0.0, "margin": 0.0, "log_objects": 0.0}


def posterior(temperature=2.0, max_out_of_map_probability=0.5, **head):
    return Posterior(
        temperature=temperature, head=Head(**{**NEUTRAL, **head}), max_out_of_map_probability=max_out_of_map_probability
    )


def answer(*scores, status="ok"):
    places = tuple(RankedPlace(f"f{i}", f"p{i}", score) for i, score in enumerate(scores))
    return Localization(places, np.eye(4) if status == "ok" else None, status)


def test_probabilities_are_shares_times_here():
    found = posterior(bias=np.log(3)).apply(answer(4.0, 2.0))
    share = np.e / (1 + np.e)  # the scores differ by one temperature
    assert [place.probability for place in found.places] == pytest.approx([0.75 * share, 0.75 * (1 - share)])
    assert found.out_of_map_probability == pytest.approx(0.25)
    assert found.status == "ok"
    assert (found.T_world_query == np.eye(4)).all()


def test_features_of_the_head():
    scores = np.array([5.0, 2.0, 1.0])
    share = np.exp(scores) / np.exp(scores).sum()
    np.testing.assert_allclose(shares(scores, 1.0), share)
    assert head_features(scores, share, 6) == pytest.approx([5.0, share[0], 3.0, np.log(7)])
    assert head_features(scores[:1], np.ones(1), 0) == pytest.approx([5.0, 1.0, 5.0, 0.0])
    for name, value in (("top_score", 4.0), ("margin", 2.0), ("log_objects", np.log(9))):
        found = posterior(**{name: 0.1}).apply(answer(4.0, 2.0), objects=8)
        assert 1 - found.out_of_map_probability == pytest.approx(1 / (1 + np.exp(-0.1 * value)))


def test_an_answer_that_is_not_here_loses_its_pose_and_keeps_its_places():
    found = posterior(bias=-1.0).apply(answer(4.0, 2.0))
    assert (found.status, found.T_world_query, len(found.places)) == ("out-of-map", None, 2)
    assert posterior(bias=-1.0, max_out_of_map_probability=0.8).apply(answer(4.0, 2.0)).status == "ok"


def test_failures_stay_what_they_are():
    nothing = Localization((), None, "no-objects")
    assert posterior().apply(nothing) is nothing
    refused = posterior(bias=-9.0).apply(answer(1.0, status="low-score"))
    assert refused.status == "low-score"


def test_far_scores_do_not_overflow():
    found = posterior(temperature=1e-3, top_score=1e3).apply(answer(1e4, -1e4))
    assert [place.probability for place in found.places] == [1.0, 0.0]


def drawn(count, temperature, head, seed):
    """Answers whose truth is drawn from the very model."""
    rng = np.random.default_rng(seed)
    truth = posterior(temperature, **head)
    weights = np.array(
        [getattr(truth.head, name) for name in ("top_score", "top_probability", "margin", "log_objects")]
    )
    for _ in range(count):
        scores = np.sort(rng.normal(0, 3, rng.integers(2, 8)))[::-1]
        objects = int(rng.integers(1, 30))
        share = np.exp(scores / temperature) / np.exp(scores / temperature).sum()
        logit = truth.head.bias + head_features(scores, share, objects) @ weights
        here = bool(rng.uniform() < 1 / (1 + np.exp(-logit)))
        yield ScoredAnswer(scores, int(rng.choice(len(scores), p=share)) if here else None, here, objects)


def test_a_fit_recovers_what_the_answers_were_drawn_from():
    head = {"bias": -2.0, "top_score": 0.3, "top_probability": 1.0, "margin": 0.2, "log_objects": 0.5}
    found = fit_posterior(list(drawn(6000, 1.7, head, seed=0)))
    assert found.posterior.temperature == pytest.approx(1.7, rel=0.05)
    true = posterior(1.7, **head)
    fresh = [answer(*a.scores.tolist(), status="no-pose") for a in drawn(300, 1.7, head, seed=1)]
    here = np.array([[1 - one.apply(a, 10).out_of_map_probability for a in fresh] for one in (true, found.posterior)])
    assert np.abs(here[0] - here[1]).mean() < 0.03
    assert found.place_nll_after < found.place_nll_before
    assert found.here_nll_after < found.here_nll_before


def test_a_fit_is_the_same_for_the_same_answers():
    answers = list(drawn(200, 1.0, {}, seed=2))
    assert fit_posterior(answers) == fit_posterior(answers)


def test_answers_that_can_be_told_apart_have_finite_weights():
    answers = [ScoredAnswer(np.array([9.0, 1.0]), 0, True, 5)] * 9 + [
        ScoredAnswer(np.array([2.0, 1.9]), None, False, 5)
    ] * 9
    found = fit_posterior([*answers, ScoredAnswer(np.array([9.0, 2.0]), 0, True, 5)])
    assert np.isfinite([*found.posterior.head.model_dump().values()]).all()
    assert found.posterior.head.log_objects == 0.0  # it never varies
    assert found.posterior.apply(answer(2.0, 1.9), 5).status == "out-of-map"


def test_what_cannot_be_fitted_is_told():
    here, gone = ScoredAnswer(np.array([2.0, 1.0]), 0, True, 1), ScoredAnswer(np.array([1.0]), None, False, 1)
    with pytest.raises(
        DataError, match=r"received 2 answers to queries in the map, .* and 0 answers to out-of-map queries"
    ):
        fit_posterior([here, here])
    with pytest.raises(
        DataError, match=r"received 0 answers to queries in the map, .* and 1 answers to out-of-map queries"
    ):
        fit_posterior([gone])
    flat = ScoredAnswer(np.array([1.0, 1.0]), 0, True, 1)
    with pytest.raises(DataError, match="the same score, expected scores that differ between places"):
        fit_posterior([flat, gone])


def test_a_file_or_parameters_or_both(tmp_path):
    path = tmp_path / "fitted.yaml"
    path.write_text("posterior: {temperature: 3.0, head: {bias: 1.0}}\nprovenance: {}\n")
    assert read_fitted("posterior", str(path)) == {"temperature": 3.0, "head": {"bias": 1.0}}
    assert read_fitted("posterior", None) is None
    # `posterior.temperature=4` laid on a preset that names the file, and the file laid on a preset's own parameters
    assert read_fitted("posterior", {"kind": str(path), "temperature": 4.0})["temperature"] == 4.0
    assert read_fitted("posterior", {"temperature": 9.0, "head": NEUTRAL, "kind": str(path)})["temperature"] == 3.0


def test_bad_files_and_parameters_are_one_line(tmp_path):
    from salframe_objects.localizer import ObjectSetLocalizer

    def told(value):
        with pytest.raises(ConfigError) as error:
            validate(ObjectSetLocalizer.Config, {"posterior": value}, "objects")
        assert "\n" not in str(error.value)
        return str(error.value)

    (tmp_path / "other.yaml").write_text("kind: objects\n")
    assert "cannot read nowhere.yaml: No such file" in told("nowhere.yaml")
    assert "has no mapping `posterior`, expected a file that `salframe fit` wrote" in told(str(tmp_path / "other.yaml"))
    assert "objects.posterior.temperature: received 0, expected a number greater than 0" in told(
        {"temperature": 0, "head": NEUTRAL}
    )
    assert "objects.posterior.head is missing" in told({"temperature": 1.0})
