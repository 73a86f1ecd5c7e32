"""Reader of meshes with colours: .obj with textures, .glb with embedded textures, .ply with vertex colours."""

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
"""Maximum size of a file, and of the header of a .ply file, in bytes."""
_GREY = (200, 200, 200)
"""Colour of a mesh without colours."""
_TO_Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)
"""Rotation from a y-up to a z-up frame: -z, the front direction of glTF, becomes y."""


@dataclass(frozen=True, eq=False)
class MeshSurface:
    """A textured triangle mesh in the world, in metres, z up.

    Attributes:
        vertices_m: Vertices (V, 3) float32.
        triangles: Vertex indices (F, 3) int32.
        paint: Texture of each triangle, as an index in `textures`, (F,) int32.
        uv: Texture coordinates (F, 3, 2) float32 of the corners; (0, 0) is the lower left.
        colors: Vertex colours (V, 3) float32 in 0..255, which multiply the texture; white without vertex colours.
        textures: Textures (h, w, 3) uint8.
    """

    vertices_m: np.ndarray
    triangles: np.ndarray
    paint: np.ndarray
    uv: np.ndarray
    colors: np.ndarray
    textures: tuple[np.ndarray, ...]


def read_mesh(path: Path, up: str) -> MeshSurface:
    """Read a mesh file in a separate process, because a damaged file may crash the process.

    Args:
        path: Path of the file.
        up: Axis of the file that points up, "z" or "y".

    Raises:
        DataError: The file is missing, unreadable, incomplete or has no faces.
        RequirementMissing: A system library of Open3D is missing.
    """
    try:
        import open3d  # noqa: F401
    except (ImportError, OSError) as error:
        hint = "on Debian and Ubuntu: apt install libusb-1.0-0 libegl1 libgl1 libx11-6"
        raise RequirementMissing(f"Open3D cannot be loaded: {error} ({hint})") from None
    if path.suffix.lower() not in SUFFIXES:
        raise DataError(f"{path} is not a mesh, expected a file name with suffix {', '.join(SUFFIXES)}")
    with reading(path, "a mesh"):
        size = check_regular(path, _MAX_BYTES)
        if path.suffix.lower() == ".ply":
            _check_counts(path, size)
    with ProcessPool(1) as pool:
        try:
            surface = pool.submit(_read, path).result()
        except BrokenProcessPool:
            raise DataError(f"{path} is not a readable mesh: the process that read it crashed") from None
    return surface if up == "z" else replace(surface, vertices_m=surface.vertices_m @ _TO_Z_UP.T)


def _read(path: Path) -> MeshSurface:
    """Read the surface of a file in the frame of the file. Raises DataError if the mesh has no faces or is invalid."""
    import open3d

    # Open3D reports a damaged file on stdout and returns an empty mesh.
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        if path.suffix.lower() == ".ply":
            mesh = open3d.io.read_triangle_mesh(str(path))
            parts, textures_by_material = (
                [(mesh, 0)],
                [_uniform_texture(_GREY if not mesh.has_vertex_colors() else (255, 255, 255))],
            )
        else:
            model = open3d.io.read_triangle_model(str(path))
            parts, textures_by_material = (
                [(part.mesh, part.material_idx) for part in model.meshes],
                [_texture(material) for material in model.materials],
            )
    parts = [(mesh, material) for mesh, material in parts if len(mesh.triangles)]
    if not parts:
        raise DataError(f"{path} has no faces, expected a mesh of triangles or polygons")
    surface = _join(parts, tuple(textures_by_material))
    _check(surface, path)
    return surface


def _check_counts(path: Path, size: int) -> None:
    """Raise ValueError if a .ply header claims more elements than the file has bytes; Open3D would try to read them."""
    header = read_start(path, _MAX_HEADER).partition(b"end_header")[0]
    for count in re.findall(rb"^\s*element\s+\S+\s+(\S+)", header, re.MULTILINE):
        if not count.isdigit() or len(count) > 12 or int(count) > size:
            raise ValueError(
                f"the header states {count.decode(errors='replace')[:20]} elements, expected an integer of at most "
                f"{size}, the number of bytes of the file: export the mesh again"
            )


def _check(surface: MeshSurface, path: Path) -> None:
    """Raise DataError if the surface has values that would crash the renderer."""
    if not (np.isfinite(surface.vertices_m).all() and np.isfinite(surface.uv).all()):
        raise DataError(
            f"{path} has a vertex or texture coordinate that is not finite in float32, expected finite numbers"
        )
    for name, numbers, count in (
        ("corner", surface.triangles, len(surface.vertices_m)),
        ("material", surface.paint, len(surface.textures)),
    ):
        if numbers.min() < 0 or numbers.max() >= count:
            index = numbers.min() if numbers.min() < 0 else numbers.max()
            raise DataError(f"{path} has a face with the {name} index {index}, expected 0 to {count - 1}")


def _uniform_texture(rgb) -> np.ndarray:
    """Return a texture of one pixel."""
    return np.array([[rgb]], np.uint8)


def _texture(material) -> np.ndarray:
    """Return the texture of a material. Without an image, it is one pixel with the colour of the material."""
    image = None if material.albedo_img is None else np.asarray(material.albedo_img)
    if image is None or not image.size:
        return _uniform_texture(np.round(255 * np.asarray(material.base_color)[:3]))
    image = image if image.ndim == 3 else image[..., None]
    return np.ascontiguousarray(image[..., :3] if image.shape[2] >= 3 else image[..., [0, 0, 0]])


def _join(parts: list, textures_by_material: tuple[np.ndarray, ...]) -> MeshSurface:
    vertices, triangles, paint, uv, colors = [], [], [], [], []
    first = 0
    for mesh, material in parts:
        corners = np.asarray(mesh.triangles, np.int32)
        vertices.append(np.asarray(mesh.vertices, np.float32))
        triangles.append(corners + first)
        paint.append(np.full(len(corners), material, np.int32))
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
        textures=textures_by_material,
    )
