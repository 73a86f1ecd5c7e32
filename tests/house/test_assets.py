"""A library of two models in Sweet Home 3D's format, written here."""

from __future__ import annotations

import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from salframe.framework.errors import DataError

pytest.importorskip("trimesh", reason="furniture of Sweet Home 3D needs salframe[assets]")

from salframe_house.assets import Catalogue, asset_mesh, class_of, read_library
from salframe_house.building import generate_building
from salframe_house.dataset import House
from salframe_house.furniture import CLASSES, object_mesh
from salframe_house.render import HouseRenderer
from salframe_house.textures import TILE, texture_tile

# A step: 2 wide (x), 1 high (y), 4 deep (z); the lower half lies in front (z from 0 to 2).
OBJ = """mtllib sofa.mtl
v 0 0 -2
v 2 0 -2
v 2 1 -2
v 0 1 -2
v 0 0 2
v 2 0 2
v 2 0.5 2
v 0 0.5 2
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl back
f 2/1 1/2 4/3 3/4
usemtl front
f 5/1 6/2 7/3 8/4
"""
MTL = "newmtl back\nKd 1.0 0.0 0.0\nnewmtl front\nKd 1 1 1\nmap_Kd front.png\n"
LISTING = """# a comment
license=CC0
id#1=Test#sofa
name#1=Sofa 3
model#1=/test/sofa/sofa.obj
creator#1=Somebody
id#2=Test#turned
name#2=Armchair
model#2=/test/sofa/sofa.obj
modelRotation#2=0 0 1 0 1 0 -1 0 0
id#3=Test#bus
name#3=City bus
model#3=/test/sofa/sofa.obj
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("catalogue")
    front = np.zeros((16, 16, 3), np.uint8)
    front[:8] = 255  # the upper half is white, the lower black
    with zipfile.ZipFile(folder / "Test.sh3f", "w") as archive:
        archive.writestr("PluginFurnitureCatalog.properties", LISTING)
        archive.writestr("test/sofa/sofa.obj", OBJ)
        archive.writestr("test/sofa/sofa.mtl", MTL)
        archive.writestr("test/sofa/front.png", cv2.imencode(".png", front)[1].tobytes())
    return folder


def front_corners(mesh) -> np.ndarray:
    (textured,) = [index for index, material in enumerate(mesh.materials) if material.texture.startswith("image")]
    return mesh.vertices_m[mesh.triangles[mesh.material_index == textured]].reshape(-1, 3)


def test_a_library_gives_the_models_that_stand_for_a_class(folder):
    sofa, armchair = read_library(folder / "Test.sh3f")
    assert (sofa.id, sofa.label, sofa.creator, sofa.licence) == ("Test#sofa", "sofa", "Somebody", "CC0")
    assert armchair.label == "armchair"


def test_names_of_the_catalogue_stand_for_known_classes():
    assert class_of("Chair 12") == "chair"
    assert class_of("Bedside table 2") == "nightstand"
    assert class_of("Chair lift") is None
    assert {asset for asset in map(class_of, ["Bath", "Fridge", "TV"]) if asset in CLASSES} == {
        "bathtub",
        "refrigerator",
        "tv",
    }


def test_a_model_fills_its_box_with_the_front_along_x(folder):
    mesh = asset_mesh(read_library(folder / "Test.sh3f")[0])
    np.testing.assert_allclose(mesh.vertices_m.min(0), (-0.5, -0.5, 0), atol=1e-9)
    np.testing.assert_allclose(mesh.vertices_m.max(0), (0.5, 0.5, 1), atol=1e-9)
    front = front_corners(mesh)
    assert front[:, 0] == pytest.approx(0.5)  # z to the front becomes +x
    assert front[:, 2].max() == pytest.approx(0.5)


def test_the_catalogues_rotation_turns_a_model(folder):
    mesh = asset_mesh(read_library(folder / "Test.sh3f")[1])
    front = front_corners(mesh)
    assert front[:, 1] == pytest.approx(0.5)  # what looked along z looks along x: to our left


def test_colours_and_pictures_become_linear_albedo(folder):
    materials = asset_mesh(read_library(folder / "Test.sh3f")[0]).materials
    back, front = sorted(materials, key=lambda material: material.texture.startswith("image"))
    assert back.color_rgb == (0.8, 0.02, 0.02)  # within what surfaces reflect
    assert front.color_rgb == pytest.approx((0.5, 0.5, 0.5), abs=0.01)
    tile = texture_tile(front.texture, 0)
    assert tile[: TILE // 2 - 16].max() < 0.1  # rows grow upwards
    assert tile[TILE // 2 + 16 :].min() == pytest.approx(2, rel=0.05)


def test_a_building_takes_models_and_keeps_every_objects_box(folder):
    catalogue = Catalogue(folder)
    seed = next(seed for seed in range(50) if catalogue.choose("sofa", seed) is not None)
    size = CLASSES["sofa"].draw_size(seed)
    mesh = object_mesh("sofa", size, seed, catalogue=catalogue)
    np.testing.assert_allclose(np.ptp(mesh.vertices_m, axis=0), size)
    assert len(mesh.triangles) == 4
    building = generate_building("home", 6, 1)
    with_models, without = building.scene(catalogue), building.scene()
    assert len(with_models.triangles) < len(without.triangles)
    assert set(with_models.instance_id) == set(without.instance_id)
    pose = np.eye(4)
    pose[:3, 3] = (*np.mean([building.rooms[0].low_m, building.rooms[0].high_m], 0), 1.5)
    assert HouseRenderer(with_models, "day", 32).render(pose).rgb.shape == (32, 64, 3)


def test_half_of_the_objects_of_a_covered_class_take_a_model_and_parts_share_none(folder):
    catalogue = Catalogue(folder)
    share = np.mean([catalogue.choose("sofa", seed) is not None for seed in range(400)])
    assert share == pytest.approx(0.5, abs=0.07)
    parts = [
        {asset.id for assets in Catalogue(folder, part).assets.values() for asset in assets}
        for part in ("training", "held-out")
    ]
    assert not parts[0] & parts[1]
    assert len(parts[0] | parts[1]) == 2


def test_what_is_no_library_is_refused_in_one_line(tmp_path):
    with pytest.raises(DataError, match=r"contains no \.sh3f library"):
        Catalogue(tmp_path)
    (tmp_path / "broken.sh3f").write_bytes(b"PK no zip")
    with pytest.raises(DataError, match="is not a furniture library of Sweet Home 3D"):
        Catalogue(tmp_path)


def test_the_dataset_furnishes_with_models_where_asked(folder, tmp_path, monkeypatch):
    """The same building: ranges differ only where a sofa or armchair stands, in one of the two or in both."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    frames = []
    for models in (None, folder):
        house = House(House.Config(rooms=4, rgb=False, height=128, queries_per_room=0, models=models))
        house.prepare(lambda done, total: None)
        frames.append([frame.load() for frame in house.folds()[0].references])
    changed = 0
    for plain, furnished in zip(*frames, strict=True):
        seats = np.array([id for id, label in plain.annotations.labels.items() if label in ("sofa", "armchair")])
        other = np.abs(plain.range_m - furnished.range_m) > 0.01
        changed += other.sum()
        assert (np.isin(plain.annotations.instance_id, seats) | np.isin(furnished.annotations.instance_id, seats))[
            other
        ].all()
    assert changed > 100


def test_a_folder_without_libraries_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    house = House(House.Config(rooms=4, rgb=False, height=64, models=tmp_path))
    with pytest.raises(
        DataError, match=r"contains no \.sh3f library; expected the furniture libraries of Sweet Home 3D"
    ):
        house.prepare(lambda done, total: None)
