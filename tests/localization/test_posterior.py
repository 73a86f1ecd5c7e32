"""From scores to probabilities: closed forms, and parameters that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from salframe.framework.errors import ConfigError, DataError
from salframe.framework.validation import validate
from salframe.localization.answers import Localization, RankedPlace
from salframe.localization.posterior import EvidenceTerm, Head, Posterior, read_fitted, shares
from salframe.localization.posterior_fit import ScoredAnswer, fit_posterior

NEUTRAL = {"absent_mean": 0.0, "absent_deviation": 1.0, "bias": 0.0, "slope": 0.0, "accuracy": 1.0, "other_score": 0.0}
"""A head that returns one half for every answer."""


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


def test_the_contrast_compares_the_first_place_with_the_next_five():
    scores = np.array([9.0, 5.0, 4.0, 3.0, 2.0, 1.0, -90.0])
    np.testing.assert_allclose(shares(scores[:2], 4.0), np.array([np.e, 1]) / (1 + np.e))
    known = posterior(temperature=2.0, other_score=1.5)
    assert known.contrast(scores) == pytest.approx((9 - 3) / 2)
    assert known.contrast(scores[:3]) == pytest.approx((9 - 4.5) / 2)
    assert known.contrast(scores[:1]) == pytest.approx(9 / 2 - 1.5)  # one place


def test_the_head_is_a_mixture_of_right_and_wrong_answers():
    """By Bayes: right answers have a density of exp(bias + slope z) times that of out-of-map answers, wrong answers the
    same density as these."""
    head = Head(absent_mean=2.0, absent_deviation=0.5, bias=-2.0, slope=2.0, accuracy=0.8, other_score=0.0)
    contrast = np.array([1.0, 2.0, 3.5])
    ratio = norm.pdf(contrast, 3.0, 0.5) / norm.pdf(contrast, 2.0, 0.5)  # means 2 deviations apart: bias -2**2 / 2
    present = 0.8 * ratio + 0.2
    np.testing.assert_allclose(head.in_map(contrast, np.zeros(3)), present / (present + 1))


OUTLINE = EvidenceTerm(absent_mean=10.0, absent_deviation=4.0, bias=-0.5, slope=1.0)


def test_evidence_multiplies_the_likelihood_ratio_and_missing_evidence_does_not():
    """Right answers have an outline that is higher by one deviation than in out-of-map answers: the ratio of the
    densities of two normal distributions is exp(z - 1 / 2)."""
    known = {"absent_mean": 2.0, "absent_deviation": 0.5, "bias": -2.0, "slope": 2.0, "accuracy": 0.8}
    head = Head(**known, other_score=0.0, evidence={"outline": OUTLINE})
    contrast, outline = np.array([1.0, 2.0, 3.5, 2.0]), np.array([9.0, 18.0, 10.0, np.nan])
    ratio = norm.pdf(contrast, 3.0, 0.5) / norm.pdf(contrast, 2.0, 0.5)
    ratio[:3] *= norm.pdf(outline[:3], 14.0, 4.0) / norm.pdf(outline[:3], 10.0, 4.0)
    present = 0.8 * ratio + 0.2
    columns = {"outline": outline, "unused": np.zeros(4)}
    np.testing.assert_allclose(head.in_map(contrast, np.zeros(4), columns), present / (present + 1))
    bare = Head(**known, other_score=0.0)
    np.testing.assert_allclose(head.in_map(contrast, np.zeros(4)), bare.in_map(contrast, np.zeros(4)))


def test_the_probability_of_an_answer_uses_its_evidence():
    """A contrast without effect, and an outline with the log-ratio -1 / 2 + 2: the odds of being in the map."""
    evidence = {"outline": OUTLINE}
    shown = replace(answer(4.0, 2.0), evidence={"outline": 18.0})
    assert posterior(evidence=evidence).apply(shown).out_of_map_probability == pytest.approx(1 / (1 + np.exp(1.5)))
    assert posterior(evidence=evidence).apply(answer(4.0, 2.0)).out_of_map_probability == pytest.approx(0.5)


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
    found = posterior(temperature=1e-3, slope=1e3).apply(answer(1e4, -1e4))
    assert [place.probability for place in found.places] == pytest.approx([1.0, 0.0])


def drawn(count, seed, accuracy=0.8, mean=6.0, deviation=1.0, map="one"):
    """Answers of two places whose contrasts are drawn from the model, with a slope of 2 and a temperature of 1."""
    rng = np.random.default_rng(seed)
    for here in (True, False):
        for _ in range(count):
            right = here and rng.uniform() < accuracy
            contrast = mean + deviation * (rng.standard_normal() + 2 * right)
            yield ScoredAnswer(np.array([contrast, 0.0]), int(not right) if here else None, here, map)


def test_a_fit_recovers_what_the_answers_were_drawn_from():
    answers = [*drawn(4000, 0), *drawn(4000, 1, mean=9.0, deviation=2.0, map="other")]
    found = fit_posterior(answers)
    head, temperature = found.posterior.head, found.posterior.temperature
    assert head.accuracy == pytest.approx(0.8, abs=0.02)
    assert head.slope == pytest.approx(2.0, rel=0.1)  # the ridge makes it smaller
    assert head.bias == pytest.approx(-2.0, rel=0.1)
    assert head.absent_mean * temperature == pytest.approx((6 + 9) / 2, rel=0.02)
    assert head.absent_deviation * temperature == pytest.approx(np.sqrt((1 + 4) / 2), rel=0.02)
    assert found.place_nll_after < found.place_nll_before
    alone = fit_posterior(list(drawn(4000, 0)))
    assert alone.here_nll_after < alone.here_nll_before == pytest.approx(np.log(2))


def test_the_head_depends_on_the_number_of_objects():
    """A query with a quarter of the objects of the map: a mean that is smaller by ln(4) / 2 deviations, the deviation
    of 1 / 4**0.25, a bias of -2 + ln(4) and the odds of a right answer of 4 / 4**1.5. Where a number is unknown, it has
    no effect."""
    effects = {
        "objects": 8.0,
        "mean_effect": 0.5,
        "deviation_effect": 0.25,
        "bias_effect": -1.0,
        "accuracy_effect": 1.5,
    }
    known = {"absent_mean": 4.0, "absent_deviation": 1.0, "bias": -2.0, "slope": 2.0, "other_score": 0.0}
    head = Head(**known, accuracy=0.8, **effects)
    deviation, odds = 4**-0.25, 4 / 4**1.5
    right = odds / (1 + odds) * np.exp(-2 + np.log(4) + 2 * (3.0 - (4.0 - np.log(4) / 2)) / deviation)
    wrong = 1 / (1 + odds)
    expected = (right + wrong) / (right + wrong + 1)
    assert float(head.in_map(np.array(3.0), np.array(2))) == pytest.approx(expected)
    same = Head(**known, accuracy=0.8)
    for objects in (0, 8):
        assert head.in_map(np.array(3.0), np.array(objects)) == pytest.approx(same.in_map(np.array(3.0), np.array(2)))


def test_a_fit_recovers_the_effects_of_the_number_of_objects():
    rng = np.random.default_rng(4)
    answers = []
    for here in (True, False):
        for objects in rng.integers(2, 21, 6000):
            nu = np.log(objects / 10)
            odds = 4 * np.exp(1.5 * nu)
            right = here and rng.uniform() < odds / (1 + odds)
            contrast = 6 + 0.4 * nu + np.exp(0.2 * nu) * (rng.standard_normal() + 2 * right)
            scores = np.array([contrast, 0.0])
            answers.append(ScoredAnswer(scores, int(not right) if here else None, here, "one", int(objects), 10.0))
    found = fit_posterior(answers).posterior
    head = found.head
    assert head.objects == 10
    assert head.mean_effect == pytest.approx(0.4, abs=0.03)
    assert head.deviation_effect == pytest.approx(0.2, abs=0.03)
    assert head.accuracy_effect == pytest.approx(1.5, abs=0.1)
    assert head.accuracy == pytest.approx(0.8, abs=0.02)
    assert head.absent_mean * found.temperature == pytest.approx(6, rel=0.02)
    assert head.bias_effect == pytest.approx(0, abs=0.2)


def test_a_fit_recovers_the_evidence_that_half_of_the_answers_have():
    """Contrast and outline are independent, and both are higher in right answers: by 2 and by 1.5 deviations."""
    rng = np.random.default_rng(6)
    answers = []
    for here in (True, False):
        for number in range(6000):
            right = here and rng.uniform() < 0.8
            scores = np.array([6 + rng.standard_normal() + 2 * right, 0.0])
            evidence = {"outline": 30 + 5 * (rng.standard_normal() + 1.5 * right)} if number % 2 else {}
            answers.append(ScoredAnswer(scores, int(not right) if here else None, here, "one", evidence=evidence))
    fit = fit_posterior(answers)
    term = fit.posterior.head.evidence["outline"]
    assert term.absent_mean == pytest.approx(30, abs=0.4)
    assert term.absent_deviation == pytest.approx(5, rel=0.05)
    assert term.slope == pytest.approx(1.5, rel=0.1)
    assert term.bias == pytest.approx(-(1.5**2) / 2, abs=0.25)  # the ridge makes it smaller
    assert fit.posterior.head.slope == pytest.approx(2, rel=0.1)
    without = fit_posterior([replace(answer, evidence={}) for answer in answers])
    assert fit.here_nll_after < without.here_nll_after
    assert without.posterior.head.evidence == {}


def test_evidence_that_all_answers_have_changes_no_bias():
    answers = [replace(answer, evidence={"outline": float(i % 7)}) for i, answer in enumerate(drawn(300, 5))]
    head = fit_posterior(answers).posterior.head
    assert head.evidence["outline"].bias == pytest.approx(0, abs=1e-6)
    assert np.isfinite(head.bias)


def test_a_fit_is_the_same_for_the_same_answers():
    answers = list(drawn(200, 2))
    assert fit_posterior(answers) == fit_posterior(answers)


def test_answers_that_can_be_told_apart_have_a_finite_slope():
    answers = [ScoredAnswer(np.array([9.0, 1.0]), 0, True, "one")] * 9 + [
        ScoredAnswer(np.array([2.0, second]), None, False, "one") for second in (1.8, 1.9)
    ]
    found = fit_posterior(answers)
    assert np.isfinite([*found.posterior.head.model_dump(exclude={"evidence"}).values()]).all()
    assert found.posterior.apply(answer(2.0, 1.9)).status == "out-of-map"
    assert found.posterior.apply(answer(9.0, 1.0)).status == "ok"


def test_what_cannot_be_fitted_is_told():
    here, gone = ScoredAnswer(np.array([2.0, 1.0]), 0, True, ""), ScoredAnswer(np.array([1.0]), None, False, "")
    with pytest.raises(DataError, match=r"2 answers that contain the true place, and 0 answers to queries from places"):
        fit_posterior([here, here])
    with pytest.raises(DataError, match=r"0 answers that contain the true place, and 1 answers to queries from places"):
        fit_posterior([gone])
    flat = ScoredAnswer(np.array([1.0, 1.0]), 0, True, "")
    with pytest.raises(DataError, match="the same score, expected different scores"):
        fit_posterior([flat, gone])
    with pytest.raises(DataError, match="the answers to all out-of-map queries have the same scores"):
        fit_posterior([here, gone])


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

    def error_of(value):
        with pytest.raises(ConfigError) as error:
            validate(ObjectSetLocalizer.Config, {"posterior": value}, "objects")
        assert "\n" not in str(error.value)
        return str(error.value)

    (tmp_path / "other.yaml").write_text("kind: objects\n")
    assert "cannot read the file nowhere.yaml: No such file" in error_of("nowhere.yaml")
    assert "has no mapping `posterior`, expected a file that `salframe fit` wrote" in error_of(
        str(tmp_path / "other.yaml")
    )
    assert "objects.posterior.temperature: received 0, expected a number greater than 0" in error_of(
        {"temperature": 0, "head": NEUTRAL}
    )
    assert "the required setting objects.posterior.head is missing" in error_of({"temperature": 1.0})
