"""The calibration of a map with its own frames: closed forms, and probabilities that are known."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from command_line import run
from scipy.special import expit
from scipy.stats import norm
from spied_map import HEAD, POSTERIOR, Spy, drawn, spied_map

import salframe
from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.errors import DataError
from salframe.localization.calibration import (
    ABSENT_PRIOR,
    ACCURACY_PRIOR,
    BIAS_DEVIATION,
    DISTANCE_EXPONENT,
    DISTANCE_SPREAD,
    OTHER_CALIBRATION,
    calibrate_head,
)
from salframe.localization.hidden_frames import FrameAnswers
from salframe.localization.map import LocalizationMap
from salframe.localization.posterior import EvidenceTerm
from salframe.panoramas.frames import ReferenceFrame


def test_mean_and_deviation_are_averaged_with_those_of_the_posterior():
    contrast = np.array([5.0, 7.0, 9.0])
    unknown = np.zeros(3, int)
    answers = FrameAnswers(contrast, unknown, np.zeros(3, bool), np.ones(3, bool), np.full(3, np.nan), np.arange(3))
    calibrated = calibrate_head(POSTERIOR, answers)
    assert calibrated.absent_mean == pytest.approx((21 + ABSENT_PRIOR * 2) / (3 + ABSENT_PRIOR))
    assert calibrated.absent_deviation == pytest.approx(np.sqrt((8 + ABSENT_PRIOR * 1) / (3 + ABSENT_PRIOR)))
    assert (calibrated.accuracy, calibrated.bias, calibrated.slope) == (pytest.approx(0.75), HEAD.bias, HEAD.slope)


def test_a_map_without_answers_has_the_head_of_the_posterior():
    none, never = np.zeros(0, int), np.zeros(0, bool)
    nothing = FrameAnswers(np.zeros(0), none, never, never, np.zeros(0), none)
    calibrated = calibrate_head(POSTERIOR, nothing)
    assert calibrated.model_dump(exclude={"evidence"}) == pytest.approx(HEAD.model_dump(exclude={"evidence"}))


def test_numbers_of_objects_scale_the_contrasts_of_out_of_map_frames():
    """Frames with 4 and 16 objects. If the number doubles, the mean of the contrasts grows by 0.25 ln(2), and their
    deviation by the factor 2**0.25. The calibrated head has the numbers at the mean of 10 objects."""
    rng = np.random.default_rng(5)
    objects = np.repeat([4, 16], 4000)
    contrast = 3 + 0.25 * np.log(objects / 10) + 0.5 * (objects / 10) ** 0.25 * rng.standard_normal(8000)
    unknown = np.zeros(8000)
    answers = FrameAnswers(contrast, objects, unknown > 0, unknown == 0, np.full(8000, np.nan), np.arange(8000))
    head = HEAD.model_copy(update={"objects": 7.0, "mean_effect": 0.5, "deviation_effect": 0.25})
    calibrated = calibrate_head(POSTERIOR.model_copy(update={"head": head}), answers)
    assert calibrated.objects == 10
    assert calibrated.absent_mean == pytest.approx(3, rel=0.02)
    assert calibrated.absent_deviation == pytest.approx(
        0.5, rel=0.04
    )  # the deviation of the posterior has a weight of 0.1 %


def test_evidence_of_out_of_map_frames_is_averaged_with_the_posterior():
    """Of three absent answers, two have an outline. The mean and the variance of these two are averaged with those of
    the term."""
    term = EvidenceTerm(absent_mean=1.0, absent_deviation=2.0, bias=-0.5, slope=1.0)
    posterior = POSTERIOR.model_copy(update={"head": HEAD.model_copy(update={"evidence": {"outline": term}})})
    absent, unknown = np.ones(3, bool), np.zeros(3, int)
    outline = {"outline": np.array([4.0, 8.0, np.nan])}
    distance = np.full(3, np.nan)
    answers = FrameAnswers(np.full(3, 2.0), unknown, ~absent, absent, distance, np.arange(3), evidence=outline)
    calibrated = calibrate_head(posterior, answers).evidence["outline"]
    assert calibrated.absent_mean == pytest.approx((12 + ABSENT_PRIOR * 1) / (2 + ABSENT_PRIOR))
    assert calibrated.absent_deviation == pytest.approx(np.sqrt((8 + ABSENT_PRIOR * 4) / (2 + ABSENT_PRIOR)))
    assert (calibrated.bias, calibrated.slope) == (-0.5, 1.0)


def test_accuracy_at_the_distance_of_queries_is_a_share():
    answers = drawn(40, 0, 2.0, 1.0, 0.4)
    calibrated = calibrate_head(POSTERIOR, answers).accuracy
    assert calibrated == pytest.approx((answers.is_right.sum() + ACCURACY_PRIOR * 0.75) / (40 + ACCURACY_PRIOR))


def test_accuracy_at_another_distance_maximizes_the_likelihood():
    """The same number from a grid of the likelihood, written out frame by frame."""
    answers = drawn(40, 1, 2.0, 1.0, 0.6, np.linspace(0.5, 6, 80))
    present = ~answers.is_absent
    distance, right = answers.distance_m[present], answers.is_right[present]
    grid = np.linspace(0.01, 0.99, 9801)
    likelihood = grid ** (ACCURACY_PRIOR * 0.75) * (1 - grid) ** (ACCURACY_PRIOR * 0.25)
    for one, is_right in zip(distance, right, strict=True):
        share = np.minimum(grid / one**DISTANCE_EXPONENT, 0.99)
        likelihood *= share if is_right else 1 - share
    accuracy = calibrate_head(POSTERIOR, answers).accuracy
    assert accuracy == pytest.approx(grid[likelihood.argmax()], abs=2e-4)
    assert accuracy > right.mean()  # queries stand nearer than most of these frames


@pytest.mark.parametrize(("mean", "deviation", "accuracy"), [(2.0, 1.0, 0.75), (8.0, 0.3, 0.3), (0.5, 3.0, 0.95)])
def test_calibrated_probabilities_are_those_of_the_distributions(mean, deviation, accuracy):
    """A detector whose contrasts have another mean, deviation and accuracy than on the tuning data."""
    head = calibrate_head(POSTERIOR, drawn(2000, 3, mean, deviation, accuracy))
    contrast = mean + deviation * np.linspace(-2, 4, 30)
    density = [norm.pdf(contrast, mean + shift * deviation, deviation) for shift in (0, 2)]
    present = accuracy * density[1] + (1 - accuracy) * density[0]
    np.testing.assert_allclose(head.in_map(contrast, np.zeros(30)), present / (present + density[0]), atol=0.03)


def test_a_wrong_bias_is_corrected_by_the_frames_of_the_map():
    """Right answers whose contrasts exceed those of absent answers by two deviations have the log-ratio 2 z - 2."""
    wrong = POSTERIOR.model_copy(update={"head": HEAD.model_copy(update={"bias": -4.0})})
    assert calibrate_head(wrong, drawn(2000, 3, 2.0, 1.0, 0.75)).bias == pytest.approx(-2, abs=0.15)


def test_the_change_of_the_bias_maximizes_the_likelihood_at_the_distance_of_queries():
    """The same number from a grid, written out answer by answer."""
    answers = drawn(60, 8, 2.0, 1.0, 0.6, np.linspace(0.3, 4, 120))
    head = calibrate_head(POSTERIOR, answers)
    z = (answers.contrast - head.absent_mean) / head.absent_deviation
    grid = np.linspace(-4, 4, 8001)
    loss = (grid / BIAS_DEVIATION) ** 2 / 2
    total = 0.0
    for one, distance in zip(z[answers.is_right], answers.distance_m[answers.is_right], strict=True):
        weight = np.exp(-((np.log(distance) / DISTANCE_SPREAD) ** 2) / 2)
        loss -= weight * np.log(expit(2 * one - 2 + grid))
        total += weight
    for one in z[answers.is_absent]:
        loss -= total / answers.is_absent.sum() * np.log(expit(-(2 * one - 2 + grid)))
    assert head.bias == pytest.approx(HEAD.bias + grid[loss.argmin()], abs=2e-3)


def test_frames_that_are_far_from_each_other_do_not_change_the_bias():
    assert calibrate_head(POSTERIOR, drawn(200, 3, 2.0, 1.0, 0.75, 30.0)).bias == pytest.approx(HEAD.bias, abs=1e-3)


def test_cross_validation_measures_the_gain():
    """The scores of this map differ much more than the tuning data of the posterior: all frames seem to be in it."""
    calibrated = spied_map([3] * 12).calibration
    assert (calibrated.present_frames, len(calibrated.absent_in_map)) == (36, 36)
    assert calibrated.after.log_loss < calibrated.before.log_loss
    assert calibrated.after.brier_score < calibrated.before.brier_score


@pytest.mark.parametrize("places", [1, 2, 3])
@pytest.mark.parametrize("count", [1, 2])
def test_small_maps_have_probabilities(places, count):
    calibrated = spied_map([count] * places)
    answer = calibrated.answer({"value": np.array([0.4])})
    total = sum(place.probability for place in answer.places) + answer.out_of_map_probability
    assert total == pytest.approx(1)
    assert 0 < answer.out_of_map_probability < 1
    assert answer.accepted is (answer.out_of_map_probability <= 0.5)


def test_a_saved_map_keeps_its_calibration_and_a_changed_map_is_calibrated_again(tmp_path):
    calibrated = spied_map([3, 2, 2])
    calibrated.save(tmp_path / "map")
    localizer = Spy(calibrated.localizer.config)
    opened = LocalizationMap.open(tmp_path / "map", localizer)
    assert opened.calibration == calibrated.calibration
    opened.remove(["place-1"])
    assert opened.calibration != calibrated.calibration
    rest = [i for i, frame in enumerate(calibrated.frames) if frame.place != "place-1"]
    again = LocalizationMap.from_descriptions(
        Spy(calibrated.localizer.config),
        [calibrated.descriptions()[i] for i in rest],
        [calibrated.frames[i] for i in rest],
        calibrate=True,
    )
    assert again.calibration == opened.calibration
    off = spied_map([3, 2, 2], changes={"calibrate": False})
    off.calibrate()  # by hand
    off.remove(["place-1"])
    assert off.calibration == again.calibration


def test_answers_note_that_a_calibration_is_for_other_settings(tmp_path):
    calibrated, plain = spied_map([3, 2, 2]), spied_map([3, 2, 2], calibrate=False)
    calibrated.save(tmp_path / "calibrated")
    plain.save(tmp_path / "plain")
    settings = {**POSTERIOR.model_dump(), "temperature": 2.0}
    noted = {}
    for name, posterior in (("calibrated", settings), ("plain", settings), ("off", {**settings, "calibrate": False})):
        folder = tmp_path / ("plain" if name == "plain" else "calibrated")
        opened = LocalizationMap.open(folder, Spy(Spy.Config(posterior=posterior)))
        assert opened.calibration is None  # other settings, other contrasts
        noted[name] = opened.answer({"value": np.array([2.5])}).notes
    assert noted == {"calibrated": (OTHER_CALIBRATION,), "plain": (), "off": ()}
    assert (
        LocalizationMap.open(tmp_path / "calibrated", Spy(calibrated.localizer.config))
        .answer({"value": np.array([2.5])})
        .notes
        == ()
    )


def test_a_setting_and_a_method_without_probabilities_leave_a_map_uncalibrated():
    assert spied_map([2, 2], calibrate=False).calibration is None
    assert spied_map([2, 2], changes={"calibrate": False}).calibration is None
    plain = LocalizationMap.from_descriptions(
        Spy(), [{"value": np.array([1.0])}], [ReferenceFrame("a", "a", np.eye(4))], calibrate=True
    )
    assert plain.calibration is None
    with pytest.raises(DataError, match="the answers of the method 'spy' have no probabilities to calibrate"):
        plain.calibrate()


HEAD_SETTING = "{absent_mean: 0.5, absent_deviation: 1, bias: -1, slope: 1, accuracy: 0.8, other_score: 0}"
SETTING = f"posterior={{temperature: 1.0, head: {HEAD_SETTING}}}"


def test_build_calibrates_and_the_map_shows_it(fakes):
    build = ("build", "rooms", "--method", "reader", "--set", "data.rooms=6", "--set", SETTING)
    done = run(*build, "-o", "map")
    assert "calibrated with 0 simulated queries in the map and 6 out of it: accuracy 80%" in done.out
    plain = run(*build, "-o", "plain", "--no-calibrate")
    assert "calibrated" not in plain.out
    shown = run("map", "show", "map")
    assert "calibrated with 0 simulated queries in the map and 6 out of it" in shown.out
    assert "not calibrated" in run("map", "show", "plain").out
    made = run("map", "calibrate", "plain", "--json").json
    # rooms in a row, the query 1 away from the nearest rooms: e.g. -1, -2, -3, -4, -5 from the end of the row
    numbers = [-1 - np.mean(sorted([-abs(j - i) for j in range(6) if j != i])[:-1]) for i in range(6)]
    contrasts = np.sort(numbers)
    mean = (contrasts.sum() + ABSENT_PRIOR * 0.5) / (6 + ABSENT_PRIOR)
    deviation = np.sqrt((6 * contrasts.var() + ABSENT_PRIOR) / (6 + ABSENT_PRIOR))
    right = 0.8 * np.exp(-1 + (contrasts - mean) / deviation)
    assert made["absent_in_map"] == pytest.approx((right + 0.2) / (right + 1.2), abs=5e-5)
    opened = [salframe.open_map(name) for name in ("map", "plain")]
    assert opened[0].calibration == opened[1].calibration
    strict = salframe.open_map("map", max_false_accept=0.2)
    assert strict.localizer.posterior.max_false_accept == 0.2
    refused = run("localize", "map", "query-2-0", "--data", "rooms", "--max-false-accept", "0.05")
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)
    assert "needs at least 20 calibration frames" in refused.err
    assert run("build", "rooms", "--method", "reader", "-o", "bare").code == 0
    assert (
        "the answers of the method 'reader' have no probabilities to calibrate" in run("map", "calibrate", "bare").err
    )


def test_a_frame_that_the_localizer_fails_on_is_left_out(fakes):
    build = ("build", "rooms", "--method", "reader", "--set", "data.rooms=6", "--set", SETTING)
    assert "0 simulated queries in the map and 5 out of it" in run(*build, "-o", "map", "--set", "fail_in=2").out


def test_a_grown_map_is_the_map_that_was_built_at_once(fakes):
    settings = ("--method", "reader", "--set", SETTING)
    assert run("build", "rooms", *settings, "--set", "data.rooms=3", "-o", "grown").code == 0
    assert run("map", "add", "grown", "rooms", "--set", "data.rooms=6").code == 0
    assert run("build", "rooms", *settings, "--set", "data.rooms=6", "-o", "whole").code == 0
    grown, whole = (salframe.open_map(name).calibration for name in ("grown", "whole"))
    assert grown == whole
    assert len(whole.absent_in_map) == 6


def test_compare_calibrates_with_the_map_and_never_with_the_truth_of_queries(fakes, monkeypatch):
    """The same probabilities where the dataset names another true place for every query."""
    import fake_plugin

    def probabilities(name):
        request = Request(("reader",), "rooms", settings=("data.rooms=6", SETTING), engine="inline", name=name)
        rows = (compare(request).run / "methods" / "reader" / "rows.jsonl").read_text().splitlines()
        return {row["query"]: (row["out_of_map_probability"], row["accepted"]) for row in map(json.loads, rows)}

    honest = probabilities("honest")
    true = fake_plugin.Rooms.truth
    monkeypatch.setattr(
        fake_plugin.Rooms, "truth", lambda self, query: dataclasses.replace(true(self, query), place="room-0")
    )
    assert probabilities("other") == honest
    assert run("build", "rooms", "--method", "reader", "--set", SETTING, "--set", "data.rooms=6", "-o", "map").code == 0
    answer = run("localize", "map", "query-2-0", "--data", "rooms", "--set", "data.rooms=6", "--json").json
    assert honest["query-2-0"] == (pytest.approx(answer["out_of_map_probability"]), answer["accepted"])


def test_compare_measures_probabilities_and_accepted_answers(fakes):
    """The columns of the table from the rows of the answers, by hand."""
    settings = ("data.rooms=6", "data.hide_query_place=true", SETTING.replace("bias: -1", "bias: 0"))
    result = compare(Request(("clear",), "rooms", settings=settings, engine="inline", name="hidden"))
    lines = (result.run / "methods" / "clear" / "rows.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    present = np.array([row["fold"] == "all" for row in rows])
    in_map = np.array([1 - row["out_of_map_probability"] for row in rows])
    accepted = np.array([row["accepted"] for row in rows])
    assert present.sum() == (~present).sum() == 12
    assert 0 < accepted.sum() < len(accepted)
    row = result.row("clear")
    assert row.log_loss == pytest.approx(-np.mean(np.where(present, np.log(in_map), np.log(1 - in_map))))
    assert row.brier_score == pytest.approx(np.mean((in_map - present) ** 2))
    assert row.right_not_accepted.value == pytest.approx(np.mean(~accepted[present]))  # all of them are right
    assert row.absent_accepted.value == pytest.approx(np.mean(accepted[~present]))
