"""Panoramas rendered at any pose from a textured mesh."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_mesh.dataset import MeshDataset

    return [MeshDataset]
