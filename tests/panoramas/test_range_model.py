"""Estimating a panorama's range once, and marking it."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError, InputMissing, InvalidAnswer
from salframe.framework.files.cache import Cache
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import RangeModel, estimate_range, from_bright_side

RGB = np.random.default_rng(0).integers(0, 255, (8, 16, 3), np.uint8)


class Even(RangeModel):
    """The same range everywhere."""

    name, version = "even", "1"

    class Config(ComponentConfig):
        range_m: float = 2.0

    answers = 0

    def estimate(self, panorama):
        type(self).answers += 1
        return np.full(panorama.rgb.shape[:2], self.config.range_m, np.float32)


class Ramp(RangeModel):
    """Range by the column."""

    name, version = "ramp", "1"

    def estimate(self, panorama):
        return np.tile(np.arange(1, 17, dtype=np.float32), (8, 1))


def test_the_panorama_gets_the_range_and_its_maker():
    valid = np.ones((8, 16), bool)
    valid[:, :4] = False
    found, seconds = estimate_range(Even(), Panorama("a", rgb=RGB, valid=valid))
    assert found.range_by == "even"
    assert found.provides == {"rgb", "range"}
    assert np.isnan(found.range_m[:, :4]).all()
    assert (found.range_m[:, 4:] == 2).all()
    assert seconds >= 0


def test_an_estimate_is_kept_for_all_that_use_the_same_model(tmp_path):
    cache, panorama = Cache(tmp_path), Panorama("a", rgb=RGB)
    Even.answers = 0
    first, seconds = estimate_range(Even(), panorama, cache, {"dataset": "data", "frame": "a"})
    again, seconds_then = estimate_range(Even(), panorama, cache, {"dataset": "data", "frame": "a"})
    assert np.array_equal(first.range_m, again.range_m)
    assert seconds_then == seconds
    assert (again.range_by, Even.answers) == ("even", 1)
    other, _ = estimate_range(Even(Even.Config(range_m=3.0)), panorama, cache, {"dataset": "data", "frame": "a"})
    assert (other.range_m == 3).all()
    estimate_range(Even(), panorama, cache, {"dataset": "other", "frame": "a"})
    estimate_range(Even(), Panorama("b", rgb=RGB), cache, {"dataset": "data", "frame": "b"})
    estimate_range(Even(), panorama)
    assert Even.answers == 5


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            np.ones((8, 16)),
            r"returned an array of dtype float64 and shape \(8, 16\), expected an array of dtype float32 and",
        ),
        (
            np.ones((8, 8), np.float32),
            r"returned an array of dtype float32 and shape \(8, 8\), expected an array of dtype float32 and",
        ),
        (None, r"returned a value of type NoneType, expected an array of dtype float32 and shape \(8, 16\)"),
        (
            np.zeros((8, 16), np.float32),
            "the range model 'even' returned a range that is zero, negative or infinite, expected positive",
        ),
        (
            np.full((8, 16), np.inf, np.float32),
            "the range model 'even' returned a range that is zero, negative or infinite, expected positive",
        ),
    ],
)
def test_an_answer_that_is_no_range_is_refused(answer, message, monkeypatch):
    monkeypatch.setattr(Even, "estimate", lambda self, panorama: answer)
    with pytest.raises(InvalidAnswer, match=message):
        estimate_range(Even(), Panorama("a", rgb=RGB))


def test_a_model_without_what_it_needs_is_told():
    with pytest.raises(InputMissing, match="the range model 'even' needs colour images, which a does not have"):
        estimate_range(Even(), Panorama("a"))
    with pytest.raises(DataError, match=r"a has range_by = 'even' .* but no range image: pass range_m"):
        Panorama("a", rgb=RGB, range_by="even")


def test_from_the_bright_side_a_model_sees_what_it_saw(monkeypatch):
    monkeypatch.setattr(Ramp, "estimate", from_bright_side(Ramp.estimate))
    model = Ramp()
    before = model.estimate(Panorama("a", rgb=RGB))
    for columns in range(16):
        after = model.estimate(Panorama("a", rgb=np.roll(RGB, columns, 1)))
        assert np.array_equal(after, np.roll(before, columns, 1))
