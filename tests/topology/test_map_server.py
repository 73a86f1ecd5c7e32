"""Occupancy maps of ROS: files that PyYAML and Pillow read as the specification of nav2_map_server says, and back."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from PIL import Image
from plans import frame

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks
from salframe.topology.build import build_topology
from salframe.topology.derived_floors import derive_floors
from salframe.topology.map_server import read_map_server, write_map_server
from salframe.topology.topological_map import NodeKind, PartSource

YAML = "image: map.pgm\nresolution: 0.1\norigin: [-3.0, -1.5, {yaw}]\nnegate: {negate}\noccupied_thresh: 0.65\n"


def write_map(folder, *, negate: int = 0, yaw: float = 0.0):
    """Two rooms west and east of a wall at x = -0.1 to 0.1 with a doorway around (0, 0), 6 m x 3 m, 0.1 m per pixel."""
    grey = np.full((30, 60), 254, np.uint8)  # free
    grey[[0, -1]] = grey[:, [0, -1]] = 0
    grey[:10, 29:31] = grey[20:, 29:31] = 0
    grey[1:4, 50:59] = 205  # unknown: the upper right corner
    Image.fromarray(255 - grey if negate else grey).save(folder / "map.pgm")
    path = folder / "map.yaml"
    path.write_text(YAML.format(yaw=yaw, negate=negate) + "free_thresh: 0.196\n")
    return path


@pytest.mark.parametrize("negate", [0, 1])
def test_free_space_has_the_metric_extent_of_the_map(tmp_path, negate):
    space = read_map_server(write_map(tmp_path, negate=negate))
    assert space.origin_m == pytest.approx((-3.0, 1.5))
    assert space.resolution_m == 0.1
    assert int(space.walkable.sum()) == 28 * 58 - 2 * 18 - 3 * 9
    inside = {(-2.0, 0.0): True, (0.0, 0.0): True, (0.0, 1.0): False, (2.5, 1.3): False, (2.5, -1.3): True}
    for (x, y), walkable in inside.items():
        row, column = space.cells(np.array([[x, y]]))[0]
        assert space.walkable[row, column] == walkable


def test_regions_of_a_robot_map_grow_from_places(tmp_path):
    frames = [frame("a", -2.0, 0.0), frame("b", 1.5, 0.2, "east")]  # they have no range
    plan = derive_floors(frames, space=read_map_server(write_map(tmp_path)))
    topology = build_topology(plan.floors, plan.frames, sources=plan.sources)
    (door,) = [node for node in topology.nodes if node.kind is NodeKind.TRANSITION]
    assert set(door.regions) == {"west", "east"}
    assert np.hypot(*door.xyz_m[:2]) <= 0.2
    assert topology.sources.free_space is PartSource.MAP_FILE


def test_a_rotated_map_and_two_storeys_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"yaw of 0\.5 rad, expected 0"):
        read_map_server(write_map(tmp_path, yaw=0.5))
    frames = [frame("a", -2.0, 0.0), frame("b", 1.5, 0.2, "east", z_m=4.5)]
    with pytest.raises(DataError, match="on 2 storeys, expected one"):
        derive_floors(frames, space=read_map_server(write_map(tmp_path)))


def test_free_floor_and_obstacles_are_where_they_are_in_the_world(tmp_path):
    free, obstacle = np.zeros((20, 30), bool), np.zeros((20, 30), bool)
    free[5:15, 5:25] = True
    obstacle[8, 10] = True
    floor = FloorMasks(free, np.zeros((20, 30), np.int32), obstacle, 0.1, (2.0, 5.0), {}, 0.0)
    written = write_map_server([floor], tmp_path / "floor.yaml")
    assert [path.name for path in written] == ["floor.yaml", "floor.pgm"]
    description = yaml.safe_load(written[0].read_text())
    image = np.array(Image.open(tmp_path / description["image"]))
    occupancy = (255 - image.astype(float)) / 255
    assert description["negate"] == 0
    assert description["mode"] == "trinary"

    def at(x_m, y_m):
        left, bottom, yaw = description["origin"]
        column = int((x_m - left) / description["resolution"])
        row = image.shape[0] - 1 - int((y_m - bottom) / description["resolution"])
        assert yaw == 0
        value = occupancy[row, column]
        return (
            "occupied"
            if value > description["occupied_thresh"]
            else "free"
            if value < description["free_thresh"]
            else "unknown"
        )

    assert at(2.75, 4.25) == "free"
    assert at(3.05, 4.15) == "occupied"  # the obstacle: row 8, column 10
    assert at(2.45, 4.25) == "occupied"  # the wall beside the free floor
    assert at(2.15, 4.25) == "unknown"


def test_each_storey_has_files_of_its_own(tmp_path):
    free = np.ones((4, 4), bool)
    masks = [FloorMasks(free, np.zeros((4, 4), np.int32), ~free, 0.1, (0.0, 0.0), {}, z_m) for z_m in (3.0, 0.0)]
    names = [path.name for path in write_map_server(masks, tmp_path / "house.yaml")]
    assert names == ["house-1.yaml", "house-1.pgm", "house-2.yaml", "house-2.pgm"]
    assert "z = 0 m" in (tmp_path / "house-1.yaml").read_text()


def test_a_written_floor_is_read_at_the_same_positions(tmp_path):
    free, obstacle = np.zeros((20, 30), bool), np.zeros((20, 30), bool)
    free[5:15, 5:25] = True
    obstacle[8, 10] = True
    floor = FloorMasks(free, np.zeros((20, 30), np.int32), obstacle, 0.05, (-2.35, 5.1), {}, 0.0)
    write_map_server([floor], tmp_path / "floor.yaml")
    space = read_map_server(tmp_path / "floor.yaml")
    np.testing.assert_array_equal(space.walkable, free & ~obstacle)
    assert space.origin_m == pytest.approx(floor.origin_m, abs=1e-9)
    assert space.resolution_m == 0.05
