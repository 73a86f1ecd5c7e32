"""Topological maps and routes as notebooks show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plans import two_rooms
from shown_html import HOSTILE, SHOWN, ShownHtml

from salframe.topology.planner import Route
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap

EDGES = (
    MapEdge(HOSTILE, "door", 2.0, 0.0),
    MapEdge("door", "east", 3.0, np.radians(45), ((0.0, 0.0), (1.0, 0.0), (1.0, 2.0))),
)


def topology() -> TopologicalMap:
    floor = two_rooms()
    nodes = (
        MapNode(HOSTILE, NodeKind.SCENE, (-2.0, 0.0, 0.0), ("west",)),
        MapNode("door", NodeKind.TRANSITION, (0.0, 0.0, 0.0), ("west", "east")),
        MapNode("east", NodeKind.SCENE, (1.0, 1.0, 0.0), ("east",)),
    )
    return TopologicalMap(nodes, EDGES, (replace(floor, regions={1: HOSTILE, 2: "east"}),), notes=(HOSTILE,))


def test_a_map_is_drawn_with_its_nodes_where_they_are():
    shown = ShownHtml(topology()._repr_html_())
    assert shown.texts[0] == "2 scene nodes, 1 transition nodes, 2 edges, 5.0 m in all"
    assert {SHOWN, "east", f"note: {SHOWN}"} <= set(shown.texts)
    at = np.array([(float(dot["cx"]), float(dot["cy"])) for dot in shown.all("circle")])
    scale = (at[1, 0] - at[0, 0]) / 2.0
    assert at[2] - at[1] == pytest.approx(np.array([scale, -scale]), abs=0.2)
    lines = [line["points"].split() for line in shown.all("polyline")]
    assert [len(line) for line in lines] == [2, 3]
    assert lines[0][0] == f"{at[0, 0]:.1f},{at[0, 1]:.1f}"


def test_nodes_are_drawn_on_their_floor():
    floor = two_rooms()
    upper = replace(floor, z_m=3.0)
    nodes = (*topology().nodes, MapNode("top", NodeKind.SCENE, (-1.0, 0.0, 3.0), ("west",)))
    shown = ShownHtml(TopologicalMap(nodes, EDGES, (upper, floor))._repr_html_())
    assert [text for text in shown.texts if text.startswith("floor")] == ["floor at z = 0 m", "floor at z = 3 m"]
    assert shown.texts.index("top") > shown.texts.index("floor at z = 3 m")
    assert len(shown.all("circle")) == 4


def test_a_map_without_floors_has_counts():
    assert ShownHtml(TopologicalMap((), ())._repr_html_()).texts == ["no nodes, 0 edges, 0.0 m in all"]


def test_a_route_has_a_table_and_its_shape():
    shown = ShownHtml(Route((HOSTILE, "door", "east"), EDGES, 5.0)._repr_html_())
    assert shown.texts[0] == f"{SHOWN} to east: 5.00 m"
    assert shown.texts[5:9] == [SHOWN, "door", "2.00", "0"]
    at = np.array([(float(dot["cx"]), float(dot["cy"])) for dot in shown.all("circle")])
    assert at - at[0] == pytest.approx(np.array([(0, 0), (2, 0), (3, -2)]) * (320 - 24) / 3, abs=0.2)


def test_a_route_without_legs_is_shown():
    assert ShownHtml(Route(("here",), (), 0.0)._repr_html_()).texts == ["here to here: 0.00 m"]
