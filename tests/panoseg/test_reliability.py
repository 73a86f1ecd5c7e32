"""The reliability of scores that training/panoseg measures, on numbers counted by hand and in a rendered building."""

import numpy as np
import pytest
from salframe_panoseg.detector import PanoSegDetector

from training.panoseg.reliability import calibration_error, run


def test_the_calibration_error_is_the_mean_gap_between_score_and_share():
    scores = np.array([0.15, 0.15, 0.95, 0.95, 0.95, 0.95])
    right = np.array([False, True, True, True, True, False])
    # The bins have the gaps |0.15 - 0.5| of two objects and |0.95 - 0.75| of four.
    assert calibration_error(scores, right) == pytest.approx((2 * 0.35 + 4 * 0.2) / 6)
    assert calibration_error(np.array([1.0, 1.0]), np.array([True, True])) == 0


@pytest.mark.slow
def test_calibrated_scores_are_nearer_to_the_share_of_correct_objects():
    """In a building that was not used for the fit, far beyond chance: the objects are a few hundred."""
    detector = PanoSegDetector()
    plain, right = (np.concatenate(parts) for parts in run(detector, "house-6", "7"))
    score = np.array([detector.calibration.score(p) for p in plain])
    assert len(score) > 50
    assert calibration_error(score, right) < calibration_error(plain, right)
