"""Outlines of floor masks, and the drawing of a floor."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shown_html import HOSTILE, SHOWN, ShownHtml

from salframe.framework.markup import to_html
from salframe.panoramas.floor_outlines import draw_floor, floor_below, floor_outlines
from salframe.panoramas.floors import FloorMasks


def floor(z_m: float = 0.0) -> FloorMasks:
    """4 m x 3 m from (10, 2) to (14, 5), with a hole of 1 m x 1 m; the left half is a place."""
    free = np.zeros((80, 100), bool)
    free[10:70, 10:90] = True
    free[30:50, 60:80] = False
    region = np.zeros(free.shape, np.int32)
    region[10:70, 10:50] = 1
    return FloorMasks(free, region, np.zeros_like(free), 0.05, (9.5, 5.5), {1: HOSTILE}, z_m)


def test_outlines_have_the_area_and_the_place_of_the_mask():
    """The lines pass through the middle of the outermost pixels, half a pixel inside."""
    (polygon,) = floor_outlines(floor(), floor().free)
    shape = shapely.Polygon(polygon[0], polygon[1:])
    assert shape.is_valid
    assert shape.bounds == pytest.approx((10.0, 2.0, 14.0, 5.0), abs=0.026)
    assert shape.area == pytest.approx(4 * 3 - 1, abs=0.5)
    assert not shape.contains(shapely.Point(13.0, 3.5))
    for ring in polygon:
        np.testing.assert_array_equal(ring[0], ring[-1])


def test_an_empty_mask_has_no_outline():
    assert floor_outlines(floor(), np.zeros_like(floor().free)) == []


def test_a_floor_is_drawn_with_the_names_of_its_places():
    drawing = draw_floor(floor(), np.array([(16.0, 2.0)]))
    shown = ShownHtml(to_html(drawing.svg))
    assert shown.texts == [SHOWN]
    x, y = drawing.pixels(np.array([11.0, 3.5]))
    name = shown.all("text")[0]
    assert (float(name["x"]), float(name["y"])) == pytest.approx((x, y), abs=2)
    assert float(shown.all("svg")[0]["width"]) == pytest.approx(420, abs=1)  # the point is shown too


def test_the_floor_of_a_position_is_the_one_below_it():
    ground, upper = floor(), floor(3.0)
    assert floor_below([upper, ground], np.array([11.0, 3.0, 4.5])) is upper
    assert floor_below([upper, ground], np.array([11.0, 3.0, 1.5])) is ground
    assert floor_below([upper, ground], np.array([50.0, 3.0, 4.5])) is ground
    assert floor_below([], np.zeros(3)) is None
