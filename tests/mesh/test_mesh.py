"""Panoramas of meshes: colours where a wall has them, and the ranges of a generated building, beside its renderer."""

import json
import sys

import numpy as np
import pytest
from conformance import conforms

pytest.importorskip("open3d", reason="the extra `mesh` is not installed: pip install 'salframe[mesh]'")

from salframe_house.building import generate_building
from salframe_house.render import HouseRenderer
from salframe_mesh.dataset import MeshDataset
from salframe_mesh.floors import floor_masks, read_rooms
from salframe_mesh.mesh_file import read_mesh
from salframe_mesh.renderer import MeshRenderer

from salframe.framework.errors import DataError, RequirementMissing
from salframe.panoramas.geometry import pose_2d, rays_to_pixels

from .mesh_files import BLUE, GREEN, RED, write_glb, write_obj, write_ply


def color_towards(panorama, *point):
    column, row = rays_to_pixels(np.array(point, float), len(panorama.rgb))
    return panorama.rgb[int(row), int(column)]


@pytest.mark.parametrize(("write", "name", "up"), [(write_obj, "room.obj", "z"), (write_glb, "room.glb", "y")])
def test_textures_lie_the_right_way_round(tmp_path, write, name, up):
    write(tmp_path)
    panorama = MeshRenderer(read_mesh(tmp_path / name, up)).render(np.eye(4), 128, "p")
    for height, expected in ((0.5, RED), (-0.5, BLUE)):
        assert color_towards(panorama, 2, 0.6, height) == pytest.approx(expected, abs=3)
        assert color_towards(panorama, 2, -0.8, height) == pytest.approx(
            GREEN, abs=3
        )  # the texture's right side is to the right
    assert panorama.range_m[64, 128] == pytest.approx(2.0, abs=0.002)
    assert np.isnan(panorama.range_m[100, 0])
    assert not panorama.valid[100, 0]


def test_materials_without_a_texture_have_their_colour(tmp_path):
    write_obj(tmp_path)
    panorama = MeshRenderer(read_mesh(tmp_path / "room.obj", "z")).render(np.eye(4), 64, "p")
    assert color_towards(panorama, 0.1, 0.1, 1.5) == pytest.approx((51, 102, 153), abs=1)


def test_colours_of_vertices_are_blended_over_polygons(tmp_path):
    corners = [[2, 1, -1], [2, -1, -1], [2, -1, 1], [2, 1, 1]]
    write_ply(tmp_path / "quad.ply", corners, [[0, 1, 2, 3]], [(0, 0, 0), (200, 0, 0), (200, 0, 100), (0, 0, 100)])
    panorama = MeshRenderer(read_mesh(tmp_path / "quad.ply", "z")).render(np.eye(4), 256, "p")
    for y, z in ((0.9, 0.9), (-0.5, 0.2), (0.3, -0.7)):
        assert color_towards(panorama, 2, y, z) == pytest.approx((100 * (1 - y), 0, 50 * (1 + z)), abs=2)


def test_a_library_that_open3d_lacks_is_named(tmp_path, monkeypatch):
    class Finder:
        def find_spec(self, name, path=None, target=None):
            if name == "open3d":
                raise OSError("libusb-1.0.so.0: cannot open shared object file")

    write_obj(tmp_path)
    monkeypatch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
    monkeypatch.delitem(sys.modules, "open3d")
    with pytest.raises(
        RequirementMissing, match=r"Open3D cannot be loaded: libusb-1\.0\.so\.0.*apt install libusb-1\.0-0"
    ):
        read_mesh(tmp_path / "room.obj", "z")


@pytest.fixture(scope="module")
def building():
    return generate_building("home", 4, 3)


@pytest.fixture(scope="module")
def exported(building, tmp_path_factory):
    """A folder with the building's mesh, a colour for each of its instances, and its rooms."""
    root = tmp_path_factory.mktemp("building")
    scene = building.scene()
    corners = scene.vertices_m[scene.triangles].reshape(-1, 3)
    write_ply(
        root / "home.ply",
        corners,
        np.arange(len(corners)).reshape(-1, 3),
        np.repeat(colors(scene.instance_id), 3, axis=0),
    )
    rooms = {}
    for room in building.rooms:
        (x0, y0), (x1, y1) = room.low_m, room.high_m
        rooms[room.id] = {"outline_m": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], "floor_m": 0.0}
    (root / "regions.json").write_text(json.dumps(rooms))
    return root


def colors(instance_id):
    """(N, 3) uint8, another one for each instance."""
    return np.stack([instance_id * 7 % 251, instance_id * 31 % 241, instance_id * 101 % 239], -1).astype(np.uint8)


def test_ranges_are_those_of_the_building_s_own_renderer(building, exported):
    scene = building.scene()
    house, renderer = HouseRenderer(scene, "day", 128), MeshRenderer(read_mesh(exported / "home.ply", "z"))
    random = np.random.default_rng(0)
    points = np.concatenate(list(building.free_space(0.25, 0.1).values()))
    for x, y in points[random.integers(len(points), size=4)]:
        pose = pose_2d(x, y, random.uniform(-np.pi, np.pi), random.uniform(0.6, 1.8))
        range_m, instance_id = house.geometry(pose)
        panorama = renderer.render(pose, 128, "p")
        assert np.array_equal(np.isnan(range_m), np.isnan(panorama.range_m))
        assert np.nanmax(np.abs(range_m - panorama.range_m)) < 0.001
        same = np.ones_like(instance_id, bool)
        for shift in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            same &= np.roll(instance_id, shift, (0, 1)) == instance_id
        same &= ~np.isnan(range_m)
        assert np.mean(np.abs(panorama.rgb[same].astype(int) - colors(instance_id[same])) <= 1) > 0.97


def test_floor_masks_are_those_of_the_generator(building, exported):
    surface = read_mesh(exported / "home.ply", "z")
    masks, truth = floor_masks(surface, MeshRenderer(surface), read_rooms(exported), 0.05), building.floor_masks(0.05)
    row, column = np.nonzero(truth.free)
    x, y = truth.origin_m[0] + (column + 0.5) * 0.05, truth.origin_m[1] - (row + 0.5) * 0.05
    at = ((masks.origin_m[1] - y) / 0.05).astype(int), ((x - masks.origin_m[0]) / 0.05).astype(int)
    assert masks.z_m == 0.0
    assert masks.free[at].mean() > 0.99
    names = np.array(["", *(truth.regions[i] for i in range(1, len(truth.regions) + 1))])
    found = np.array(["", *(masks.regions[i] for i in range(1, len(masks.regions) + 1))])
    assert np.mean(found[masks.region[at]] == names[truth.region[row, column]]) > 0.99
    # Two cells beside walls and furniture may differ: footprints are boxes there, and a table's underside is in the way
    # here.
    clear, true_clear = masks.free[at] & ~masks.obstacle[at], ~truth.obstacle[row, column]
    assert np.mean(clear == true_clear) > 0.93
    doors = [
        ((masks.origin_m[1] - d.centre_m[1]) / 0.05, (d.centre_m[0] - masks.origin_m[0]) / 0.05) for d in building.doors
    ]
    assert all(masks.free[int(r), int(c)] and not masks.obstacle[int(r), int(c)] for r, c in doors)


@pytest.fixture
def dataset(exported, tmp_path, monkeypatch):
    """Two reference frames and a query of frames.csv."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    for path in exported.iterdir():
        (tmp_path / "data" / path.name).parent.mkdir(exist_ok=True)
        (tmp_path / "data" / path.name).symlink_to(path)
    rows = [
        "id,role,place,x_m,y_m,z_m,yaw_rad",
        "m1,map,kitchen,2.0,4.0,1.5,0.3",
        "m2,map,hall,4.0,0.0,1.5,0",
        "q1,query,hall,4.5,0.2,1.4,2.0",
    ]
    (tmp_path / "data" / "frames.csv").write_text("\n".join(rows))
    return MeshDataset(MeshDataset.Config(root=tmp_path / "data", height=64))


def test_frames_are_rendered_where_the_table_says(dataset):
    seen = []
    dataset.prepare(lambda done, total: seen.append((done, total)))
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]
    (fold,) = dataset.folds()
    assert [(frame.id, frame.place) for frame in fold.references] == [("m1", "kitchen"), ("m2", "hall")]
    (query,) = fold.queries
    truth = dataset.truth("q1")
    assert np.allclose(truth.T_world_pano, pose_2d(4.5, 0.2, 2.0, 1.4))
    observed = dataset.observe(truth.T_world_pano)
    assert np.nanmax(np.abs(query.load().range_m - observed.range_m)) < 0.0006  # kept in whole millimetres
    (floor,) = dataset.floors()
    assert floor.free.any()
    assert conforms(MeshDataset, dataset.config)


def test_a_house_file_gives_frames_and_queries_beside_them(exported, building, tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    (tmp_path / "home.ply").symlink_to(exported / "home.ply")
    lines = ["ASCII 1.1"]
    for index, room in enumerate(building.rooms):
        x, y = building.free_space(0.4, 0.1)[room.id][0]
        lines.append(
            f"R  {index} 0  0 0  b  0 0 0  {room.low_m[0]} {room.low_m[1]} 0  "
            f"{room.high_m[0]} {room.high_m[1]} 2.6  2.6  0 0 0 0"
        )
        lines.append(f"P  {index:032x}  {index} {index}  0  {x} {y} 1.5  0 0 0 0 0")
    (tmp_path / "home.house").write_text("\n".join(lines))
    dataset = MeshDataset(MeshDataset.Config(root=tmp_path, height=64, queries_per_frame=2))
    dataset.prepare(lambda done, total: None)
    (fold,) = dataset.folds()
    (floor,) = dataset.floors()
    assert len(fold.references) == len(building.rooms)
    assert len(fold.queries) == 2 * len(building.rooms)
    poses = {frame.place: frame.T_world_pano for frame in fold.references}
    for query in fold.queries:
        truth = dataset.truth(query.id)
        x, y, z = truth.T_world_pano[:3, 3]
        assert 0.3 <= np.linalg.norm(truth.T_world_pano[:3, 3] - poses[truth.place][:3, 3]) <= 1.1
        at = int((floor.origin_m[1] - y) / 0.05), int((x - floor.origin_m[0]) / 0.05)
        assert floor.regions[floor.region[at]] == truth.place
        assert floor.free[at]
        assert not floor.obstacle[at]
        assert z == 1.5


def test_the_fingerprint_follows_frames_and_mesh_but_not_the_folder(dataset, exported):
    root = dataset.config.root
    first = dataset.fingerprint
    assert MeshDataset(dataset.config).fingerprint == first
    (root / "frames.csv").write_text((root / "frames.csv").read_text() + "\nq2,query,hall,4.4,0.2,1.4,2.0")
    second = MeshDataset(dataset.config).fingerprint
    assert second != first
    (root / "home.ply").unlink()
    (root / "home.ply").write_bytes((exported / "home.ply").read_bytes() + b" ")
    assert MeshDataset(dataset.config).fingerprint not in (first, second)


def test_bad_input_is_one_clear_line(tmp_path, capfd):
    def prepared(**settings):
        MeshDataset(MeshDataset.Config(root=tmp_path, **settings)).prepare(lambda done, total: None)

    with pytest.raises(DataError, match="--data-dir DIR"):
        MeshDataset().prepare(lambda done, total: None)
    with pytest.raises(DataError, match=r"has 0 \.house files and no frames\.csv"):
        prepared()
    (tmp_path / "frames.csv").write_text("id,role,place\n")
    with pytest.raises(DataError, match="has no column x_m and no column y_m"):
        prepared()
    header = "id,role,place,x_m,y_m,z_m,yaw_rad\n"
    (tmp_path / "frames.csv").write_text(header + "a,map,hall,1,2,high,0\n")
    with pytest.raises(DataError, match=r"frames\.csv, line 2: received .*'high'.*, expected finite numbers in x_m"):
        prepared()
    (tmp_path / "frames.csv").write_text(header + "a,query,hall,1,2,1.5,0\n")
    with pytest.raises(DataError, match=r"frames\.csv has no row with the role 'map'"):
        prepared()
    (tmp_path / "frames.csv").write_text(header + "a,map,hall,1,2,1.5,0\na,map,hall,1,2,1.5,0\n")
    with pytest.raises(DataError, match=r"frames\.csv, line 3: the frame id 'a' occurs twice"):
        prepared()
    (tmp_path / "frames.csv").write_text(header + "a,map,hall,1,2,1.5,0\n")
    with pytest.raises(DataError, match="has no mesh, expected a file with the suffix "):
        prepared()
    write_ply(tmp_path / "bare.ply", np.eye(3), np.zeros((0, 3), int))
    with pytest.raises(DataError, match=r"bare\.ply has no faces"):
        prepared()
    whole = (tmp_path / "bare.ply").read_bytes()
    (tmp_path / "bare.ply").write_bytes(whole.replace(b"vertex 3", b"vertex 1000000000000"))
    with pytest.raises(
        DataError,
        match=r"bare\.ply is not a mesh: the header states 1000000000000 elements, expected an integer of at most 217",
    ):
        prepared()
    write_ply(tmp_path / "bare.ply", np.diag([1.0, 1.0, np.inf]), [[0, 1, 2]])
    with pytest.raises(DataError, match=r"bare\.ply has a vertex that is not finite"):
        prepared()
    with pytest.raises(DataError, match=r"cannot read .*other\.obj: No such file"):
        prepared(mesh="other.obj")
    (tmp_path / "cut.glb").write_bytes(b"glTF\x02\x00")
    with pytest.raises(DataError, match=r"cut\.glb has no faces"):
        prepared(mesh="cut.glb")
    (tmp_path / "regions.json").write_text('{"hall": {"outline_m": [[0, 0], [1]]}}')
    with pytest.raises(DataError, match=r"regions\.json: key hall\.outline_m"):
        prepared(mesh="bare.ply")
    assert "Open3D" not in capfd.readouterr().out
