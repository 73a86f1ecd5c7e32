"""HTML and SVG for notebooks: escaping, long tables, and the scale of drawings."""

from __future__ import annotations

import numpy as np
import pytest
from shown_html import HOSTILE, SHOWN, ShownHtml

from salframe.framework.markup import MARGIN_PX, MAX_ROWS, PlanDrawing, element, table, to_html


def test_texts_and_attributes_are_escaped():
    drawing = PlanDrawing(np.eye(2), description=HOSTILE)
    drawing.text(np.zeros(2), HOSTILE)
    drawing.dot(np.zeros(2), 3, HOSTILE)
    shown = ShownHtml(to_html(element("p", HOSTILE), table([HOSTILE], [[HOSTILE]], HOSTILE), drawing.svg))
    assert shown.texts.count(SHOWN) == 6
    assert shown.all("svg")[0]["aria-label"] == SHOWN


def test_a_long_table_has_the_number_of_its_other_rows():
    shown = ShownHtml(to_html(table(["n"], [[str(n)] for n in range(MAX_ROWS + 3)])))
    assert shown.texts == ["n", *map(str, range(MAX_ROWS)), "and 3 more"]


def test_a_drawing_has_one_scale_and_y_up():
    drawing = PlanDrawing(np.array([(1.0, -2.0), (5.0, 0.0), (np.nan, 9.0)]), width_px=400 + 2 * MARGIN_PX)
    assert drawing.scale == pytest.approx(100)
    drawing.dot(np.array([1.0, -2.0]), 2)
    drawing.line(np.array([(1.0, 0.0), (5.0, -2.0)]))
    shown = ShownHtml(to_html(drawing.svg))
    assert (shown.all("svg")[0]["width"], shown.all("svg")[0]["height"]) == ("424", "224")
    assert (shown.all("circle")[0]["cx"], shown.all("circle")[0]["cy"]) == ("12.0", "212.0")
    assert shown.all("polyline")[0]["points"] == "12.0,12.0 412.0,212.0"


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -135.0])
def test_an_arrow_points_in_its_direction(yaw_deg):
    drawing = PlanDrawing(np.array([(-1.0, -1.0), (1.0, 1.0)]))
    drawing.arrow(np.zeros(2), np.radians(yaw_deg), "#000000", length_px=20)
    path = ShownHtml(to_html(drawing.svg)).all("path")[0]["d"]
    tip = np.array(path.strip("MZ").split()[0].split(","), float) - drawing.pixels(np.zeros(2))
    assert np.degrees(np.arctan2(-tip[1], tip[0])) == pytest.approx(yaw_deg, abs=1)
    assert np.hypot(*tip) == pytest.approx(12, abs=0.1)
