"""Mesh primitives: boxes and lofted solids with texture coordinates in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe_house.scene import Material

Point = tuple[float, float, float]

_FACE_AXES = {  # face -> (normal axis, side, axis and direction of u, axis of v), such that u x v points outwards
    "+x": (0, 1, 1, 1, 2),
    "-x": (0, 0, 1, -1, 2),
    "+y": (1, 1, 0, -1, 2),
    "-y": (1, 0, 0, 1, 2),
    "+z": (2, 1, 0, 1, 1),
    "-z": (2, 0, 0, -1, 1),
}


def _box_template() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the faces of the unit box.

    Returns:
        Corners (6, 4, 3) of the faces, their texture coordinates (4, 2), and for each face
        the indices (6, 2) of the two axes of the box whose lengths scale its texture coordinates.
    """
    corners, axes = np.zeros((6, 4, 3)), np.zeros((6, 2), int)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    for face, (normal, side, axis_u, direction, axis_v) in enumerate(_FACE_AXES.values()):
        corners[face, :, normal] = side
        corners[face, :, axis_u] = uv[:, 0] if direction > 0 else 1 - uv[:, 0]
        corners[face, :, axis_v] = uv[:, 1]
        axes[face] = axis_u, axis_v
    return corners, uv, axes


_BOX_CORNERS, _BOX_UV, _BOX_UV_AXES = _box_template()
_QUAD = np.array([[0, 1, 2], [0, 2, 3]])
_PERMUTATION = {"z": [0, 1, 2], "x": [2, 0, 1], "y": [1, 2, 0]}  # cyclic permutations preserve the winding


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one object.

    Attributes:
        vertices_m: Vertices, (V, 3) float64.
        triangles: Vertex indices, (F, 3) int64, counter-clockwise when viewed from outside.
        uv_m: Texture coordinates at the corners in metres, (F, 3, 2) float64.
        material_index: Index into `materials` for each triangle, (F,) int64.
        materials: Materials of the mesh.
    """

    vertices_m: np.ndarray
    triangles: np.ndarray
    uv_m: np.ndarray
    material_index: np.ndarray
    materials: tuple[Material, ...]


class MeshBuilder:
    """Collects the parts of a mesh; `mesh()` joins them. Lengths are in metres, in the object frame."""

    def __init__(self) -> None:
        self._vertices: list[np.ndarray] = []
        self._triangles: list[np.ndarray] = []
        self._uv: list[np.ndarray] = []
        self._material_index: list[np.ndarray] = []
        self._materials: dict[Material, int] = {}
        self._count = 0

    def _add(self, vertices: np.ndarray, triangles: np.ndarray, uv: np.ndarray, material: np.ndarray) -> None:
        """Append a part."""
        self._vertices.append(vertices)
        self._triangles.append(triangles + self._count)
        self._uv.append(uv)
        self._material_index.append(material)
        self._count += len(vertices)

    def _index(self, material: Material) -> int:
        """Return the index of a material, which is added on first use."""
        return self._materials.setdefault(material, len(self._materials))

    def quad(self, corners: np.ndarray, material: Material, uv: np.ndarray | None = None) -> None:
        """Add a flat quadrilateral.

        Args:
            corners: Corners, (4, 3), counter-clockwise.
            material: Material of the face.
            uv: Texture coordinates, (4, 2); by default measured from corner 0 along its two edges.
        """
        corners = np.asarray(corners, float)
        if uv is None:
            width, height = np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[3] - corners[0])
            uv = _BOX_UV * (width, height)
        self._add(corners, _QUAD, np.asarray(uv, float)[_QUAD], np.full(2, self._index(material)))

    def box(self, low: Point, high: Point, material: Material, **faces: Material) -> None:
        """Add an axis-aligned box.

        Args:
            low: Corner with the smaller coordinates.
            high: Corner with the larger coordinates.
            material: Material of all faces that `faces` does not contain.
            faces: Material of the faces `front`, `back`, `left`, `right`, `top`, `bottom` (+x, -x, +y, -y, +z, -z).
        """
        corner, size = np.asarray(low, float), np.subtract(high, low)
        vertices = (corner + _BOX_CORNERS * size).reshape(24, 3)
        uv = _BOX_UV * size[_BOX_UV_AXES][:, None]
        triangles = (np.arange(6)[:, None, None] * 4 + _QUAD).reshape(12, 3)
        material_index = np.full(6, self._index(material))
        for name, look in faces.items():
            material_index[("front", "back", "left", "right", "top", "bottom").index(name)] = self._index(look)
        self._add(vertices, triangles, uv[:, _QUAD].reshape(12, 3, 2), np.repeat(material_index, 2))

    def loft(
        self,
        sections: list[tuple[np.ndarray, float]],
        material: Material,
        axis: str = "z",
        origin: Point = (0.0, 0.0, 0.0),
        caps: tuple[bool, bool] = (True, True),
        cap: Material | None = None,
    ) -> None:
        """Add a solid through cross-sections, with flat caps at its ends.

        Args:
            sections: Cross-sections: (n, 2) points, counter-clockwise, and their position along `axis`.
            material: Material of the solid.
            axis: Axis of the loft. The cross-sections of an "x" loft are in (y, z), of a "y" loft in (z, x).
            origin: Offset of the solid.
            caps: Whether the solid has the first cap, and whether it has the last cap.
            cap: Material of the last cap, by default `material`.
        """
        rings = np.array([np.column_stack([points, np.full(len(points), height)]) for points, height in sections])
        count, n = rings.shape[:2]
        lower = np.arange(count - 1)[:, None] * n + np.arange(n)
        upper, following = lower + n, np.roll(np.arange(n), -1) - np.arange(n)
        quads = np.stack([lower, lower + following, upper + following, upper], -1).reshape(-1, 4)
        edges = np.linalg.norm(np.roll(rings, -1, 1) - rings, axis=-1).mean(0)
        along = np.concatenate([[0.0], np.cumsum(edges)])
        rise = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rings, axis=0), axis=-1).mean(1))])
        u0, v0 = np.meshgrid(along[:-1], rise[:-1])
        u1, v1 = np.meshgrid(along[1:], rise[1:])
        uv = np.stack(
            [np.stack([u0, v0], -1), np.stack([u1, v0], -1), np.stack([u1, v1], -1), np.stack([u0, v1], -1)], 2
        )
        triangles, texture = [quads[:, _QUAD].reshape(-1, 3)], [uv.reshape(-1, 4, 2)[:, _QUAD].reshape(-1, 3, 2)]
        look = [np.full(2 * len(quads), self._index(material))]
        fan = np.array([[0, i, i + 1] for i in range(1, n - 1)])
        for closed, ring, order, surface in zip(
            caps, (0, count - 1), (fan[:, ::-1], fan), (material, cap or material), strict=True
        ):
            if closed:
                triangles.append(order + ring * n)
                texture.append(rings[ring, order, :2] - rings[ring, :, :2].min(0))
                look.append(np.full(len(fan), self._index(surface)))
        vertices = rings.reshape(-1, 3)[:, _PERMUTATION[axis]] + np.asarray(origin, float)
        self._add(vertices, np.concatenate(triangles), np.concatenate(texture), np.concatenate(look))

    def cylinder(
        self,
        centre: Point,
        radius: float | tuple[float, float],
        height: float,
        material: Material,
        axis: str = "z",
        top_radius: float | tuple[float, float] | None = None,
        segments: int = 12,
        cap: Material | None = None,
    ) -> None:
        """Add a cylinder or a truncated cone, with a circular or elliptic cross-section.

        Args:
            centre: Centre of the first cap.
            radius: Radius, or the two radii of an ellipse.
            height: Length along `axis`.
            material: Material of the solid.
            axis: Axis of the cylinder.
            top_radius: Radius of the last cap, by default `radius`.
            segments: Number of sides.
            cap: Material of the last cap, by default `material`.
        """
        ring = circle(segments)
        sections = [(ring * radius, 0.0), (ring * (radius if top_radius is None else top_radius), height)]
        self.loft(sections, material, axis, centre, cap=cap)

    def cushion(self, low: Point, high: Point, material: Material, bevel_m: float = 0.03) -> None:
        """Add a box with rounded vertical and upper edges, open below: upholstery, mattresses, pillows."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        bevel = min(bevel_m, (x1 - x0) / 4, (y1 - y0) / 4, (z1 - z0) / 2)
        outline, inset = (
            _octagon(x0, y0, x1, y1, bevel),
            _octagon(x0 + bevel, y0 + bevel, x1 - bevel, y1 - bevel, bevel / 2),
        )
        self.loft([(outline, z0), (outline, z1 - bevel), (inset, z1)], material, caps=(False, True))

    def mesh(self) -> Mesh:
        """Return all parts as one mesh."""
        return Mesh(
            np.concatenate(self._vertices),
            np.concatenate(self._triangles),
            np.concatenate(self._uv),
            np.concatenate(self._material_index),
            tuple(self._materials),
        )


def circle(segments: int) -> np.ndarray:
    """Return points of the unit circle, (segments, 2), counter-clockwise."""
    angle = 2 * np.pi * np.arange(segments) / segments
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _octagon(x0: float, y0: float, x1: float, y1: float, cut: float) -> np.ndarray:
    """Return a rectangle with its corners cut off, counter-clockwise."""
    return np.array(
        [
            [x0 + cut, y0],
            [x1 - cut, y0],
            [x1, y0 + cut],
            [x1, y1 - cut],
            [x1 - cut, y1],
            [x0 + cut, y1],
            [x0, y1 - cut],
            [x0, y0 + cut],
        ]
    )
