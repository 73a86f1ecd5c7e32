"""Routes to the signs of a saved map."""

import pytest
from command_line import run

from salframe.framework.errors import UnknownName
from salframe.topology.building_map import build_map
from salframe.topology.routes import find_nodes, find_route
from salframe.topology.store import open_topology

SETTINGS = ["data.rooms=4", "data.rgb=false", "data.signs=true", "data.height=256", "proposed.detector.noise=none"]


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map") / "map"
    build_map("house-6", folder, overrides=SETTINGS)
    return folder


def test_a_route_leads_to_the_node_nearest_to_a_sign(saved):
    from salframe_house.rendering import buildings

    topology = open_topology(saved)
    house = buildings("home", 4, 0, 0.1, signs=True)[0]
    positions = {node.id: node.xyz_m for node in topology.nodes if node.frames}
    checked = 0
    for sign in house.signs:
        text = sign.label.removeprefix("text: ")
        if text not in topology.signs:
            continue
        x_m, y_m, _ = positions[topology.signs[text]]
        twins = [other for other in house.signs if other.label == sign.label]
        # one of the two signs of the room is within sight of the node, in the room or at its door
        assert min((x_m - other.x_m) ** 2 + (y_m - other.y_m) ** 2 for other in twins) < 4.5**2
        checked += 1
    assert checked >= 4
    (node,) = find_nodes(topology, "1.02")
    start = next(other for other in positions if other != node)
    assert find_route(topology, start, "1.02").nodes == find_route(topology, start, node).nodes


def test_the_command_takes_the_text_and_an_unknown_one_is_one_line(saved):
    topology = open_topology(saved)
    node = topology.signs["1.02"]
    start = next(other.id for other in topology.nodes if other.frames and other.id != node)
    shown = run("map", "route", saved, start, "1.02")
    assert node in shown.out
    with pytest.raises(UnknownName, match=r"unknown node, place or sign '9\.99'"):
        find_nodes(topology, "9.99")
