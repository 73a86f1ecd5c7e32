"""Each class of furniture: meshes that fill their box, face outwards and keep to their budget."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_house.furniture import CLASSES, object_mesh
from salframe_house.mesh import MeshBuilder, circle
from salframe_house.planning import ROOM_KINDS
from salframe_house.recipes import RECIPES
from salframe_house.scene import Material
from salframe_house.textures import TEXTURES

LOOK = Material("wood", (0.4, 0.3, 0.2))


def signed_volume(mesh) -> float:
    """Volume enclosed by triangles that face outwards (divergence theorem)."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_a_box_encloses_its_volume_and_measures_its_faces_in_metres():
    builder = MeshBuilder()
    builder.box((1, 2, 3), (1.5, 4, 6), LOOK)
    mesh = builder.mesh()
    assert signed_volume(mesh) == pytest.approx(0.5 * 2 * 3)
    edges_3d = np.linalg.norm(np.diff(mesh.vertices_m[mesh.triangles], axis=1), axis=2)
    edges_uv = np.linalg.norm(np.diff(mesh.uv_m, axis=1), axis=2)
    np.testing.assert_allclose(edges_uv, edges_3d)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_cylinder_stands_along_its_axis_and_encloses_a_prism(axis):
    builder = MeshBuilder()
    builder.cylinder((0, 0, 0), 0.5, 2.0, LOOK, axis=axis, segments=16)
    mesh = builder.mesh()
    polygon_m2 = 0.5 * 16 * 0.5**2 * np.sin(2 * np.pi / 16)
    assert signed_volume(mesh) == pytest.approx(2.0 * polygon_m2)
    assert mesh.vertices_m[:, "xyz".index(axis)].max() == pytest.approx(2.0)


def test_a_cone_stump_has_the_volume_of_its_frustum():
    builder = MeshBuilder()
    builder.loft([(circle(64) * 0.6, 0.0), (circle(64) * 0.2, 0.9)], LOOK)
    assert signed_volume(builder.mesh()) == pytest.approx(np.pi * 0.9 / 3 * (0.6**2 + 0.6 * 0.2 + 0.2**2), rel=0.01)


@pytest.mark.parametrize("label", sorted(CLASSES))
def test_furniture_fills_its_box_with_few_triangles_of_known_textures(label):
    for seed in range(6):
        size = np.array(CLASSES[label].draw_size(seed))
        mesh = object_mesh(label, tuple(size), seed)
        low, high = mesh.vertices_m.min(0), mesh.vertices_m.max(0)
        assert (low >= np.array([-size[0] / 2, -size[1] / 2, 0]) - 2e-3).all()
        assert (high <= np.array([size[0] / 2, size[1] / 2, size[2]]) + 2e-3).all()
        assert ((high - low) / size > 0.6).all()
        assert 10 <= len(mesh.triangles) <= 420
        assert {material.texture for material in mesh.materials} <= set(TEXTURES)
        sides = mesh.vertices_m[mesh.triangles]
        assert (np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1) > 1e-9).all()
        assert len(mesh.material_index) == len(mesh.uv_m) == len(mesh.triangles)


def test_the_seed_decides_size_and_look():
    sofas = [object_mesh("sofa", CLASSES["sofa"].draw_size(seed), seed) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(sofas[0].vertices_m, sofas[1].vertices_m)
    assert sofas[0].materials == sofas[1].materials
    assert sofas[0].materials != sofas[2].materials
    assert np.ptp(sofas[0].vertices_m, 0).tolist() != np.ptp(sofas[2].vertices_m, 0).tolist()


def test_a_mirrored_object_has_its_sides_exchanged_and_still_faces_outwards():
    size = CLASSES["desk"].draw_size(5)
    plain, mirrored = (object_mesh("desk", size, 5, mirrored) for mirrored in (False, True))
    np.testing.assert_allclose(mirrored.vertices_m * (1, -1, 1), plain.vertices_m)
    assert signed_volume(mirrored) == pytest.approx(signed_volume(plain))
    assert signed_volume(plain) > 0


def test_at_least_forty_classes_serve_the_recipes_of_all_kinds_of_rooms():
    used = {label for recipe in RECIPES.values() for label in (*recipe.core, *recipe.optional)} | {"ceiling lamp"}
    assert used == set(CLASSES)
    assert len(used) >= 40
    assert {kind for kinds in ROOM_KINDS.values() for kind in kinds} <= set(RECIPES)


def test_partners_are_furniture():
    for kind in CLASSES.values():
        assert set(kind.partners) <= set(CLASSES), kind.label
