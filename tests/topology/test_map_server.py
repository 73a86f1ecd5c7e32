"""Occupancy maps of ROS map_server, with the file layout of its specification."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from plans import frame

from salframe.framework.errors import DataError
from salframe.topology.build import build_topology
from salframe.topology.derived_floors import derive_floors
from salframe.topology.map_server import read_map_server
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
