"""Settings with numbers of limited size."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import Field

from salframe.framework.errors import ConfigError
from salframe.framework.validation import Seed, Settings, validate


class Model(Settings):
    length_m: float = 1.0
    count: int = 1
    spread_m: float = Field(1.0, gt=0)
    origin_m: tuple[float, float] = (0.0, 0.0)
    shares: dict[str, Any] = Field(default_factory=dict)
    seed: Seed = 0
    pose: tuple[float, ...] | None = Field(None, min_length=16, max_length=16)
    name: str = Field("a", min_length=1, pattern="^[a-z]*$")
    enabled: bool = True


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"length_m": 1e308}, r"model\.length_m: received 1e\+308, expected a number from -1e\+12 to 1e\+12"),
        ({"length_m": float("nan")}, r"model\.length_m: received nan, expected a finite number"),
        ({"count": 2**63}, r"model\.count: received 9223372036854775808, expected an integer of at most 63 bits"),
        ({"origin_m": [1e308, 0]}, r"model\.origin_m: 0: received 1e\+308, expected a number"),
        ({"shares": {"a": [-1e13]}}, r"model\.shares: a\.0: received -1e\+13, expected a number"),
        ({"spread_m": 1e-320}, r"model\.spread_m: received 9.99989e-321, expected at least 1e-12"),
        ({"seed": -1}, r"model\.seed: received -1, expected a number greater than or equal to 0"),
        ({"seed": True}, r"model\.seed: received True, expected an integer"),
    ],
)
def test_numbers_that_nothing_can_compute_with_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        validate(Model, settings, "model")


class Rates(Settings):
    missed: float = Field(0.0, le=1)
    share: float = 0.0


class Sensor(Settings):
    noise: Literal["none", "uniform"] | Rates | Path = "none"
    sets: tuple[str, ...] | dict[str, str | Rates] = ()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"noise": {"mised": 0.5}},
            "unknown setting sensor.noise.mised, did you mean 'missed' (known settings: missed, share)",
        ),
        (
            {"noise": {"missed": 2}},
            "setting sensor.noise.missed: received 2, expected a number less than or equal to 1",
        ),
        ({"noise": 3}, "setting sensor.noise: received 3, expected 'none' or 'uniform' or a dictionary or a path"),
        (
            {"sets": {"a": {"shares": 0.5}}},
            "unknown setting sensor.sets.a.shares, did you mean 'share' (known settings: missed, share)",
        ),
        ({"sets": {"a": 3}}, "setting sensor.sets.a: received 3, expected a string or a dictionary"),
    ],
)
def test_an_error_in_a_setting_of_several_types_is_about_the_received_type(settings, message):
    with pytest.raises(ConfigError) as caught:
        validate(Sensor, settings, "sensor")
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"pose": [1, 0, 0]}, "setting model.pose: received [1, 0, 0] (3 items), expected at least 16 items"),
        ({"origin_m": [1, 2, 3]}, "setting model.origin_m: received [1, 2, 3] (3 items), expected at most 2 items"),
        ({"origin_m": 3}, "setting model.origin_m: received 3, expected a list"),
        ({"shares": "half"}, "setting model.shares: received 'half', expected a dictionary"),
        ({"length_m": "long"}, "setting model.length_m: received 'long', expected a number"),
        ({"count": 1.5}, "setting model.count: received 1.5, expected an integer"),
        ({"enabled": "perhaps"}, "setting model.enabled: received 'perhaps', expected true or false"),
        ({"name": 3}, "setting model.name: received 3, expected a string"),
        ({"name": ""}, "setting model.name: received '', expected at least 1 character"),
        ({"name": "A"}, "setting model.name: received 'A', expected a string that matches ^[a-z]*$"),
    ],
)
def test_errors_name_the_expected_value_in_plain_words(settings, message):
    with pytest.raises(ConfigError) as caught:
        validate(Model, settings, "model")
    assert str(caught.value) == message


def test_large_numbers_within_the_bounds_are_kept():
    kept = validate(Model, {"length_m": -1e12, "count": 2**63 - 1, "seed": 2**63 - 1}, "model")
    assert (kept.length_m, kept.count, kept.seed) == (-1e12, 2**63 - 1, 2**63 - 1)


class Sized(Settings):
    """Settings with a value that may have several types."""

    size: int | tuple[int, int] | None = None


def test_a_value_of_several_types_is_one_error():
    with pytest.raises(ConfigError, match=r"^setting model\.size: received 'wide', expected an integer or a list$"):
        validate(Sized, {"size": "wide"}, "model")
    with pytest.raises(ConfigError, match=r"^a\.yaml: key size: received 'wide', expected an integer or a list$"):
        validate(Sized, {"size": "wide"}, "a.yaml:")
