"""Generated buildings: structure, furniture, mesh, floor masks and changed versions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
from scipy import ndimage

from salframe.framework.errors import ConfigError
from salframe.panoramas.floors import FloorMasks
from salframe_house.assets import Catalogue
from salframe_house.furnish import draw_item, furnish
from salframe_house.furniture import object_mesh
from salframe_house.layout import WALL_M, Door, Layout, Room, Window
from salframe_house.mesh import Mesh
from salframe_house.mobility import appears, mobile_first
from salframe_house.placement import PlacedObject, RoomPlan
from salframe_house.planning import plan_layout
from salframe_house.scene import Light, Material, Scene
from salframe_house.shell import shell_mesh, window_light
from salframe_house.signs import sign_mesh

Style = Literal["home", "office", "hotel"]
Changes = Literal["uniform", "by-class"]
ChangeKind = Literal["removed", "moved", "added"]
CHANGE_KINDS: tuple[ChangeKind, ...] = get_args(ChangeKind)
ROUNDING_M = 1e-6
"""Length by which thresholds overlap the rooms in the floor masks. Without the overlap, rounding errors could leave a
row of pixels between threshold and room that belongs to neither, which would close the doorway."""
MIN_ROOMS = 4

# Fittings of the building: a uniform draw changes them only after all other objects.
_FITTINGS = frozenset(
    {
        "ceiling lamp",
        "toilet",
        "sink",
        "bathtub",
        "shower",
        "urinal",
        "bathroom vanity",
        "kitchen counter",
        "kitchen sink",
        "kitchen cabinet",
        "radiator",
        "fireplace",
        "hand dryer",
    }
)


@dataclass(frozen=True, eq=False)
class Building:
    """A furnished single-floor building in the world frame (metres, z up, floor at z = 0).

    Corridors count as rooms. A sign is an object on a wall, and its label contains its text.
    """

    style: Style
    seed: int
    rooms: tuple[Room, ...]
    doors: tuple[Door, ...]
    windows: tuple[Window, ...]
    objects: tuple[PlacedObject, ...]
    signs: tuple[PlacedObject, ...] = ()

    @property
    def layout(self) -> Layout:
        """Structure of the building."""
        return Layout(self.rooms, self.doors, self.windows)

    @property
    def labels(self) -> dict[int, str]:
        """Mapping from instance id to label."""
        return {obj.instance_id: obj.label for obj in (*self.objects, *self.signs)}

    def scene(self, catalogue: Catalogue | None = None) -> Scene:
        """Return the triangles, materials and lights of the building.

        Args:
            catalogue: Furniture models; some objects use one of these models instead of the parametric mesh. None:
                parametric meshes only.
        """
        meshes: list[tuple[Mesh, PlacedObject | None]] = [(shell_mesh(self.layout, self.style, self.seed), None)]
        meshes += [(object_mesh(o.label, o.size_m, o.seed, o.mirrored, catalogue), o) for o in self.objects]
        meshes += [(sign_mesh(sign), sign) for sign in self.signs]
        materials: dict[Material, int] = {}
        vertices, triangles, uv, material_index, instance_id = [], [], [], [], []
        count = 0
        for mesh, obj in meshes:
            vertices.append(_in_world(mesh, obj))
            triangles.append(mesh.triangles + count)
            uv.append(mesh.uv_m)
            material_index.append(
                np.array([materials.setdefault(m, len(materials)) for m in mesh.materials])[mesh.material_index]
            )
            instance_id.append(np.full(len(mesh.triangles), obj.instance_id if obj else 0))
            count += len(mesh.vertices_m)
        lights = [_lamp_light(obj) for obj in self.objects if obj.label == "ceiling lamp"]
        lights += [window_light(window) for window in self.windows]
        return Scene(
            np.concatenate(vertices).astype(np.float32),
            np.concatenate(triangles).astype(np.int32),
            np.concatenate(uv).astype(np.float32),
            np.concatenate(material_index).astype(np.int32),
            np.concatenate(instance_id).astype(np.int32),
            tuple(materials),
            tuple(lights),
        )

    def floor_masks(self, resolution_m: float = 0.05) -> FloorMasks:
        """Return masks of free floor, room labels (1 + index in `rooms`) and obstacles, in top view.

        The strip of floor in a doorway is free floor. The labels of the two rooms meet in its middle
        (docs/how-to/maps.md#what-the-map-is-made-of). Open door leaves are not free floor. Obstacles are the footprints
        of all objects that begin below 1.5 m, except rugs.
        """
        low, high = self._extent_m
        shape = tuple(np.ceil((high - low)[::-1] / resolution_m).astype(int))
        free, region, obstacle = np.zeros(shape, bool), np.zeros(shape, np.int32), np.zeros(shape, bool)
        x = low[0] + (np.arange(shape[1]) + 0.5) * resolution_m
        y = high[1] - (np.arange(shape[0]) + 0.5) * resolution_m

        def inside(first: np.ndarray, second: np.ndarray) -> tuple[slice, slice]:
            """Return the rows and columns whose pixel centres lie in the rectangle between two corners."""
            (x0, y0), (x1, y1) = np.minimum(first, second), np.maximum(first, second)
            columns, rows = np.searchsorted(x, (x0, x1)), len(y) - np.searchsorted(y[::-1], (y1, y0))
            return slice(*rows), slice(*columns)

        index = {room.id: number for number, room in enumerate(self.rooms, 1)}
        for room in self.rooms:
            at = inside(np.array(room.low_m), np.array(room.high_m))
            free[at], region[at] = True, index[room.id]
        for door in self.doors:
            for room_id, side in zip(door.rooms, (-1, 1), strict=True):
                end_m = side * (WALL_M / 2 + ROUNDING_M)
                at = inside(*_door_corners(door, (0.0, end_m), (-door.width_m / 2, door.width_m / 2)))
                free[at], region[at] = True, index[room_id]
            if door.leaf_room is not None:
                free[inside(*_door_corners(door, *door.leaf_m))] = False
        for obj in self.objects:
            if obj.is_obstacle:
                obstacle[inside(*obj.bounds_m[:, :2])] = True
        regions = {number: name for name, number in index.items()}
        return FloorMasks(free, region, obstacle, resolution_m, (float(low[0]), float(high[1])), regions)

    def free_space(self, clearance_m: float, resolution_m: float = 0.05) -> dict[str, np.ndarray]:
        """Return the free floor of each room.

        Args:
            clearance_m: Minimum distance from walls, doorways, door leaves and obstacles.
            resolution_m: Spacing of the points.

        Returns:
            Mapping from room id to (N, 2) points (x, y) in metres.
        """
        masks = self.floor_masks(resolution_m)
        # Distances are measured between pixel centres; an obstacle may extend half a diagonal beyond the centre of its
        # pixel.
        clear = (
            ndimage.distance_transform_edt(masks.free & ~masks.obstacle) - np.sqrt(0.5)
        ) * resolution_m >= clearance_m
        points = {}
        for number, room in enumerate(self.rooms, 1):
            row, column = np.nonzero(clear & (masks.region == number))
            x, y = masks.origin_m[0] + (column + 0.5) * resolution_m, masks.origin_m[1] - (row + 0.5) * resolution_m
            floor = np.column_stack([x, y])
            inside = (floor >= np.add(room.low_m, clearance_m)) & (floor <= np.subtract(room.high_m, clearance_m))
            points[room.id] = floor[inside.all(1)]
        return points

    @property
    def _extent_m(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (x, y) of the floor masks: the bounding rectangle of the rooms with a margin of at least 0.2 m."""
        low, high = np.min([room.low_m for room in self.rooms], 0), np.max([room.high_m for room in self.rooms], 0)
        return np.floor(low * 10 - 2) / 10, np.ceil(high * 10 + 2) / 10


def generate_building(style: Style, rooms: int, seed: int) -> Building:
    """Generate a building of a style with exactly `rooms` rooms, including corridors.

    The same arguments give the same building.

    Raises:
        ConfigError: The style is unknown or `rooms` is less than 4.
    """
    if style not in get_args(Style):
        raise ConfigError(f"unknown building style '{style}'; expected one of {', '.join(get_args(Style))}")
    if rooms < MIN_ROOMS:
        raise ConfigError(f"a building cannot have {rooms} rooms; expected at least {MIN_ROOMS}")
    layout = plan_layout(style, rooms, seed)
    return Building(style, seed, layout.rooms, layout.doors, layout.windows, furnish(layout, seed))


def change_building(
    building: Building,
    fraction: float,
    seed: int,
    changes: Changes = "uniform",
    kinds: Sequence[ChangeKind] = CHANGE_KINDS,
) -> Building:
    """Return the building after objects were removed, moved within their room, or added.

    An object that carries other objects, such as a desk with a monitor, does not change while it carries them. Moved
    objects keep their instance ids; added objects get new ids. Objects do not collide.

    Args:
        building: The original building.
        fraction: Number of changes as a fraction of the number of objects, split evenly over `kinds`.
        seed: Seed of the changes.
        changes: "uniform": all objects are equally likely, but fittings (toilets, counters, lamps, radiators) change
            last. "by-class": objects change at the rate of their class in `mobility.RATES`; the number of changes is
            limited by the number of objects that can move.
        kinds: Kinds of changes.

    Raises:
        ConfigError: `fraction` is not in [0, 1].
    """
    if not 0 <= fraction <= 1:
        raise ConfigError(f"the fraction of changed objects is {fraction}; expected 0 to 1")
    rng = np.random.default_rng((building.seed, seed, 5))
    total = round(fraction * len(building.objects))
    active_kinds = [kind for kind in CHANGE_KINDS if kind in kinds]
    parts = {kind: (total + number) // len(active_kinds) for number, kind in enumerate(active_kinds)}
    plans = {
        room.id: RoomPlan(room, building.layout, tuple(obj for obj in building.objects if obj.room == room.id))
        for room in building.rooms
    }
    if changes == "by-class":
        candidates = mobile_first(building.objects, rng)
    else:
        order = [building.objects[i] for i in rng.permutation(len(building.objects))]
        candidates = sorted(order, key=lambda obj: obj.label in _FITTINGS)
    _change(candidates, parts.get("removed", 0), plans, _remove)
    _change(candidates, parts.get("moved", 0), plans, partial(_move, rng=rng))
    next_id = max(obj.instance_id for obj in building.objects) + 1
    num_added = 0
    while num_added < parts.get("added", 0):
        plan = plans[building.rooms[rng.integers(len(building.rooms))].id]
        item = draw_item(plan.room.kind, rng)
        if changes == "by-class" and not appears(item[0], rng):
            continue
        if plan.place(*item, rng, next_id + num_added):
            num_added += 1
    objects = sorted((obj for plan in plans.values() for obj in plan.objects), key=lambda obj: obj.instance_id)
    return replace(building, objects=tuple(objects))


def _change(
    candidates: list[PlacedObject],
    count: int,
    plans: dict[str, RoomPlan],
    change: Callable[[RoomPlan, PlacedObject], bool],
) -> None:
    """Apply a change to the first `count` candidates for which it succeeds, and remove them from the candidates.

    Candidates that carry other objects are skipped.
    """
    while count:
        for obj in candidates:
            plan = plans[obj.room]
            if not any(obj.carries(other) for other in plan.objects) and change(plan, obj):
                candidates.remove(obj)
                count -= 1
                break
        else:
            return


def _remove(plan: RoomPlan, obj: PlacedObject) -> bool:
    """Remove the object from its room."""
    plan.remove(obj)
    return True


def _move(plan: RoomPlan, obj: PlacedObject, rng: np.random.Generator) -> bool:
    """Move the object to another position in its room; return False if there is none."""
    plan.remove(obj)
    if plan.place(obj.label, obj.seed, rng, obj.instance_id, away_from=obj):
        return True
    plan.add(obj)
    return False


def _in_world(mesh: Mesh, obj: PlacedObject | None) -> np.ndarray:
    """Return the vertices of a mesh in the world frame, (V, 3) float64. Structure already is in the world frame."""
    if obj is None:
        return mesh.vertices_m
    c, s = np.cos(obj.yaw_rad), np.sin(obj.yaw_rad)
    return mesh.vertices_m @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + (obj.x_m, obj.y_m, obj.z_m)


def _lamp_light(obj: PlacedObject) -> Light:
    """Return the light of a ceiling lamp, at its underside."""
    c, s = np.cos(obj.yaw_rad), np.sin(obj.yaw_rad)
    length, width = obj.size_m[0] * 0.85, obj.size_m[1] * 0.85
    edge_u, edge_v = (float(c * length), float(s * length), 0.0), (float(-s * width), float(c * width), 0.0)
    return Light((obj.x_m, obj.y_m, obj.z_m - 0.01), edge_u, edge_v, "lamp", obj.room, obj.instance_id)


def _door_corners(door: Door, along: tuple[float, float], across: tuple[float, float]) -> np.ndarray:
    """Return opposite corners of a rectangle, (2, 2), as (x, y).

    Args:
        door: The door.
        along: Range along the axis of the door, relative to its centre.
        across: Range across the axis of the door, relative to its centre.
    """
    corners = np.array([along, across]).T if door.axis == "x" else np.array([across, along]).T
    return corners + door.centre_m
