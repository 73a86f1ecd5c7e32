"""Measures of signs: the signs that a panorama shows, and the settings of the measured conditions."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_house.dataset import House

from salframe.panoramas.panorama import Annotations, Panorama
from training.signs.measure import CONDITIONS
from training.signs.reading import visible_signs

HEIGHT = 180
"""Height of the panorama: a pixel is 1 degree."""


def test_visible_signs_have_their_bearing_and_letter_height():
    ids = np.zeros((HEIGHT, 2 * HEIGHT), np.int32)
    ids[80:100, 170:191] = 1  # 20 rows and 21 columns
    ids[40:50, 90:100] = 2
    ids[10:20, 10:20] = 3
    labels = {1: "text: 2.03", 2: "chair", 3: "text"}
    panorama = Panorama(
        "p", range_m=None, rgb=np.zeros((*ids.shape, 3), np.uint8), annotations=Annotations(ids, labels)
    )
    readable, unreadable = visible_signs(panorama)
    assert (readable[0], unreadable[0]) == ("2.03", "")
    # Rows 80 to 99 are symmetric about the horizon; the digits fill 46 % of a sign.
    assert readable[1][2] == pytest.approx(0.0, abs=1e-6)
    assert readable[2] == pytest.approx(0.46 * 20)
    angle_deg = np.degrees(np.arccos(readable[1] @ unreadable[1]))
    assert angle_deg == pytest.approx(np.degrees(np.arccos(_ray(90, 180.5) @ _ray(15, 15))), abs=0.5)


def _ray(row: float, column: float) -> np.ndarray:
    """Return a unit vector at a pixel of 1 degree, up to a turn or mirror image about the vertical axis."""
    azimuth, elevation = np.radians(column), np.radians(90 - row)
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


@pytest.mark.parametrize(
    ("name", "signs", "unreadable", "wrong", "has_texts"),
    [
        ("without signs", False, 0.0, 0.0, False),
        ("signs, texts not compared", True, 0.0, 0.0, False),
        ("all signs correct", True, 0.0, 0.0, True),
        ("shuffled", True, 0.3, 0.7, True),
        ("30 % unreadable, 5 % wrong", True, 0.3, 0.05, True),
        ("all signs wrong", True, 0.0, 1.0, True),
    ],
)
def test_conditions_are_settings_of_the_building_and_the_evidence(name, signs, unreadable, wrong, has_texts):
    settings = dict(setting.split("=", 1) for setting in CONDITIONS[name].settings)
    config = House.Config(**{key.removeprefix("data."): value for key, value in settings.items() if "data." in key})
    assert (config.signs, config.signs_unreadable, config.signs_wrong) == (signs, unreadable, wrong)
    assert ("text" in settings["proposed.evidence"].strip("[]").split(",")) == has_texts


def test_every_measured_condition_is_tested():
    assert len(CONDITIONS) == 6
