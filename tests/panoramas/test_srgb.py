"""The transfer function of sRGB against values of the standard."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.panoramas.srgb import LINEAR, LUMINANCE, linear_from_srgb, srgb_from_linear


@pytest.mark.parametrize(
    ("linear", "srgb"), [(0.0, 0.0), (0.002, 0.02584), (0.18, 0.46136), (0.21404, 0.5), (0.25, 0.53710), (1.0, 1.0)]
)
def test_known_values(linear: float, srgb: float) -> None:
    assert float(srgb_from_linear(np.float64(linear))) == pytest.approx(srgb, abs=1e-5)
    assert float(linear_from_srgb(np.float64(srgb))) == pytest.approx(linear, abs=1e-5)


def test_all_8_bit_values_survive_the_round_trip() -> None:
    np.testing.assert_array_equal(np.round(255 * srgb_from_linear(LINEAR)), np.arange(256))
    assert (np.diff(LINEAR) > 0).all()


def test_white_has_luminance_1() -> None:
    assert sum(LUMINANCE) == pytest.approx(1)
