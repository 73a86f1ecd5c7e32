"""The files of map_server, read by PyYAML and Pillow as the specification of nav2_map_server says."""

from __future__ import annotations

import numpy as np
import yaml
from PIL import Image

from salframe.panoramas.floors import FloorMasks
from salframe.topology.map_server import write_map_server


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
