"""Which answers are accepted: the limit that the calibration sets, and the conformal test."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from spied_map import HEAD, POSTERIOR, drawn, spied_map

from salframe.framework.errors import ConfigError, DataError
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.calibration import REJECTION_PRIOR, MapCalibration, calibrate_head


def test_the_conformal_test_accepts_at_most_its_share_of_out_of_map_queries():
    """Probabilities of frames and queries from one distribution: the mean share over many maps of 39 frames is
    floor(40 level) / 40, by exchangeability."""
    rng = np.random.default_rng(0)
    for level in (0.05, 0.1, 0.26):
        accepted = []
        for _ in range(300):
            in_map = tuple(np.sort(rng.beta(4, 2, 39)).tolist())
            queries = 1 - rng.beta(4, 2, 200)
            made = MapCalibration(head=HEAD, present_frames=0, absent_in_map=in_map)
            limit = made.max_out_of_map_probability(level)
            if limit < 0.5:
                accepted.append((queries <= limit).mean())
            else:
                accepted.append(np.nan)
        share = np.nanmean(accepted)
        assert share <= level + 0.01
        if not np.isnan(accepted).any():
            assert share == pytest.approx(np.floor(40 * level) / 40, abs=0.01)


def test_the_conformal_test_needs_enough_frames():
    made = MapCalibration(head=HEAD, present_frames=0, absent_in_map=tuple(np.linspace(0, 0.9, 19).tolist()))
    with pytest.raises(
        DataError, match=r"max_false_accept is 0.05, which needs at least 20 calibration frames .*, but the map has 19"
    ):
        made.max_out_of_map_probability(0.05)
    assert made.max_out_of_map_probability(0.06) <= 0.5
    small = spied_map([1, 1, 1])
    with pytest.raises(DataError, match="the map has 3"):
        small.require_false_accept(0.1)
    bare = spied_map([1, 1, 1], calibrate=False)
    with pytest.raises(DataError, match="the map is not calibrated"):
        bare.require_false_accept(0.5)
    with pytest.raises(ConfigError, match="max_false_accept: received 2"):
        small.require_false_accept(2)


def test_an_answer_that_fails_the_conformal_test_is_not_accepted():
    spied = spied_map([4] * 10)
    answer = spied.answer({"value": np.array([2.5])})
    assert answer.accepted is True
    spied.require_false_accept(0.1)
    in_map = np.array(spied.calibration.absent_in_map)
    for value in np.linspace(0, 100, 41):
        answer = spied.answer({"value": np.array([value])})
        rank = (1 + (in_map >= 1 - answer.out_of_map_probability).sum()) / (1 + len(in_map))
        assert answer.accepted is bool(rank <= 0.1 and answer.out_of_map_probability <= 0.5)


def test_the_minimum_log_ratio_rejects_a_twentieth_of_the_right_frames():
    """The 5 % quantile of numpy, averaged with ten zeros, where it is between 0 and -ln 2."""
    for shift, count in ((0.0, 40), (0.8, 40), (0.9, 400), (1.2, 400)):
        answers = drawn(count, 5, 2.0, 1.0, 0.9)
        answers = dataclasses.replace(answers, contrast=answers.contrast + shift * answers.is_right)
        head = calibrate_head(POSTERIOR, answers)
        right = answers.take(answers.is_right)
        quantile = np.quantile(right.log_ratio(head), 0.05, method="inverted_cdf")
        n = len(right.contrast)
        assert head.min_log_ratio == pytest.approx(np.clip(n * quantile / (n + REJECTION_PRIOR), -np.log(2), 0))
        accepted = right.in_map(head) >= head.min_in_map(right.objects)
        np.testing.assert_array_equal(accepted, right.log_ratio(head) >= head.min_log_ratio)


def test_the_minimum_log_ratio_is_zero_without_frames_like_queries():
    easy = drawn(200, 3, 2.0, 1.0, 0.9)
    easy = dataclasses.replace(easy, contrast=easy.contrast + 20.0 * easy.is_right)
    assert calibrate_head(POSTERIOR, easy).min_log_ratio == 0  # all right frames are accepted
    far = calibrate_head(POSTERIOR, drawn(200, 3, 2.0, 1.0, 0.9, 30.0))
    assert far.min_log_ratio == pytest.approx(0, abs=1e-3)
    assert far.min_in_map(np.array([0, 7])) == pytest.approx([0.5, 0.5], abs=1e-3)
    assert HEAD.min_in_map(np.array(5)) == 0.5


def test_an_answer_is_accepted_down_to_the_minimum_log_ratio():
    accuracy = 0.75
    head = HEAD.model_copy(update={"min_log_ratio": -0.5, "accuracy": accuracy})
    posterior = POSTERIOR.model_copy(update={"head": head, "max_out_of_map_probability": 1.0})
    right = accuracy * np.exp(-0.5)
    limit = 1 / (right + 2 - accuracy)
    for log_ratio, is_accepted in ((-0.49, True), (-0.51, False)):
        z = (log_ratio - head.bias) / head.slope
        score = (head.absent_mean + head.absent_deviation * z + head.other_score) * posterior.temperature
        place = RankedPlace("a", "a", score)
        answer = posterior.apply(Localization((place,), None, LocalizationStatus.NO_POSE))
        assert answer.max_accepted_probability == pytest.approx(limit)
        assert answer.accepted is is_accepted
    assert posterior.apply(answer, limit=0.3).max_accepted_probability == 0.3
