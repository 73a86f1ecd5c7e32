"""Mean luminance and correction of dark panoramas, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.panoramas.exposure import DARK_LUMINANCE, USUAL_LUMINANCE, brighten_dark, mean_luminance
from salframe.panoramas.query_image import QueryImage, change_image

HEIGHT = 256


def uniform(*color: int, height: int = HEIGHT) -> np.ndarray:
    return np.full((height, 2 * height, 3), color, np.uint8)


@pytest.mark.parametrize("height", [16, 128, 256, 512])
def test_the_mean_luminance_is_that_of_linear_light(height: int) -> None:
    """137 is 1/4 of the light of white (0.2502). Pure red, green and blue have the weights of Rec. 709."""
    assert mean_luminance(uniform(137, 137, 137, height=height)) == pytest.approx(0.2502, abs=1e-4)
    assert mean_luminance(uniform(255, 0, 0, height=height)) == pytest.approx(0.2126, abs=1e-6)
    assert mean_luminance(uniform(0, 255, 0, height=height)) == pytest.approx(0.7152, abs=1e-6)
    assert mean_luminance(uniform(0, 0, 255, height=height)) == pytest.approx(0.0722, abs=1e-6)


def test_rows_count_by_their_solid_angle() -> None:
    """The cap above an elevation of 30 degrees is a quarter of the sphere: (1 - sin 30 deg) / 2."""
    image = uniform(0, 0, 0)
    image[: HEIGHT // 3] = 255
    assert mean_luminance(image) == pytest.approx(0.25, abs=0.01)


def test_only_valid_pixels_count() -> None:
    image, valid = uniform(0, 0, 0), np.zeros((HEIGHT, 2 * HEIGHT), bool)
    image[:, :HEIGHT], valid[:, :HEIGHT] = 137, True
    assert mean_luminance(image, valid) == pytest.approx(0.2502, abs=1e-4)
    assert mean_luminance(image) == pytest.approx(0.1251, abs=1e-4)
    assert np.isnan(mean_luminance(image, np.zeros_like(valid)))


def test_a_dark_panorama_gets_the_usual_luminance() -> None:
    """50 has a luminance of 0.03190, 60 one of 0.04519. Both are multiplied by 0.29 / 0.03854, to 0.2400 (134 in sRGB)
    and 0.3400 (158)."""
    image = uniform(50, 50, 50)
    image[:, HEIGHT:] = 60
    corrected = brighten_dark(image)
    np.testing.assert_array_equal(np.unique(corrected[:, :HEIGHT]), [134])
    np.testing.assert_array_equal(np.unique(corrected[:, HEIGHT:]), [158])
    assert mean_luminance(corrected) == pytest.approx(USUAL_LUMINANCE, abs=0.002)


def test_a_correction_undoes_an_underexposure() -> None:
    """Two stops less light leave the image of a room as it was, within the grey levels of 8 bits."""
    rng = np.random.default_rng(0)
    smooth = np.repeat(np.repeat(rng.integers(90, 180, (16, 32, 3)), 16, 0), 16, 1).astype(np.uint8)
    dark = change_image(smooth, QueryImage(exposure_ev=-2))
    assert mean_luminance(dark) < DARK_LUMINANCE
    factor = USUAL_LUMINANCE / mean_luminance(smooth)
    expected = change_image(smooth, QueryImage(exposure_ev=float(np.log2(factor))))
    assert np.abs(brighten_dark(dark).astype(int) - expected).max() <= 3


def test_colours_do_not_change() -> None:
    """The factor is 0.29 / 0.04265; red, green and blue keep the ratio of their light."""
    corrected = brighten_dark(uniform(70, 55, 50))
    light = ((corrected[0, 0] / 255 + 0.055) / 1.055) ** 2.4
    before = ((np.array([70, 55, 50]) / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(light / light[1], before / before[1], rtol=0.02)


@pytest.mark.parametrize("value", [90, 137, 255, 0])
def test_other_panoramas_stay(value: int) -> None:
    """90 has a luminance of 0.1022, above the limit; a black image has no exposure that could be corrected."""
    image = uniform(value, value, value)
    assert brighten_dark(image) is image


def test_the_correction_has_a_limit_of_4_stops() -> None:
    """1 has 1 / (255 * 12.92) of the light of white. 16 times as much is 0.004856: 15.2 in sRGB."""
    assert np.unique(brighten_dark(uniform(1, 1, 1))).tolist() == [15]
