"""All furniture classes, and the mesh of an object."""

from __future__ import annotations

import numpy as np

# Importing a furniture module registers its classes in CLASSES.
from salframe_house import furniture_decor, furniture_devices, furniture_seating, furniture_storage, furniture_wet  # noqa: F401
from salframe_house.assets import Catalogue
from salframe_house.mesh import Mesh, MeshBuilder
from salframe_house.object_class import CLASSES, Size

__all__ = ["CLASSES", "object_mesh"]


def object_mesh(
    label: str, size_m: Size, seed: int, mirrored: bool = False, catalogue: Catalogue | None = None
) -> Mesh:
    """Return the mesh of an object in the object frame.

    Args:
        label: Object class.
        size_m: Size of the object.
        seed: Seed of the shape and the materials.
        mirrored: Exchange left and right.
        catalogue: Furniture models; some objects use one of these models instead of the parametric mesh. None:
            parametric meshes only.
    """
    mesh = None if catalogue is None else catalogue.mesh(label, size_m, seed)
    if mesh is None:
        builder = MeshBuilder()
        CLASSES[label].build(builder, size_m, np.random.default_rng((seed, 2)))
        mesh = builder.mesh()
    if not mirrored:
        return mesh
    return Mesh(
        mesh.vertices_m * (1, -1, 1), mesh.triangles[:, ::-1], mesh.uv_m[:, ::-1], mesh.material_index, mesh.materials
    )
