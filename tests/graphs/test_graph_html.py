"""Saliency graphs as notebooks show them."""

from __future__ import annotations

import numpy as np
import pytest
from shown_html import HOSTILE, SHOWN, ShownHtml

from salframe.graphs.graph import SaliencyGraph, without_range


def graph() -> SaliencyGraph:
    return SaliencyGraph(
        (HOSTILE, "bed"),
        np.ones(2),
        np.array([0.8, 0.2]),
        np.array([(2.0, 0.0, 0.0), (0.0, 2.0, 0.0)]),
        np.ones((2, 3)),
        np.zeros(2),
        np.array([(0, 1)]),
    )


def test_ahead_is_up_and_left_is_left():
    shown = ShownHtml(graph()._repr_html_())
    assert shown.texts[0] == "2 nodes, 1 edges"
    ahead, left = (np.array([float(dot["cx"]), float(dot["cy"])]) for dot in shown.all("circle"))
    arrow = shown.all("path")[-1]["d"].strip("MZ").split()
    camera = np.array([point.split(",") for point in (arrow[1], arrow[3])], float).mean(0)
    assert ahead[0] == pytest.approx(camera[0], abs=0.2)
    assert ahead[1] < camera[1]
    assert left[0] < camera[0] - 10
    assert np.hypot(*(ahead - left)) == pytest.approx(np.hypot(2, 2) / 3.0 * 396, rel=0.01)  # 3 m in 396 pixels


def test_areas_of_nodes_are_proportional_to_their_saliency():
    first, second = (float(dot["r"]) - 2 for dot in ShownHtml(graph()._repr_html_()).all("circle"))
    assert first**2 / second**2 == pytest.approx(4, rel=0.02)


def test_labels_are_escaped():
    texts = ShownHtml(graph()._repr_html_()).texts
    assert SHOWN in texts
    assert f"{SHOWN}: saliency 0.800" in texts


def test_nodes_without_range_are_rays():
    shown = ShownHtml(without_range(graph())._repr_html_())
    assert len(shown.all("polyline")) == 2
    assert len(shown.all("path")) == 1  # the camera


def test_an_empty_graph_is_shown():
    empty = SaliencyGraph((), np.zeros(0), np.zeros(0), *[np.zeros((0, 3))] * 2, np.zeros(0), np.zeros((0, 2), int))
    assert ShownHtml(empty._repr_html_()).texts == ["0 nodes, 0 edges"]
