"""Placement of objects: candidate poses at walls, furniture and windows, and the rules that reject them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from salframe_house.furniture import CLASSES
from salframe_house.layout import Door, Layout, Room, Window
from salframe_house.object_class import ObjectClass, Size

STANDING_HEIGHT_M = 1.5  # objects that begin below this height are obstacles; lamps and pictures hang above
_FLAT_M = 0.05  # maximum height of objects that can be walked on
_WALL_GAP_M = 0.02  # distance to the wall, for the skirting
_HUNG_GAP_M = 0.004
_PASSAGE_M = 0.60
_CELL_M = 0.05
_TRIES = 48
_CONTACT_M = 1e-4  # tolerance of collisions: objects may touch
_INWARD = ((1, 0), (-1, 0), (0, 1), (0, -1))  # inward normals of the walls at low x, high x, low y, high y


@dataclass(frozen=True)
class PlacedObject:
    """An object in the building.

    The label, size, seed and `mirrored` determine its mesh.

    Attributes:
        instance_id: Unique number in the building.
        label: Object class.
        room: Id of the room.
        x_m: Position of the middle of the base.
        y_m: Position of the middle of the base.
        z_m: Height of the base.
        yaw_rad: Direction of the front.
        size_m: Size along the x, y, z axes of the object.
        seed: Seed of the shape and the materials.
        mirrored: Whether left and right are exchanged.
    """

    instance_id: int
    label: str
    room: str
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    size_m: Size
    seed: int
    mirrored: bool = False

    @property
    def half_extent_m(self) -> tuple[float, float]:
        """Half the extent of the bounding rectangle of the footprint along world x and y."""
        c, s = abs(np.cos(self.yaw_rad)), abs(np.sin(self.yaw_rad))
        return (c * self.size_m[0] + s * self.size_m[1]) / 2, (s * self.size_m[0] + c * self.size_m[1]) / 2

    @property
    def bounds_m(self) -> np.ndarray:
        """Lowest and highest corner of the bounding box in the world frame, (2, 3)."""
        hx, hy = self.half_extent_m
        return np.array(
            [[self.x_m - hx, self.y_m - hy, self.z_m], [self.x_m + hx, self.y_m + hy, self.z_m + self.size_m[2]]]
        )

    @property
    def is_obstacle(self) -> bool:
        """Whether the object blocks a walking person."""
        return self.z_m < STANDING_HEIGHT_M and self.size_m[2] > _FLAT_M

    def carries(self, other: PlacedObject) -> bool:
        """Return whether `other` stands on this object."""
        if other is self or abs(other.z_m - (self.z_m + self.size_m[2])) > 1e-3:
            return False
        low, high = self.bounds_m[:, :2]
        return bool(low[0] <= other.x_m <= high[0] and low[1] <= other.y_m <= high[1])


class RoomPlan:
    """A room during furnishing.

    Attributes:
        objects: The objects in the room.
    """

    def __init__(self, room: Room, layout: Layout, objects: tuple[PlacedObject, ...] = ()):
        self.room = room
        self.windows = [window for window in layout.windows if window.room == room.id]
        self._low, self._high = np.array(room.low_m), np.array(room.high_m)
        doors = [door for door in layout.doors if room.id in door.rooms]
        self._door_boxes = np.array([self._door_box(door) for door in doors]).reshape(-1, 2, 3)
        self._door_points = np.array([box[:, :2].mean(0) for box in self._door_boxes]).reshape(-1, 2)
        self._window_boxes = np.array([self._window_box(window) for window in self.windows]).reshape(-1, 2, 3)
        self.objects: list[PlacedObject] = []
        self._boxes = np.zeros((0, 2, 3))
        for obj in objects:
            self.add(obj)

    def add(self, obj: PlacedObject) -> None:
        """Add an object at its pose."""
        self.objects.append(obj)
        self._boxes = np.concatenate([self._boxes, obj.bounds_m[None]])

    def remove(self, obj: PlacedObject) -> None:
        """Remove an object."""
        index = self.objects.index(obj)
        del self.objects[index]
        self._boxes = np.delete(self._boxes, index, 0)

    def place(
        self,
        label: str,
        seed: int,
        rng: np.random.Generator,
        instance_id: int = 0,
        away_from: PlacedObject | None = None,
    ) -> PlacedObject | None:
        """Find a valid pose for an object among random candidates and add the object there.

        Args:
            label: Object class.
            seed: Seed of the object.
            rng: Source of the candidates.
            instance_id: Instance id of the object.
            away_from: Object from which the pose is at least 0.5 m away, or half the size of the room if that is less.

        Returns:
            The object, or None if no candidate is valid.
        """
        kind = CLASSES[label]
        for x, y, z, yaw, size in self._candidates(kind, kind.draw_size(seed), rng):
            if away_from and np.hypot(x - away_from.x_m, y - away_from.y_m) < min(
                0.5, *(side / 2 for side in self.room.size_m)
            ):
                continue
            obj = PlacedObject(
                instance_id, label, self.room.id, round(x, 4), round(y, 4), round(z, 4), round(yaw, 6), size, seed
            )
            if z >= 0 and self._fits(obj, kind):
                self.add(obj)
                return obj
        return None

    def _door_box(self, door: Door) -> np.ndarray:
        """Return the box in this room that remains free in front of a door."""
        along = "xy".index(door.axis)
        side = 1 if door.rooms[1] == self.room.id else -1
        face = (self._low if side > 0 else self._high)[along]
        reach = face + side * min(0.95, 0.45 * self.room.size_m[along])
        half = door.width_m / 2 + 0.08
        low, high = np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, 2.15])
        low[along], high[along] = min(face, reach), max(face, reach)
        low[1 - along], high[1 - along] = door.centre_m[1 - along] - half, door.centre_m[1 - along] + half
        return np.array([low, high])

    def _window_box(self, window: Window) -> np.ndarray:
        """Return the box in front of a window that only curtains may enter."""
        inward = np.array(window.inward)
        across = np.abs(inward[::-1]) * (window.width_m / 2 + 0.06)
        ends = np.array(
            [window.centre_m - across, window.centre_m + across + inward * 0.2, window.centre_m + inward * 0.2]
        )
        return np.array([[*ends.min(0), window.sill_m - 0.02], [*ends.max(0), window.head_m + 0.1]])

    def _fits(self, obj: PlacedObject, kind: ObjectClass) -> bool:
        """Return whether the object collides with nothing and leaves fronts and passages free."""
        box = obj.bounds_m
        if (
            (box[0, :2] < self._low).any()
            or (box[1, :2] > self._high).any()
            or box[1, 2] > self.room.height_m + _CONTACT_M
        ):
            return False
        if _overlaps(box, self._boxes).any() or _overlaps(box, self._door_boxes).any():
            return False
        if kind.stand != "window" and _overlaps(box, self._window_boxes).any():
            return False
        if obj.z_m > 0 or obj.size_m[2] < _FLAT_M:
            return True
        return self._leaves_fronts_free(obj, kind) and self._leaves_passages_free(box)

    def _leaves_fronts_free(self, obj: PlacedObject, kind: ObjectClass) -> bool:
        """Return whether the floor in front of the object and of all other objects is free."""
        front = _front_box(obj, kind)
        for other, box in zip(self.objects, self._boxes, strict=True):
            if other.z_m > 0 or other.size_m[2] < _FLAT_M:
                continue
            other_kind = CLASSES[other.label]
            if kind.front_m and obj.label not in other_kind.partners and _overlaps(front, box[None])[0]:
                return False
            other_front = _front_box(other, other_kind)
            if (
                other_kind.front_m
                and other.label not in kind.partners
                and _overlaps(obj.bounds_m, other_front[None])[0]
            ):
                return False
        return True

    def _leaves_passages_free(self, box: np.ndarray) -> bool:
        """Return whether a person can still walk between all doors and reach 85 % of the free floor.

        Args:
            box: Bounding box of the new object, (2, 3).
        """
        size = self._high - self._low
        free = np.ones(np.maximum(np.round(size / _CELL_M).astype(int), 1), bool)
        margin = int(_PASSAGE_M / 2 / _CELL_M)
        free[:margin] = free[-margin:] = free[:, :margin] = free[:, -margin:] = False
        blocking = [b for b, o in zip(self._boxes, self.objects, strict=True) if o.is_obstacle]
        for low, high in (*blocking, box):
            first = np.maximum(np.round((low[:2] - self._low - _PASSAGE_M / 2) / _CELL_M).astype(int), 0)
            last = np.maximum(np.round((high[:2] - self._low + _PASSAGE_M / 2) / _CELL_M).astype(int), 0)
            free[first[0] : last[0], first[1] : last[1]] = False
        labels, count = ndimage.label(free)
        if count == 0:
            return False
        cells = np.clip(((self._door_points - self._low) / _CELL_M).astype(int), 0, np.array(free.shape) - 1)
        at_doors = labels[cells[:, 0], cells[:, 1]]
        if (at_doors == 0).any() or len(set(at_doors.tolist())) > 1:
            return False
        return (labels == at_doors[0]).sum() >= 0.85 * free.sum() if len(at_doors) else True

    def _candidates(
        self, kind: ObjectClass, size: Size, rng: np.random.Generator
    ) -> Iterator[tuple[float, float, float, float, Size]]:
        """Generate candidate poses (x, y, z, yaw) and sizes in random order."""
        if kind.stand == "window":
            for index in rng.permutation(len(self.windows)):
                yield _over_window(size, self.windows[index])
        elif kind.stand == "ceiling":
            for x, y in self._ceiling_points(rng):
                yield x, y, self.room.height_m - size[2], self._long_axis_yaw, size
        elif kind.partners:
            partners = [obj for obj in self.objects if obj.label in kind.partners]
            for _ in range(_TRIES if partners else 0):
                yield *_by_partner(kind, size, partners[rng.integers(len(partners))], rng), size
        else:
            if kind.stand == "sill":
                for index in rng.permutation(len(self.windows)):
                    window = self.windows[index]
                    x, y, yaw = self._at_wall(size, _WALL_GAP_M, _INWARD.index(window.inward), window.centre_m)
                    yield x, y, 0.0, yaw, size
            for _ in range(_TRIES):
                if kind.stand == "centre":
                    yield *self._on_free_floor(size, rng), size
                else:
                    yield *self._along_walls(kind, size, rng), size

    @property
    def _long_axis_yaw(self) -> float:
        """Yaw that aligns the width of an object with the long axis of the room."""
        return 0.0 if self.room.size_m[1] >= self.room.size_m[0] else np.pi / 2

    def _ceiling_points(self, rng: np.random.Generator) -> list[tuple[float, float]]:
        """Return regular positions along the long axis, from the middle of the room outwards, then random ones."""
        long = int(self.room.size_m[1] >= self.room.size_m[0])
        spaces = max(1, round(self.room.size_m[long] / 5.5))
        middle = np.array(self.room.centre_m)
        points = np.tile(middle, (spaces, 1))
        points[:, long] = self._low[long] + (np.arange(spaces) + 0.5) * self.room.size_m[long] / spaces
        points = points[np.argsort(np.abs(points - middle).sum(1), kind="stable")]
        spread = middle + rng.uniform(-0.3, 0.3, (8, 2)) * self.room.size_m
        return [(float(x), float(y)) for x, y in np.concatenate([points, spread])]

    def _on_free_floor(self, size: Size, rng: np.random.Generator) -> tuple[float, float, float, float]:
        """Return a random pose on the floor, aligned with the walls."""
        quarter_turns = int(rng.integers(2))
        slack = (self._high - self._low - (size[1::-1] if quarter_turns else size[:2])) / 2
        x, y = np.array(self.room.centre_m) + slack * rng.uniform(-0.8, 0.8, 2)
        return float(x), float(y), 0.0, quarter_turns * np.pi / 2 + rng.integers(2) * np.pi

    def _along_walls(
        self, kind: ObjectClass, size: Size, rng: np.random.Generator
    ) -> tuple[float, float, float, float]:
        """Return a random pose with the back to a wall.

        60 % of the poses (corner furniture: 10 %) are anywhere along the wall, the others at one of its ends.
        """
        wall = int(rng.integers(4))
        hung = kind.stand == "hung"
        slack = np.array(self.room.size_m) / 2 - size[1] / 2 - _WALL_GAP_M
        shift = (
            rng.uniform(-1, 1)
            if hung or rng.random() > (0.9 if kind.stand == "corner" else 0.4)
            else rng.choice((-1.0, 1.0))
        )
        x, y, yaw = self._at_wall(
            size, _HUNG_GAP_M if hung else _WALL_GAP_M, wall, np.array(self.room.centre_m) + shift * slack
        )
        return x, y, float(rng.uniform(*kind.base_m)) if hung else 0.0, yaw

    def _at_wall(
        self, size: Size, gap: float, wall: int, beside_m: np.ndarray | tuple[float, float]
    ) -> tuple[float, float, float]:
        """Return the position and yaw of an object with its back to a wall, next to a point.

        Args:
            size: Size of the object.
            gap: Distance to the wall.
            wall: Index into `_INWARD`.
            beside_m: The point (x, y).
        """
        inward = np.array(_INWARD[wall])
        face = np.where(inward > 0, self._low, self._high)
        point = np.where(inward != 0, face + inward * (size[0] / 2 + gap), beside_m)
        return float(point[0]), float(point[1]), float(np.arctan2(inward[1], inward[0]))


def _over_window(size: Size, window: Window) -> tuple[float, float, float, float, Size]:
    """Return the pose and the size of a curtain, which is slightly wider than the window."""
    x, y = np.array(window.centre_m) + np.array(window.inward) * (size[0] / 2 + 0.03)
    yaw = float(np.arctan2(window.inward[1], window.inward[0]))
    curtain_size = (size[0], round(window.width_m + 0.3, 3), round(window.head_m - window.sill_m + 0.22, 3))
    return float(x), float(y), window.sill_m - 0.12, yaw, curtain_size


def _by_partner(
    kind: ObjectClass, size: Size, partner: PlacedObject, rng: np.random.Generator
) -> tuple[float, float, float, float]:
    """Return a random pose relative to a partner.

    `kind.stand` determines whether the object stands in front of the partner or around it (and faces the partner),
    beside the partner (and looks in the same direction), or on top of it.
    """
    half_x, half_y, gap = partner.size_m[0] / 2, partner.size_m[1] / 2, rng.uniform(*kind.gap_m)
    turn, z = 0.0, 0.0
    if kind.stand == "beside":
        x, y = size[0] / 2 - half_x, rng.choice((-1, 1)) * (half_y + size[1] / 2 + gap)
    elif kind.stand == "top":
        x, y = (
            max(half - side / 2, 0.0) * rng.uniform(-0.9, 0.9)
            for half, side in zip((half_x, half_y), size, strict=False)
        )
        z = partner.z_m + partner.size_m[2]
        if size[0] > partner.size_m[0] or size[1] > partner.size_m[1]:
            z = -1.0  # does not fit on the partner
    else:
        turn = np.pi if kind.stand == "front" else rng.integers(4) * np.pi / 2
        reach, width = (half_x, half_y) if np.cos(turn) ** 2 > 0.5 else (half_y, half_x)
        shift = max(width - size[1] / 2, 0.0) * rng.uniform(-1, 1) * (0.4 if kind.stand == "front" else 1.0)
        facing = np.array([np.cos(turn), np.sin(turn)])  # towards the partner, in its frame
        x, y = -facing * (reach + size[0] / 2 + gap) + np.array([-facing[1], facing[0]]) * shift
    c, s = np.cos(partner.yaw_rad), np.sin(partner.yaw_rad)
    yaw = (partner.yaw_rad + turn + np.pi) % (2 * np.pi) - np.pi
    return float(partner.x_m + c * x - s * y), float(partner.y_m + s * x + c * y), z, float(yaw)


def _front_box(obj: PlacedObject, kind: ObjectClass) -> np.ndarray:
    """Return the box in front of an object that other furniture leaves free, (2, 3)."""
    c, s = np.cos(obj.yaw_rad), np.sin(obj.yaw_rad)
    reach = obj.size_m[0] / 2 + kind.front_m
    half = obj.size_m[1] / 2
    corners = np.array([(c * x - s * y, s * x + c * y) for x in (obj.size_m[0] / 2, reach) for y in (-half, half)])
    corners += (obj.x_m, obj.y_m)
    return np.array([[*corners.min(0), 0.0], [*corners.max(0), STANDING_HEIGHT_M]])


def _overlaps(box: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Return which boxes (N, 2, 3) overlap a box (2, 3), (N,) bool."""
    return ((box[0] < boxes[:, 1] - _CONTACT_M) & (box[1] > boxes[:, 0] + _CONTACT_M)).all(1)
