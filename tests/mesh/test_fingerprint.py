"""What a data set of a mesh is known by; without Open3D, which reads the mesh."""

from __future__ import annotations

import pytest
from salframe_mesh.dataset import MeshDataset


@pytest.fixture
def fingerprint(tmp_path, monkeypatch):
    monkeypatch.setattr(MeshDataset, "requires", ())
    (tmp_path / "textures").mkdir()
    for name in ("room.obj", "room.mtl", "frames.csv", "textures/wood.jpeg", "textures/stone.tga"):
        (tmp_path / name).write_text(name)
    return lambda: MeshDataset(MeshDataset.Config(root=tmp_path)).fingerprint


@pytest.mark.parametrize("name", ["textures/wood.jpeg", "textures/stone.tga", "textures/cloth.bmp", "frames.csv"])
def test_it_follows_every_file(fingerprint, tmp_path, name):
    before = fingerprint()
    assert fingerprint() == before
    (tmp_path / name).write_text("another look")
    assert fingerprint() != before


def test_it_follows_the_paths(fingerprint, tmp_path):
    before = fingerprint()
    (tmp_path / "textures" / "wood.jpeg").rename(tmp_path / "wood.jpeg")
    assert fingerprint() != before
