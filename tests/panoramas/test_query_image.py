"""Changes of the image of a query against closed forms: gains in linear light, the width of a Gaussian, areas."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.panoramas.query_image import QueryImage, change_image
from salframe.panoramas.srgb import LINEAR

HEIGHT = 64


def uniform(*color: int) -> np.ndarray:
    return np.full((HEIGHT, 2 * HEIGHT, 3), color, np.uint8)


def noise() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (HEIGHT, 2 * HEIGHT, 3), np.uint8)


def white_line(column: int) -> np.ndarray:
    image = uniform(0, 0, 0)
    image[:, column] = 255
    return image


@pytest.mark.parametrize(
    ("value", "exposure_ev", "expected"),
    [(255, -2, 137), (255, -1, 188), (100, 2, 189), (188, -2, 99), (200, 2, 255), (0, 3, 0), (8, -2, 2)],
)
def test_exposure_multiplies_linear_light(value: int, exposure_ev: float, expected: int) -> None:
    """White at -2 EV is 255 (1.055 / 4 ** (1 / 2.4) - 0.055) = 136.96. Values of 10 and less are linear in light."""
    changed = change_image(uniform(value, value, value), QueryImage(exposure_ev=exposure_ev))
    np.testing.assert_array_equal(changed, uniform(expected, expected, expected))


def test_warmth_multiplies_red_and_divides_blue() -> None:
    """Light of 1/4 (137 in sRGB) times 2 ** 0.5 is 160 in sRGB, and divided by it 117."""
    grey = uniform(137, 137, 137)
    np.testing.assert_array_equal(change_image(grey, QueryImage(warmth_ev=1)), uniform(160, 137, 117))
    np.testing.assert_array_equal(change_image(grey, QueryImage(warmth_ev=-1)), uniform(117, 137, 160))


@pytest.mark.parametrize("column", [HEIGHT, 0, 2 * HEIGHT - 1])
def test_blur_is_a_gaussian_of_light_that_wraps_around(column: int) -> None:
    """A line becomes a Gaussian: 1 / (sigma sqrt(2 pi)) at its centre, exp(-1/2) of that at one sigma."""
    sigma_px = 2
    changed = change_image(white_line(column), QueryImage(blur_px=sigma_px))
    profile = LINEAR[np.roll(changed[HEIGHT // 2, :, 0], HEIGHT - column)]
    peak = 1 / (sigma_px * np.sqrt(2 * np.pi))
    assert profile[HEIGHT] == pytest.approx(peak, abs=0.002)
    assert profile[HEIGHT - sigma_px] == pytest.approx(peak * np.exp(-0.5), abs=0.002)
    assert profile[HEIGHT + 2 * sigma_px] == pytest.approx(peak * np.exp(-2), abs=0.002)
    assert profile.sum() == pytest.approx(1, abs=0.02)


def test_half_resolution_averages_areas() -> None:
    """A chequerboard of single pixels becomes uniform; one of 16 pixels stays in the middle of its fields."""
    rows, columns = np.indices((HEIGHT, 2 * HEIGHT))
    fine = np.repeat(np.where((rows + columns) % 2, 200, 100)[..., None], 3, 2).astype(np.uint8)
    np.testing.assert_array_equal(change_image(fine, QueryImage(scale=0.5)), uniform(150, 150, 150))
    coarse = np.repeat(np.where((rows // 16 + columns // 16) % 2, 200, 100)[..., None], 3, 2).astype(np.uint8)
    changed = change_image(coarse, QueryImage(scale=0.5))
    np.testing.assert_array_equal(changed[8::16, 8::16], coarse[8::16, 8::16])
    assert (changed != coarse).any()


def test_half_resolution_interpolates_a_ramp_exactly() -> None:
    """Averages of neighbouring pixels of a ramp, interpolated, are the ramp except at its ends."""
    ramp = np.broadcast_to(np.arange(2 * HEIGHT, dtype=np.uint8)[:, None], (HEIGHT, 2 * HEIGHT, 3))
    changed = change_image(np.ascontiguousarray(ramp), QueryImage(scale=0.5)).astype(int)
    assert np.abs(changed - ramp)[:, 2:-2].max() <= 1


@pytest.mark.parametrize("changes", [{"blur_px": 3.0}, {"scale": 0.5}, {"exposure_ev": -2.0, "warmth_ev": 1.0}])
def test_there_is_no_seam(changes: dict) -> None:
    """A turned camera has the turned image."""
    turned = np.roll(noise(), 2 * 13, 1)
    np.testing.assert_array_equal(
        change_image(turned, QueryImage(**changes)), np.roll(change_image(noise(), QueryImage(**changes)), 2 * 13, 1)
    )


def test_compression_is_lossy_and_repeatable() -> None:
    errors = []
    for quality in (95, 40, 5):
        first, second = (change_image(noise(), QueryImage(jpeg_quality=quality)) for _ in range(2))
        np.testing.assert_array_equal(first, second)
        errors.append(np.abs(first.astype(int) - noise()).mean())
    assert 0 < errors[0] < errors[1] < errors[2]
    red = change_image(uniform(200, 40, 40), QueryImage(jpeg_quality=40))
    assert np.abs(red.astype(int) - (200, 40, 40)).max() <= 6


def test_without_changes_the_image_stays() -> None:
    image = noise()
    assert change_image(image, QueryImage()) is image
