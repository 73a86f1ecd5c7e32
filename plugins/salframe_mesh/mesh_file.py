"""Reading a building's mesh with its colours: .obj with textures, .glb with textures inside, .ply with colours at its
vertices."""

from __future__ import annotations

import re
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from salframe.framework.engines.process_pool import ProcessPool
from salframe.framework.errors import DataError, RequirementMissing
from salframe.framework.files.bounded import check_regular, read_start
from salframe.framework.files.reading import reading

SUFFIXES = (".obj", ".glb", ".ply")
_MAX_BYTES, _MAX_HEADER = 1 << 33, 1 << 16
_GREY = (200, 200, 200)
_TO_Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)
"""Turns a frame whose y is up so that its z is: what was -z, the front of glTF, becomes y."""


@dataclass(frozen=True, eq=False)
class MeshSurface:
    """Triangles in the world, metres, z up, and what they look like.

    vertices_m (V, 3) float32; triangles (F, 3) int32; paint (F,) int32 into `textures`; uv (F, 3, 2) float32 at the
    corners, (0, 0) the lower left of the texture; colors (V, 3) float32 in 0..255, what textures are multiplied with
    (white where there is a texture). A texture is (h, w, 3) uint8.
    """

    vertices_m: np.ndarray
    triangles: np.ndarray
    paint: np.ndarray
    uv: np.ndarray
    colors: np.ndarray
    textures: tuple[np.ndarray, ...]


def read_mesh(path: Path, up: str) -> MeshSurface:
    """Read a mesh file whose axis `up` ("z" or "y") points up, in a process of its own, which a damaged one may end.

    Raises DataError where it is missing, unreadable, not whole or has no faces, RequirementMissing where Open3D lacks a
    library of the system.
    """
    try:
        import open3d  # noqa: F401
    except (ImportError, OSError) as error:
        hint = "on Debian and Ubuntu: apt install libusb-1.0-0 libegl1 libgl1 libx11-6"
        raise RequirementMissing(f"Open3D cannot be loaded: {error} ({hint})") from None
    if path.suffix.lower() not in SUFFIXES:
        raise DataError(f"{path} is no mesh, expected a name that ends in {', '.join(SUFFIXES)}")
    with reading(path, "a mesh"):
        size = check_regular(path, _MAX_BYTES)
        if path.suffix.lower() == ".ply":
            _check_counts(path, size)
    with ProcessPool(1) as pool:
        try:
            surface = pool.submit(_read, path).result()
        except BrokenProcessPool:
            raise DataError(f"{path} is no mesh that can be read: it ended the process that read it") from None
    return surface if up == "z" else replace(surface, vertices_m=surface.vertices_m @ _TO_Z_UP.T)


def _read(path: Path) -> MeshSurface:
    """The surface in a file as it stands there. Raises DataError."""
    import open3d

    # Open3D tells of a damaged file on stdout and gives an empty mesh.
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        if path.suffix.lower() == ".ply":
            mesh = open3d.io.read_triangle_mesh(str(path))
            parts, looks = [(mesh, 0)], [_plain(_GREY if not mesh.has_vertex_colors() else (255, 255, 255))]
        else:
            model = open3d.io.read_triangle_model(str(path))
            parts, looks = (
                [(part.mesh, part.material_idx) for part in model.meshes],
                [_look(material) for material in model.materials],
            )
    parts = [(mesh, look) for mesh, look in parts if len(mesh.triangles)]
    if not parts:
        raise DataError(f"{path} is no mesh with faces, expected triangles or polygons")
    surface = _joined(parts, tuple(looks))
    _check(surface, path)
    return surface


def _check_counts(path: Path, size: int) -> None:
    """Raises ValueError on a .ply whose header claims more than the file has bytes: Open3D would look for it."""
    header = read_start(path, _MAX_HEADER).partition(b"end_header")[0]
    for count in re.findall(rb"^\s*element\s+\S+\s+(\S+)", header, re.MULTILINE):
        if not count.isdigit() or len(count) > 12 or int(count) > size:
            raise ValueError(f"{count.decode(errors='replace')[:20]} elements in {size} bytes")


def _check(surface: MeshSurface, path: Path) -> None:
    """Raises DataError on what the renderer would end the process for."""
    if not (np.isfinite(surface.vertices_m).all() and np.isfinite(surface.uv).all()):
        raise DataError(f"{path} has a corner that is not finite, or not in single precision")
    for name, numbers, count in (
        ("corner", surface.triangles, len(surface.vertices_m)),
        ("material", surface.paint, len(surface.textures)),
    ):
        if numbers.min() < 0 or numbers.max() >= count:
            raise DataError(
                f"{path} has a face of {name} {max(numbers.max(), -numbers.min())}, expected one of {count}"
            )


def _plain(rgb) -> np.ndarray:
    """A texture of one pixel."""
    return np.array([[rgb]], np.uint8)


def _look(material) -> np.ndarray:
    """The texture of a material, or one of its colour alone."""
    image = None if material.albedo_img is None else np.asarray(material.albedo_img)
    if image is None or not image.size:
        return _plain(np.round(255 * np.asarray(material.base_color)[:3]))
    image = image if image.ndim == 3 else image[..., None]
    return np.ascontiguousarray(image[..., :3] if image.shape[2] >= 3 else image[..., [0, 0, 0]])


def _joined(parts: list, looks: tuple[np.ndarray, ...]) -> MeshSurface:
    vertices, triangles, paint, uv, colors = [], [], [], [], []
    first = 0
    for mesh, look in parts:
        corners = np.asarray(mesh.triangles, np.int32)
        vertices.append(np.asarray(mesh.vertices, np.float32))
        triangles.append(corners + first)
        paint.append(np.full(len(corners), look, np.int32))
        has_uv = len(mesh.triangle_uvs) == 3 * len(corners)
        uv.append(
            np.asarray(mesh.triangle_uvs, np.float32).reshape(-1, 3, 2)
            if has_uv
            else np.zeros((len(corners), 3, 2), np.float32)
        )
        colors.append(
            np.asarray(mesh.vertex_colors, np.float32) * 255
            if mesh.has_vertex_colors()
            else np.full_like(vertices[-1], 255)
        )
        first += len(vertices[-1])
    return MeshSurface(
        vertices_m=np.concatenate(vertices),
        triangles=np.concatenate(triangles),
        paint=np.concatenate(paint),
        uv=np.concatenate(uv),
        colors=np.concatenate(colors),
        textures=looks,
    )
