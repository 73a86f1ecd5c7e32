"""`mesh`: panoramas rendered from a building's mesh, rendered once into the folder format and read from there."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError
from salframe.framework.files.bounded import read_bytes
from salframe.framework.files.hashes import digest
from salframe.framework.files.reading import read_text, reading
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.hidden_places import hide_query_place_setting
from salframe.panoramas.house_file import read_house
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import VIEW_SETTINGS, QueryView, as_query
from salframe.panoramas.rendered import FrameRole, FrameSpec, RenderedDataset
from salframe_mesh.floors import FloorRegion, floor_masks, read_rooms
from salframe_mesh.mesh_file import SUFFIXES, MeshSurface, read_mesh
from salframe_mesh.renderer import MeshRenderer

SHIFT_M = 0.3, 1.1
"""Minimum and maximum distance in metres of a generated query from its reference frame."""
_CLEARANCE_M = 0.25
"""Minimum distance of a generated query from obstacles, in metres."""
_COLUMNS = "id", "role", "place", "x_m", "y_m", "z_m", "yaw_rad"


class MeshDataset(RenderedDataset[FrameSpec]):
    """RGB-D panoramas rendered from a mesh: Matterport3D (.obj), HM3D (.glb), Replica (.ply), or any other building.

    A file in the folder contains the positions of the panoramas. If this file is frames.csv, it lists the reference
    frames and the queries. If it is the .house file of a Matterport3D building, its panoramas are the reference frames.
    Queries are then placed near them on free floor, with a random yaw. The dataset can render a panorama at any pose.
    """

    name = "mesh"
    version = "1"
    requires = ("open3d",)
    extra = "salframe[mesh]"
    provides = frozenset({"rgb", "range"})

    class Config(QueryView):
        root: Path | None = Field(
            None,
            description="path of the folder that contains a mesh, the positions of the panoramas (frames.csv or a "
            ".house file), and optionally the rooms (regions.json); required (--data-dir sets it)",
        )
        mesh: str | None = Field(
            None, description="name of the mesh file in the folder; null: the only mesh in the folder"
        )
        up: Literal["z", "y"] = Field(
            "z", description="axis of the mesh that points up. z: as in Matterport3D and Replica; y: as in HM3D"
        )
        height: int = Field(512, ge=64, description="height of a panorama in pixels; its width is twice the height")
        resolution_m: float = Field(0.05, gt=0, description="size (m) of a pixel of the floor masks")
        queries_per_frame: int = Field(
            1,
            ge=0,
            description="number of queries that are rendered near each panorama of a .house file. No effect if the "
            "folder has a frames.csv",
        )
        seed: int = Field(
            0,
            ge=0,
            description="random seed of the positions and yaws of the queries near the panoramas of a .house file. No "
            "effect if the folder has a frames.csv",
        )
        hide_query_place: bool = hide_query_place_setting()

    @cached_property
    def _source(self) -> Path:
        if self.config.root is None:
            raise DataError(
                f"the dataset {self.name} has no folder, expected the folder of a mesh (see `salframe docs "
                "real-buildings`): pass --data-dir DIR"
            )
        if not self.config.root.is_dir():
            raise DataError(
                f"{self.config.root} is not a folder, expected a folder with a mesh ({', '.join(SUFFIXES)})"
            )
        return self.config.root

    @cached_property
    def _mesh_path(self) -> Path:
        if self.config.mesh is not None:
            return self._source / self.config.mesh
        meshes = sorted(path for path in self._source.iterdir() if path.suffix.lower() in SUFFIXES)
        if len(meshes) != 1:
            if not meshes:
                raise DataError(f"{self._source} has no mesh, expected a file with the suffix {', '.join(SUFFIXES)}")
            names = ", ".join(path.name for path in meshes)
            raise DataError(
                f"{self._source} has {len(meshes)} meshes ({names}), expected one: set data.mesh to the file to use"
            )
        return meshes[0]

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the settings and of all files in the folder. A material can use any file as its texture.

        The content of tables (frames.csv, regions.json, .house, .mtl) is hashed. Of other files, only path, size and
        modification time are hashed.
        """
        files = sorted(path for path in self._source.rglob("*") if path.is_file())
        stamps = [[path.relative_to(self._source).as_posix(), *_content_or_stamp(path)] for path in files]
        settings = self.config.model_dump(mode="json", exclude={"root", "hide_query_place", *VIEW_SETTINGS})
        return digest([self.version, settings, stamps])

    @cached_property
    def _surface(self) -> MeshSurface:
        return read_mesh(self._mesh_path, self.config.up)

    @cached_property
    def _renderer(self) -> MeshRenderer:
        return MeshRenderer(self._surface)

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """Render the panorama at a pose (4, 4)."""
        return as_query(self._renderer.render(T_world_pano, self.config.height, "observation"), self.config)

    def list_frames(self) -> Sequence[FrameSpec]:
        if (self._source / "frames.csv").exists():
            return read_frames(self._source / "frames.csv")
        references = self._house_references()
        return references + draw_queries(references, self._floors, self.config.queries_per_frame, self.config.seed)

    def render(self, frame: FrameSpec) -> Panorama:
        return self._renderer.render(frame.pose, self.config.height, frame.id)

    def list_floors(self) -> Mapping[str, FloorMasks]:
        return {f"floor-{number}": floor for number, floor in enumerate(self._floors)}

    @cached_property
    def _floors(self) -> list[FloorMasks]:
        """The floor masks of each level with known rooms."""
        levels: dict[int, list[FloorRegion]] = {}
        for room in read_rooms(self._source):
            levels.setdefault(room.level, []).append(room)
        return [
            floor_masks(self._surface, self._renderer, rooms, self.config.resolution_m)
            for _, rooms in sorted(levels.items())
        ]

    def _house_references(self) -> list[FrameSpec]:
        """Return a reference frame at every panorama of the .house file that is in a region."""
        houses = sorted(self._source.glob("*.house"))
        if len(houses) != 1:
            raise DataError(
                f"{self._source} has {len(houses)} .house files and no frames.csv, expected the positions "
                f"of the panoramas in frames.csv ({', '.join(_COLUMNS)}) or in exactly one .house file of Matterport3D"
            )
        references = []
        for name, point in read_house(houses[0]).panoramas.items():
            if point.region is not None:
                x_m, y_m, z_m = point.position_m.tolist()
                place = f"{houses[0].stem}/region-{point.region}"
                references.append(FrameSpec(name, "map", place, x_m, y_m, z_m, yaw_rad=0.0))
        if not references:
            raise DataError(
                f"{houses[0]} has no panorama in a region, expected at least one, or frames.csv in the same folder"
            )
        return references


def _content_or_stamp(path: Path) -> list[str | int]:
    """Return the text of a table. For other files, which may be large, return size and modification time."""
    if path.suffix in (".csv", ".json", ".house", ".mtl"):
        with reading(path, "a table"):
            return [read_bytes(path).decode("utf-8", "replace")]
    state = path.stat()
    return [state.st_size, state.st_mtime_ns]


def read_frames(path: Path) -> list[FrameSpec]:
    """Read the rows of frames.csv: id, role (map, transition or query), place, x_m, y_m, z_m, yaw_rad.

    Raises:
        DataError: A row is malformed.
    """
    with reading(path, "a table of comma-separated values"), io.StringIO(read_text(path), newline="") as file:
        reader = csv.DictReader(file)
        missing = set(_COLUMNS) - set(reader.fieldnames or ())
        if missing:
            raise DataError(
                f"{path} has no column {' and no column '.join(sorted(missing))}, expected {', '.join(_COLUMNS)}"
            )
        specs: dict[str, FrameSpec] = {}
        for number, row in enumerate(reader, 2):
            try:
                role = cast(FrameRole, row["role"])
                spec = FrameSpec(row["id"], role, row["place"], *[float(row[name]) for name in _COLUMNS[3:]])
                if not np.isfinite([spec.x_m, spec.y_m, spec.z_m, spec.yaw_rad]).all():
                    raise ValueError
            except (TypeError, ValueError):
                raise DataError(
                    f"{path}, line {number}: received {list(row.values())}, "
                    f"expected finite numbers in {', '.join(_COLUMNS[3:])}"
                ) from None
            if spec.role not in get_args(FrameRole):
                known = ", ".join(get_args(FrameRole))
                raise DataError(f"{path}, line {number}: the role is {spec.role!r}, expected one of {known}")
            if spec.id in specs:
                raise DataError(
                    f"{path}, line {number}: the frame id {spec.id!r} occurs twice, expected a unique id for each frame"
                )
            specs[spec.id] = spec
    if not any(spec.role == "map" for spec in specs.values()):
        raise DataError(f"{path} has no row with the role 'map', expected at least one reference frame")
    return list(specs.values())


def draw_queries(
    references: Sequence[FrameSpec], floors: Sequence[FloorMasks], per_frame: int, seed: int
) -> list[FrameSpec]:
    """Return random queries 0.3 to 1.1 m from each reference frame, on free floor of the same room, with random yaw.

    A reference frame without free floor at this distance gets no query.

    Args:
        references: Reference frames.
        floors: Floor masks of all levels.
        per_frame: Maximum number of queries per reference frame.
        seed: Random seed.
    """
    from scipy import ndimage

    queries: list[FrameSpec] = []
    clearance = [floor.resolution_m * ndimage.distance_transform_edt(floor.free & ~floor.obstacle) for floor in floors]
    for index, frame in enumerate(references):
        random = np.random.default_rng((seed, index))
        for floor, clear_m in zip(floors, clearance, strict=True):
            label = next((number for number, place in floor.regions.items() if place == frame.place), None)
            if label is None:
                continue
            row, column = np.nonzero((floor.region == label) & (clear_m >= _CLEARANCE_M))
            x_m, y_m = (
                floor.origin_m[0] + (column + 0.5) * floor.resolution_m,
                floor.origin_m[1] - (row + 0.5) * floor.resolution_m,
            )
            shift_m = np.hypot(x_m - frame.x_m, y_m - frame.y_m)
            near = np.flatnonzero((shift_m >= SHIFT_M[0]) & (shift_m <= SHIFT_M[1]))
            for at in random.choice(near, min(per_frame, len(near)), replace=False):
                yaw_rad = random.uniform(-np.pi, np.pi)
                id = f"query-{len(queries):04d}"
                queries.append(FrameSpec(id, "query", frame.place, float(x_m[at]), float(y_m[at]), frame.z_m, yaw_rad))
    return queries
