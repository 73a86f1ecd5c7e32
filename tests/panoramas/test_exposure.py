"""Mean luminance and correction of dark panoramas, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.panoramas.exposure import DARK_LUMINANCE, USUAL_LUMINANCE, correct_dark, mean_luminance
from salframe.panoramas.query_image import QueryImage, change_image

HEIGHT = 256


def light_of(level: int) -> float:
    """Return the linear light of a grey level above 10 (IEC 61966-2-1)."""
    return float(((level / 255 + 0.055) / 1.055) ** 2.4)


def srgb_of(light: float) -> float:
    """Return the grey level of linear light above 0.0031 (IEC 61966-2-1)."""
    return float(255 * (1.055 * light ** (1 / 2.4) - 0.055))


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
    and 0.3400 (158). The noise filter changes only pixels within 2 of the other half."""
    image = uniform(50, 50, 50)
    image[:, HEIGHT:] = 60
    corrected = correct_dark(image)
    np.testing.assert_array_equal(np.unique(corrected[:, 2 : HEIGHT - 2]), [134])
    np.testing.assert_array_equal(np.unique(corrected[:, HEIGHT + 2 : -2]), [158])
    assert mean_luminance(corrected) == pytest.approx(USUAL_LUMINANCE, abs=0.002)


def test_a_correction_undoes_an_underexposure() -> None:
    """Two stops less light leave the surfaces of a room as they were, within the grey levels of 8 bits. Only the pixels
    within 2 of another surface change."""
    rng = np.random.default_rng(0)
    smooth = np.repeat(np.repeat(rng.integers(90, 180, (16, 32, 3)), 16, 0), 16, 1).astype(np.uint8)
    dark = change_image(smooth, QueryImage(exposure_ev=-2))
    assert mean_luminance(dark) < DARK_LUMINANCE
    factor = USUAL_LUMINANCE / mean_luminance(smooth)
    expected = change_image(smooth, QueryImage(exposure_ev=float(np.log2(factor))))
    inside = (np.indices((16, 16)) >= 2).all(0) & (np.indices((16, 16)) < 14).all(0)
    difference = np.abs(correct_dark(dark).astype(int) - expected)
    assert difference[np.tile(inside, (16, 32))].max() <= 3


def test_the_noise_of_a_dark_panorama_is_averaged_over_similar_colours() -> None:
    """Each pixel becomes a weighted mean of the disc of radius 2 around it. In a uniform image, a slightly brighter
    pixel nearly vanishes, and a much brighter one stays.

    The weights are exp(-d^2 / (2 * 1.5^2)) by the distance d in pixels, and exp(-c^2 / (2 * 15^2)) by the sum c of the
    differences of the three channels. The image is then brightened. The pixel in the first column also shows that the
    image wraps around.
    """
    image = uniform(50, 50, 50)
    image[100, 0], image[50, 300], image[150, 300] = 51, 54, 70
    corrected = correct_dark(image)
    squared_px = [x * x + y * y for x in range(-2, 3) for y in range(-2, 3) if 0 < x * x + y * y <= 4]
    by_distance = np.exp(np.array(squared_px) / (-2 * 1.5**2)).sum()
    for level, pixel, filtered in ((51, (100, 0), 50), (54, (50, 300), 51), (70, (150, 300), 70)):
        weight = by_distance * np.exp(-((3 * (level - 50)) ** 2) / (2 * 15**2))
        assert round((level + weight * 50) / (1 + weight)) == filtered
        expected = srgb_of(light_of(filtered) * USUAL_LUMINANCE / mean_luminance(image))
        np.testing.assert_allclose(corrected[pixel], expected, atol=0.6)
    np.testing.assert_array_equal(np.roll(correct_dark(np.roll(image, HEIGHT, 1)), -HEIGHT, 1), corrected)


def test_the_noise_of_a_dark_panorama_falls_and_its_edges_stay() -> None:
    rng = np.random.default_rng(1)
    image = uniform(60, 60, 60)
    image[:, HEIGHT:] = 100
    noisy = np.clip(image + rng.normal(0, 1.5, image.shape[:2])[..., None], 0, 255).astype(np.uint8)
    ideal, corrected = correct_dark(image).astype(float), correct_dark(noisy).astype(float)
    bright = change_image(noisy, QueryImage(exposure_ev=float(np.log2(USUAL_LUMINANCE / mean_luminance(noisy)))))
    error, unfiltered = (np.std(picture - ideal) for picture in (corrected, bright.astype(float)))
    assert error < 0.6 * unfiltered
    edge = corrected[:, HEIGHT].mean() - corrected[:, HEIGHT - 1].mean()
    assert edge == pytest.approx(ideal[:, -HEIGHT // 2].mean() - ideal[:, HEIGHT // 2].mean(), abs=1.5)


def test_colours_do_not_change() -> None:
    """The factor is 0.29 / 0.04265; red, green and blue keep the ratio of their light."""
    corrected = correct_dark(uniform(70, 55, 50))
    light = ((corrected[0, 0] / 255 + 0.055) / 1.055) ** 2.4
    before = ((np.array([70, 55, 50]) / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(light / light[1], before / before[1], rtol=0.02)


@pytest.mark.parametrize("value", [118, 137, 255, 0])
def test_other_panoramas_stay(value: int) -> None:
    """118 has a luminance of 0.1812, above the limit; a black image has no exposure that could be corrected."""
    image = uniform(value, value, value)
    assert correct_dark(image) is image


def test_the_correction_has_a_limit_of_4_stops() -> None:
    """1 has 1 / (255 * 12.92) of the light of white. 16 times as much is 0.004856: 15.2 in sRGB."""
    assert np.unique(correct_dark(uniform(1, 1, 1))).tolist() == [15]
