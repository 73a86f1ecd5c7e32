"""Panoramas of a textured mesh, rendered at any pose."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_mesh.dataset import MeshDataset

    return [MeshDataset]
