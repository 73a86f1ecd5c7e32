"""Floor masks from top-down maps: a drawn building whose scale and origin are known, and the real one where it is at
hand."""

import cv2
import numpy as np
import pytest
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.habitat_maps import HabitatMaps, read_floor
from salframe_matterport.readers import connectivity_path, read_connectivity, read_regions, regions_path

from salframe.framework.errors import DataError

PIXEL_M, ORIGIN_M, SIZE = 0.02, (-3.0, 5.0), (300, 500)
# Region -> (x low, y low, x high, y high), colour. Regions 0 and 2 share a colour, as indices 99 apart do; region 3 is
# on the level above.
ROOMS = {
    0: ((-2.5, 0.0, 1.0, 4.0), (100, 100, 5)),
    1: ((1.1, 0.0, 3.0, 4.0), (0, 0, 255)),
    2: ((3.1, 0.5, 6.5, 4.5), (100, 100, 5)),
}
FLOOR, TABLE, DOOR = (0, 255, 0), (255, 0, 235), (246, 0, 0)


def pixels(low_x, low_y, high_x, high_y):
    """The rectangle as rows and columns of the pictures."""
    column = [round((x - ORIGIN_M[0]) / PIXEL_M) for x in (low_x, high_x)]
    row = [round((ORIGIN_M[1] - y) / PIXEL_M) for y in (high_y, low_y)]
    return slice(*row), slice(*column)


@pytest.fixture
def drawn(tmp_path):
    """The pictures and the .house file of the three rooms: a table in room 1, a doorway from 0 to 1 striped by both, a
    stain in room 2."""
    region, category = np.zeros((*SIZE, 3), np.uint8), np.zeros((*SIZE, 3), np.uint8)
    for box, colour in ROOMS.values():
        region[pixels(*box)], category[pixels(*box)] = colour, FLOOR
    doorway = pixels(1.0, 2.0, 1.1, 3.0)
    region[doorway], category[doorway] = ROOMS[0][1], DOOR
    region[pixels(1.1, 2.0, 1.16, 3.0)] = ROOMS[0][1]
    region[pixels(1.02, 2.0, 1.06, 3.0)] = ROOMS[1][1]
    region[pixels(5.0, 2.0, 5.3, 2.3)] = (133, 125, 189)
    category[pixels(1.5, 1.0, 2.5, 2.0)] = TABLE
    folder = tmp_path / "habitat_map" / "drawn"
    folder.mkdir(parents=True)
    for name, picture in (("region", region), ("cat", category)):
        cv2.imwrite(str(folder / f"{name}.png"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGRA))
    boxes = {**{number: (0, box) for number, (box, _) in ROOMS.items()}, 3: (1, (-2.5, 0.0, 6.5, 2.0))}
    lines = ["ASCII 1.1"]
    for number, (level, (x0, y0, x1, y1)) in boxes.items():
        lines.append(
            f"R  {number} {level}  0 0  b  0 0 0  {x0} {y0} {level + 0.2}  {x1} {y1} {level + 2.5}  2.5  0 0 0 0"
        )
    (tmp_path / "house").mkdir()
    (tmp_path / "house" / "drawn.house").write_text("\n".join(lines))
    return tmp_path


def cell(floor, x, y):
    return int((floor.origin_m[1] - y) / floor.resolution_m), int((x - floor.origin_m[0]) / floor.resolution_m)


def test_scale_and_origin_come_from_the_boxes_of_the_regions(drawn):
    floor = read_floor(drawn, "drawn", 0.06)
    assert floor.resolution_m == pytest.approx(3 * PIXEL_M, rel=0.005)
    assert floor.origin_m == pytest.approx(ORIGIN_M, abs=0.03)
    assert floor.z_m == pytest.approx(0.2)
    assert floor.free.shape == (100, 167)
    assert floor.regions == {1: "drawn/region-0", 2: "drawn/region-1", 3: "drawn/region-2"}


def test_every_cell_of_a_room_has_its_label_also_where_colours_collide(drawn):
    floor = read_floor(drawn, "drawn", 0.06)
    for number, ((x0, y0, x1, y1), _) in ROOMS.items():
        for x, y in np.random.default_rng(number).uniform((x0 + 0.2, y0 + 0.1), (x1 - 0.1, y1 - 0.1), (200, 2)):
            assert floor.free[cell(floor, x, y)]
            assert floor.region[cell(floor, x, y)] == number + 1
    area = (floor.region > 0).sum() * floor.resolution_m**2
    assert area == pytest.approx(3.5 * 4 + 1.9 * 4 + 3.4 * 4 + 0.1, rel=0.02)
    assert not floor.free[cell(floor, 1.05, 1.0)]


def test_a_doorway_changes_its_label_once(drawn):
    floor = read_floor(drawn, "drawn", 0.06)
    across = floor.region[cell(floor, 0.5, 2.5)[0], cell(floor, 0.5, 2.5)[1] : cell(floor, 2.0, 2.5)[1]]
    assert set(across) == {1, 2}
    assert (np.diff(across) != 0).sum() == 1


def test_objects_are_obstacles_and_doors_are_not(drawn):
    floor = read_floor(drawn, "drawn", 0.06)
    assert floor.obstacle.sum() * floor.resolution_m**2 == pytest.approx(1.0, rel=0.12)
    assert floor.obstacle[cell(floor, 2.0, 1.5)]
    assert not floor.obstacle[cell(floor, 1.05, 2.5)]


def test_bad_input_is_one_clear_line(drawn):
    folder = drawn / "habitat_map" / "drawn"
    whole = (folder / "cat.png").read_bytes()
    (folder / "cat.png").write_bytes(whole[:200])
    with pytest.raises(DataError, match=r"cat\.png is not a readable image \(file size 200 bytes\)"):
        read_floor(drawn, "drawn", 0.05)
    cv2.imwrite(str(folder / "cat.png"), np.zeros((10, 20, 3), np.uint8))
    with pytest.raises(
        DataError, match=r"region\.png is 500 x 300 pixels and cat\.png is 20 x 10, expected the same size"
    ):
        read_floor(drawn, "drawn", 0.05)
    (folder / "cat.png").unlink()
    with pytest.raises(DataError, match=r"cat\.png is missing, expected the top-down map of the categories of objects"):
        read_floor(drawn, "drawn", 0.05)
    (folder / "cat.png").write_bytes(whole)
    house = drawn / "house" / "drawn.house"
    house.write_text("R  0 0  0 0  b  0 0 0  0 0 0  1 9 2.5  2.5\nR  1 0  0 0  b  0 0 0  1 0 0  2 0.5 2.5  2.5")
    with pytest.raises(DataError, match=r"does not match the \.house file: 0 of 3 coloured areas"):
        read_floor(drawn, "drawn", 0.05)
    house.write_text("R  0 0  0 0  b")
    with pytest.raises(DataError, match=r"drawn\.house is not a \.house file .* begins with 'R 0' has 6 words"):
        read_floor(drawn, "drawn", 0.05)
    house.unlink()
    with pytest.raises(
        DataError, match=r"cannot read .*drawn\.house: No such file or directory, expected .* \(house_segmentations"
    ):
        read_floor(drawn, "drawn", 0.05)


def test_buildings_without_maps_are_left_out(building):
    dataset = HabitatMaps(HabitatMaps.Config(root=building.root))
    with pytest.raises(DataError, match="has no folder habitat_map/<scan>/, expected one with"):
        dataset.folds()
    (building.root / "habitat_map" / "fake").mkdir(parents=True)
    assert [fold.id for fold in HabitatMaps(HabitatMaps.Config(root=building.root)).folds()] == ["fake/a", "fake/b"]
    (building.root / "habitat_map" / "twin").mkdir()
    (building.root / "connectivity" / "twin_connectivity.json").write_text("[]")
    with pytest.raises(
        DataError,
        match=r"has top-down maps of fake, twin, expected one building: select one with --set data\.scans=\[fake\]",
    ):
        HabitatMaps(HabitatMaps.Config(root=building.root)).folds()


def test_real_viewpoints_stand_on_the_floor_of_their_regions(real_root):
    dataset = HabitatMaps(HabitatMaps.Config(root=real_root))
    (floor,) = dataset.floors()
    poses = read_connectivity(connectivity_path(real_root, "17DRP5sb8fy"))
    regions = read_regions(regions_path(real_root))["17DRP5sb8fy"]
    cells = {name: cell(floor, *pose[:2, 3]) for name, pose in poses.items()}
    assert 0.04 < floor.resolution_m < 0.06
    assert floor.z_m == pytest.approx(0, abs=0.02)
    assert all(floor.free[at] for at in cells.values())
    # Some stand on a sofa or in a shower; some regions of the annotation end a step beside the threshold.
    assert np.mean([not floor.obstacle[at] for at in cells.values()]) > 0.95
    assert (
        np.mean(
            [floor.regions[floor.region[at]] == f"17DRP5sb8fy/region-{regions[name]}" for name, at in cells.items()]
        )
        > 0.9
    )
    scenes = {frame.id for fold in dataset.folds() for frame in fold.references}
    alone = MatterportAnnotations(MatterportAnnotations.Config(root=real_root, scans=("17DRP5sb8fy",)))
    assert scenes == {frame.id for fold in alone.folds() for frame in fold.references}
