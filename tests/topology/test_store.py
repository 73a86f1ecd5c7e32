"""Maps on disk, exported maps, and pictures of maps."""

from __future__ import annotations

import json
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
import shapely
from PIL import Image
from plans import block, frame, two_rooms
from salframe_house.building import generate_building

from salframe.drawing.floor_picture import draw_topology
from salframe.framework.errors import ConfigError, DataError
from salframe.localization.map_files import write_map
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind
from salframe.topology.build import build_topology
from salframe.topology.export import export_map
from salframe.topology.store import open_topology, write_topology
from salframe.topology.topological_map import TopologicalMap


@pytest.fixture(scope="module")
def topology() -> TopologicalMap:
    """Two floors, with an edge around a corner on the lower one."""
    upper = two_rooms(door_m=0.7, z_m=3.1)
    upper = FloorMasks(
        upper.free, upper.region, upper.obstacle, upper.resolution_m, upper.origin_m, {1: "loft", 2: "attic"}, upper.z_m
    )
    lower = block(two_rooms(wall_m=0.2), (-1.6, -1.0), (-0.9, 1.0))
    frames = [frame("a", -2.5, 0.0), frame("b", 1.5, 0.3, "east"), frame("d", 0.1, 0.0, "door", FrameKind.TRANSITION)]
    return build_topology([lower, upper], [*frames, frame("up", 1.0, 1.0, "attic", z_m=4.6)])


def save(topology: TopologicalMap, directory: Path) -> None:
    with write_map(directory) as parts:
        write_topology(parts, topology)


def test_a_map_is_read_back_identical(topology, tmp_path):
    save(topology, tmp_path)
    read = open_topology(tmp_path)
    assert read == topology
    assert any(edge.path_m for edge in read.edges)
    for stored, floor in zip(read.floors, topology.floors, strict=True):
        for name in ("free", "region", "obstacle"):
            np.testing.assert_array_equal(getattr(stored, name), getattr(floor, name))
        assert (stored.resolution_m, stored.origin_m, stored.regions, stored.z_m) == (
            floor.resolution_m,
            floor.origin_m,
            floor.regions,
            floor.z_m,
        )
    assert read.parameters.model_dump() == {
        "robot_radius_m": 0.18,
        "min_doorway_m": 0.5,
        "snap_m": 0.5,
        "doorway_reach_m": 0.5,
        "choose": False,
    }
    assert len(read.notes) > 0


def test_a_map_of_a_building_is_read_back_identical(tmp_path):
    made = build_topology([generate_building("office", 18, 1).floor_masks()])
    save(made, tmp_path)
    assert open_topology(tmp_path) == made


def test_a_map_without_a_topology_is_one_line(tmp_path):
    with write_map(tmp_path):
        pass
    with pytest.raises(DataError, match="contains no topology: build the map again, from data with floor masks"):
        open_topology(tmp_path)


def test_graphml_is_read_by_networkx(topology, tmp_path):
    save(topology, tmp_path / "map")
    export_map(tmp_path / "map", tmp_path / "map.graphml")
    graph = nx.read_graphml(tmp_path / "map.graphml")
    assert set(graph) == {node.id for node in topology.nodes}
    for node in topology.nodes:
        data = graph.nodes[node.id]
        assert (data["kind"], data["x_m"], data["y_m"], data["z_m"]) == (node.kind, *node.xyz_m)
        assert data["regions"] == ";".join(node.regions)
    assert graph.number_of_edges() == len(topology.edges)
    for edge in topology.edges:
        data = graph.get_edge_data(edge.start, edge.end)
        data = data[0] if graph.is_multigraph() else data
        assert data["length_m"] == edge.length_m
        assert np.cos(np.radians(data["azimuth_deg"]) - edge.azimuth_rad) == pytest.approx(1)


def test_geojson_holds_points_and_lines_in_local_metres(topology, tmp_path):
    save(topology, tmp_path / "map")
    export_map(tmp_path / "map", tmp_path / "map.geojson")
    content = json.loads((tmp_path / "map.geojson").read_text())
    assert "crs" not in content
    assert "metres" in content["properties"]["coordinates"]
    shapes = [
        (shapely.from_geojson(json.dumps(feature["geometry"])), feature["properties"])
        for feature in content["features"]
    ]
    points = {properties["id"]: shape for shape, properties in shapes if shape.geom_type == "Point"}
    assert {name: (p.x, p.y, p.z) for name, p in points.items()} == {node.id: node.xyz_m for node in topology.nodes}
    lines = [(shape, properties) for shape, properties in shapes if shape.geom_type == "LineString"]
    assert len(lines) == len(topology.edges)
    for line, properties in lines:
        assert line.length == pytest.approx(properties["length_m"])
        assert shapely.Point(line.coords[0]).distance(points[properties["start"]]) == pytest.approx(0)
        assert shapely.Point(line.coords[-1]).distance(points[properties["end"]]) == pytest.approx(0)


def test_another_suffix_is_refused(tmp_path):
    message = r"received the file map\.dot, expected one that ends in \.json, .* or \.parquet"
    with pytest.raises(ConfigError, match=message):
        export_map(tmp_path, tmp_path / "map.dot")


def test_the_picture_has_a_mark_for_each_node_in_its_place(tmp_path):
    """The distance of the marks in the picture is that of the nodes, at the scale of the floor's width."""
    floor = two_rooms(wall_m=0.2)
    made = build_topology([floor], [frame("a", -2.0, 0.5), frame("b", 2.0, -0.5, "east")])
    draw_topology(made, tmp_path / "map.png")
    picture = np.asarray(Image.open(tmp_path / "map.png").convert("RGB")).astype(int)
    picture = picture[80:-100]  # without title and legend
    blue = np.abs(picture - (31, 78, 160)).sum(2) < 12
    rows, columns = np.nonzero(blue)
    left, right = columns < np.median(columns), columns >= np.median(columns)
    across, down = columns[right].mean() - columns[left].mean(), rows[right].mean() - rows[left].mean()
    wall = (np.abs(picture - (92, 96, 104)).sum(2) < 12).any(0).nonzero()[0]
    scale = (
        wall.max() - wall.min() + 1
    ) / 6.3  # two rooms of 3 m, the wall between them, and what the masks show of the outer walls
    assert across / scale == pytest.approx(4.0, abs=0.05)
    assert down / scale == pytest.approx(1.0, abs=0.05)
    assert (np.abs(picture - (214, 84, 34)).sum(2) < 12).sum() > 25


def test_floors_are_drawn_below_each_other(topology, tmp_path):
    draw_topology(topology, tmp_path / "both.png")
    one = TopologicalMap(topology.nodes, topology.edges, topology.floors[:1], topology.parameters)
    draw_topology(one, tmp_path / "one.png")
    both, single = (Image.open(tmp_path / name).size for name in ("both.png", "one.png"))
    assert both[1] > 1.8 * single[1]
