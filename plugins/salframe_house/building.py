"""Generated buildings: structure and furniture, their mesh, floor masks, and changed versions of them."""

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

Style = Literal["home", "office", "hotel"]
Changes = Literal["uniform", "by-class"]
ChangeKind = Literal["removed", "moved", "added"]
CHANGE_KINDS: tuple[ChangeKind, ...] = get_args(ChangeKind)
MIN_ROOMS = 4

# What is part of the house is changed only after everything else.
_FIXED = frozenset(
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
    """A furnished single-floor building in the world frame (metres, z up, floor at z = 0); corridors count as rooms."""

    style: Style
    seed: int
    rooms: tuple[Room, ...]
    doors: tuple[Door, ...]
    windows: tuple[Window, ...]
    objects: tuple[PlacedObject, ...]

    @property
    def layout(self) -> Layout:
        return Layout(self.rooms, self.doors, self.windows)

    @property
    def labels(self) -> dict[int, str]:
        """Instance id -> label."""
        return {placed.instance_id: placed.label for placed in self.objects}

    def scene(self, catalogue: Catalogue | None = None) -> Scene:
        """The triangles, materials and lights of the building; with a catalogue, some of its furniture are models of
        that."""
        meshes: list[tuple[Mesh, PlacedObject | None]] = [(shell_mesh(self.layout, self.style, self.seed), None)]
        meshes += [(object_mesh(o.label, o.size_m, o.seed, o.mirrored, catalogue), o) for o in self.objects]
        materials: dict[Material, int] = {}
        vertices, triangles, uv, material_index, instance_id = [], [], [], [], []
        count = 0
        for mesh, placed in meshes:
            vertices.append(_in_world(mesh, placed))
            triangles.append(mesh.triangles + count)
            uv.append(mesh.uv_m)
            material_index.append(
                np.array([materials.setdefault(m, len(materials)) for m in mesh.materials])[mesh.material_index]
            )
            instance_id.append(np.full(len(mesh.triangles), placed.instance_id if placed else 0))
            count += len(mesh.vertices_m)
        lights = [_lamp_light(placed) for placed in self.objects if placed.label == "ceiling lamp"]
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
        """Free floor, room labels (1 + index in `rooms`) and obstacles as seen from above.

        Thresholds are floor; the labels of two rooms meet in the middle of theirs
        (docs/how-to/maps.md#what-the-map-is-made-of). Open door leaves are no free floor. Obstacles are the footprints
        of all objects, save rugs, that begin below 1.5 m.
        """
        low, high = self._extent_m
        shape = tuple(np.ceil((high - low)[::-1] / resolution_m).astype(int))
        free, region, obstacle = np.zeros(shape, bool), np.zeros(shape, np.int32), np.zeros(shape, bool)
        x = low[0] + (np.arange(shape[1]) + 0.5) * resolution_m
        y = high[1] - (np.arange(shape[0]) + 0.5) * resolution_m

        def inside(first: np.ndarray, second: np.ndarray) -> tuple[slice, slice]:
            """Rows and columns whose pixel centres lie in the rectangle between two corners."""
            (x0, y0), (x1, y1) = np.minimum(first, second), np.maximum(first, second)
            columns, rows = np.searchsorted(x, (x0, x1)), len(y) - np.searchsorted(y[::-1], (y1, y0))
            return slice(*rows), slice(*columns)

        index = {room.id: number for number, room in enumerate(self.rooms, 1)}
        for room in self.rooms:
            at = inside(np.array(room.low_m), np.array(room.high_m))
            free[at], region[at] = True, index[room.id]
        for door in self.doors:
            for room_id, side in zip(door.rooms, (-1, 1), strict=True):
                at = inside(*_door_corners(door, (0.0, side * WALL_M / 2), (-door.width_m / 2, door.width_m / 2)))
                free[at], region[at] = True, index[room_id]
            if door.leaf_room is not None:
                free[inside(*_door_corners(door, *door.leaf_m))] = False
        for placed in self.objects:
            if placed.is_obstacle:
                obstacle[inside(*placed.bounds_m[:, :2])] = True
        regions = {number: name for name, number in index.items()}
        return FloorMasks(free, region, obstacle, resolution_m, (float(low[0]), float(high[1])), regions)

    def free_space(self, clearance_m: float, resolution_m: float = 0.05) -> dict[str, np.ndarray]:
        """Room id -> (N, 2) points (x, y) in metres of the room's floor at least `clearance_m` from walls, doorways,
        leaves and obstacles."""
        masks = self.floor_masks(resolution_m)
        # Distances are between pixel centres; what blocks a pixel may reach half a diagonal beyond its centre.
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
        low, high = np.min([room.low_m for room in self.rooms], 0), np.max([room.high_m for room in self.rooms], 0)
        return np.floor(low * 10 - 2) / 10, np.ceil(high * 10 + 2) / 10


def generate_building(style: Style, rooms: int, seed: int) -> Building:
    """Draw a building of a style with exactly this many rooms, corridors counted; the same arguments give the same
    building.

    Raises ConfigError on an unknown style and on fewer than 4 rooms.
    """
    if style not in get_args(Style):
        raise ConfigError(f"unknown style '{style}', expected one of {', '.join(get_args(Style))}")
    if rooms < MIN_ROOMS:
        raise ConfigError(f"a building of {rooms} rooms, expected at least {MIN_ROOMS}")
    layout = plan_layout(style, rooms, seed)
    return Building(style, seed, layout.rooms, layout.doors, layout.windows, furnish(layout, seed))


def change_building(
    building: Building,
    fraction: float,
    seed: int,
    changes: Changes = "uniform",
    kinds: Sequence[ChangeKind] = CHANGE_KINDS,
) -> Building:
    """The building after a while: `fraction` of its objects removed, moved within their room, or newly added, in equal
    parts of `kinds`.

    Objects that carry others stay until these are gone. `changes`: "uniform", any object as likely as another,
    fittings (lavatories, counters, lamps, radiators) last; "by-class", as often as mobility.RATES has it of their
    class, as many as can. Moved objects keep their instance id, new ones get new ids. Nothing collides. Raises
    ConfigError where `fraction` is not in [0, 1].
    """
    if not 0 <= fraction <= 1:
        raise ConfigError(f"a fraction of {fraction} of changed objects, expected 0 to 1")
    rng = np.random.default_rng((building.seed, seed, 5))
    total = round(fraction * len(building.objects))
    happening = [kind for kind in CHANGE_KINDS if kind in kinds]
    parts = {kind: (total + number) // len(happening) for number, kind in enumerate(happening)}
    plans = {
        room.id: RoomPlan(room, building.layout, tuple(placed for placed in building.objects if placed.room == room.id))
        for room in building.rooms
    }
    if changes == "by-class":
        waiting = mobile_first(building.objects, rng)
    else:
        order = [building.objects[i] for i in rng.permutation(len(building.objects))]
        waiting = sorted(order, key=lambda placed: placed.label in _FIXED)
    _change(waiting, parts.get("removed", 0), plans, _remove)
    _change(waiting, parts.get("moved", 0), plans, partial(_move, rng=rng))
    next_id = max(placed.instance_id for placed in building.objects) + 1
    added = 0
    while added < parts.get("added", 0):
        plan = plans[building.rooms[rng.integers(len(building.rooms))].id]
        item = draw_item(plan.room.kind, rng)
        if changes == "by-class" and not appears(item[0], rng):
            continue
        if plan.place(*item, rng, next_id + added):
            added += 1
    objects = sorted(
        (placed for plan in plans.values() for placed in plan.objects), key=lambda placed: placed.instance_id
    )
    return replace(building, objects=tuple(objects))


def _change(
    waiting: list[PlacedObject],
    count: int,
    plans: dict[str, RoomPlan],
    change: Callable[[RoomPlan, PlacedObject], bool],
) -> None:
    """Apply a change to the first `count` waiting objects that carry nothing and that it succeeds with; they no longer
    wait."""
    while count:
        for placed in waiting:
            plan = plans[placed.room]
            if not any(placed.carries(other) for other in plan.objects) and change(plan, placed):
                waiting.remove(placed)
                count -= 1
                break
        else:
            return


def _remove(plan: RoomPlan, placed: PlacedObject) -> bool:
    plan.remove(placed)
    return True


def _move(plan: RoomPlan, placed: PlacedObject, rng: np.random.Generator) -> bool:
    """Find the object another place in its room; where there is none it stays."""
    plan.remove(placed)
    if plan.place(placed.label, placed.seed, rng, placed.instance_id, away_from=placed):
        return True
    plan.add(placed)
    return False


def _in_world(mesh: Mesh, placed: PlacedObject | None) -> np.ndarray:
    """(V, 3) float64 vertices of a mesh where its object stands; the structure's already are in the world."""
    if placed is None:
        return mesh.vertices_m
    c, s = np.cos(placed.yaw_rad), np.sin(placed.yaw_rad)
    return mesh.vertices_m @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + (placed.x_m, placed.y_m, placed.z_m)


def _lamp_light(placed: PlacedObject) -> Light:
    """The light of a ceiling lamp, at its underside."""
    c, s = np.cos(placed.yaw_rad), np.sin(placed.yaw_rad)
    length, width = placed.size_m[0] * 0.85, placed.size_m[1] * 0.85
    edge_u, edge_v = (float(c * length), float(s * length), 0.0), (float(-s * width), float(c * width), 0.0)
    return Light((placed.x_m, placed.y_m, placed.z_m - 0.01), edge_u, edge_v, "lamp", placed.room, placed.instance_id)


def _door_corners(door: Door, along: tuple[float, float], across: tuple[float, float]) -> np.ndarray:
    """(2, 2) opposite corners (x, y) of a rectangle given along and across a door's axis from its centre."""
    corners = np.array([along, across]).T if door.axis == "x" else np.array([across, along]).T
    return corners + door.centre_m
