"""What stands in which kind of room, and the furnishing of a building with it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from salframe_house.furniture import CLASSES
from salframe_house.layout import Layout, Room
from salframe_house.placement import PlacedObject, RoomPlan

LEAST_OBJECTS, MOST_OBJECTS = 5, 14
_MEAN_OBJECTS, _SPREAD_OBJECTS = 7.7, 1.4
_ATTEMPTS = 8
_LAMP_SPACING_M = 5.5


@dataclass(frozen=True)
class Recipe:
    """The furniture of a kind of room: `core` label -> (least, most) times, `optional` label -> weight."""

    core: dict[str, tuple[int, int]]
    optional: dict[str, float]


RECIPES: dict[str, Recipe] = {
    # office
    "office": Recipe(
        {"desk": (1, 2), "office chair": (1, 2)},
        {
            "monitor": 20,
            "trash can": 12,
            "bookshelf": 9,
            "file cabinet": 6,
            "plant": 4,
            "picture": 2,
            "whiteboard": 1,
            "chair": 1,
            "radiator": 0.5,
            "cabinet": 0.3,
            "curtain": 0.3,
            "clock": 0.3,
            "lamp": 0.3,
            "laptop": 0.2,
            "telephone": 0.2,
            "coat rack": 0.2,
            "notice board": 0.2,
            "printer": 0.1,
        },
    ),
    "meeting-room": Recipe(
        {"conference table": (1, 1), "chair": (2, 4)},
        {
            "whiteboard": 12,
            "tv": 8,
            "plant": 6,
            "picture": 4,
            "projector": 3,
            "flip chart": 1,
            "cabinet": 1,
            "clock": 0.7,
            "radiator": 0.7,
            "trash can": 0.7,
            "curtain": 0.7,
            "laptop": 0.7,
            "telephone": 0.7,
            "coat rack": 0.7,
            "flowers": 0.7,
        },
    ),
    "lounge": Recipe(
        {"sofa": (1, 1), "armchair": (0, 2)},
        {
            "coffee table": 6,
            "plant": 5,
            "picture": 4,
            "floor lamp": 4,
            "side table": 1.5,
            "rug": 1.5,
            "bookshelf": 1.5,
            "ottoman": 1,
            "tv": 1,
            "clock": 1,
            "water cooler": 1,
            "curtain": 1,
            "flowers": 1,
            "trash can": 1,
            "radiator": 1,
            "brochure stand": 1,
        },
    ),
    "break-room": Recipe(
        {"kitchen counter": (1, 1), "refrigerator": (0, 1), "breakfast table": (0, 1)},
        {
            "chair": 5,
            "kitchen sink": 4,
            "kitchen cabinet": 4,
            "microwave": 4,
            "coffee machine": 3,
            "dishwasher": 1.5,
            "kettle": 1.5,
            "trash can": 1.5,
            "bar table": 1,
            "stool": 1,
            "vending machine": 1,
            "recycling bin": 1,
            "clock": 1,
            "notice board": 1,
            "water cooler": 1,
            "picture": 1,
        },
    ),
    "restroom": Recipe(
        {"toilet": (1, 2), "sink": (1, 2)},
        {
            "mirror": 12,
            "trash can": 8,
            "hand dryer": 6,
            "toilet paper": 4,
            "urinal": 1.5,
            "radiator": 1.5,
            "towel": 1,
            "picture": 0.7,
            "plant": 0.7,
            "wall shelf": 0.7,
            "cabinet": 0.7,
            "laundry basket": 0.5,
        },
    ),
    "storage": Recipe(
        {"storage shelf": (1, 2)},
        {
            "box": 6,
            "cabinet": 4,
            "file cabinet": 3,
            "locker": 3,
            "fire extinguisher": 1,
            "trash can": 1,
            "coat rack": 1,
            "chair": 0.5,
            "printer": 1,
            "recycling bin": 1,
            "radiator": 1,
            "notice board": 1,
            "clock": 1,
            "wall shelf": 1,
            "desk": 1,
        },
    ),
    "copy-room": Recipe(
        {"copier": (1, 1)},
        {
            "cabinet": 8,
            "trash can": 8,
            "file cabinet": 6,
            "recycling bin": 4,
            "storage shelf": 1.5,
            "printer": 1.5,
            "notice board": 1.5,
            "box": 1.5,
            "clock": 1,
            "wall shelf": 1,
            "picture": 1,
            "plant": 1,
            "water cooler": 1,
            "radiator": 1,
            "bookshelf": 1,
        },
    ),
    # hotel
    "hotel-room": Recipe(
        {"bed": (1, 1), "nightstand": (1, 2)},
        {
            "lamp": 2.5,
            "desk": 2,
            "chair": 1.5,
            "tv": 2,
            "wardrobe": 2,
            "luggage rack": 2,
            "picture": 2,
            "curtain": 2,
            "armchair": 1.5,
            "floor lamp": 1,
            "mirror": 1,
            "trash can": 1,
            "radiator": 1,
            "side table": 1,
            "dresser": 1,
            "telephone": 1,
            "kettle": 0.7,
            "wall lamp": 1,
        },
    ),
    "lobby": Recipe(
        {"reception desk": (1, 1), "sofa": (0, 1), "armchair": (0, 2)},
        {
            "coffee table": 2,
            "plant": 2,
            "picture": 2,
            "floor lamp": 1.5,
            "monitor": 1.5,
            "office chair": 1.5,
            "flowers": 1.5,
            "brochure stand": 1.5,
            "clock": 1.5,
            "rug": 1,
            "umbrella stand": 1,
            "side table": 1,
            "curtain": 1,
            "vending machine": 0.7,
            "telephone": 1,
            "piano": 0.5,
        },
    ),
    "breakfast-room": Recipe(
        {"breakfast table": (1, 3), "chair": (2, 4)},
        {
            "cabinet": 2,
            "coffee machine": 2,
            "picture": 2,
            "plant": 2,
            "curtain": 1.5,
            "flowers": 1.5,
            "clock": 1,
            "refrigerator": 1,
            "microwave": 1,
            "tv": 1,
            "trash can": 1,
            "mirror": 0.7,
            "wall lamp": 1,
            "bar table": 1,
            "radiator": 1,
        },
    ),
    "linen-room": Recipe(
        {"storage shelf": (1, 1), "washing machine": (0, 2)},
        {
            "housekeeping cart": 2,
            "laundry basket": 2,
            "ironing board": 2,
            "sink": 1.5,
            "cabinet": 1.5,
            "box": 1.5,
            "locker": 1,
            "drying rack": 1,
            "towel": 1,
            "clock": 1,
            "trash can": 1,
            "fire extinguisher": 1,
            "wall shelf": 1,
            "radiator": 1,
        },
    ),
    # home
    "living-room": Recipe(
        {"sofa": (1, 1), "tv stand": (0, 1)},
        {
            "coffee table": 3,
            "armchair": 2,
            "tv": 2,
            "bookshelf": 2,
            "plant": 2,
            "picture": 2,
            "floor lamp": 2,
            "curtain": 2,
            "rug": 2,
            "side table": 1.5,
            "fireplace": 1,
            "piano": 1,
            "lamp": 1,
            "ottoman": 1,
            "cabinet": 1,
            "clock": 1,
            "radiator": 1,
        },
    ),
    "kitchen": Recipe(
        {"kitchen counter": (1, 2), "refrigerator": (1, 1), "oven": (0, 1), "kitchen sink": (0, 1)},
        {
            "kitchen cabinet": 2,
            "dishwasher": 2,
            "microwave": 1.5,
            "coffee machine": 1,
            "kettle": 1,
            "breakfast table": 1.5,
            "chair": 2,
            "stool": 1,
            "trash can": 1.5,
            "clock": 1,
            "curtain": 1,
            "picture": 1,
            "towel": 1,
            "plant": 1,
            "radiator": 1,
        },
    ),
    "bedroom": Recipe(
        {"bed": (1, 1), "wardrobe": (0, 1)},
        {
            "nightstand": 3,
            "lamp": 2,
            "dresser": 2,
            "curtain": 2,
            "picture": 2,
            "mirror": 1.5,
            "rug": 1.5,
            "chair": 1,
            "armchair": 1,
            "desk": 1,
            "plant": 1,
            "radiator": 1.5,
            "laundry basket": 1,
            "bookshelf": 1,
            "stool": 0.7,
            "baby bed": 0.5,
            "floor lamp": 0.7,
            "clock": 0.7,
        },
    ),
    "bathroom": Recipe(
        {"toilet": (1, 1), "shower": (0, 1)},
        {
            "sink": 2,
            "bathroom vanity": 2,
            "towel": 2.5,
            "mirror": 2.5,
            "bathtub": 1.5,
            "toilet paper": 1.5,
            "trash can": 1.5,
            "laundry basket": 1,
            "radiator": 1,
            "wall lamp": 1,
            "wall shelf": 1,
            "stool": 0.5,
            "picture": 0.5,
            "plant": 0.5,
        },
    ),
    "dining-room": Recipe(
        {"dining table": (1, 1), "chair": (2, 4)},
        {
            "cabinet": 2,
            "flowers": 2,
            "picture": 2,
            "plant": 2,
            "curtain": 1.5,
            "mirror": 1,
            "floor lamp": 1,
            "piano": 0.7,
            "rug": 0.7,
            "clock": 1,
            "radiator": 1,
            "wall lamp": 1,
            "bookshelf": 1,
        },
    ),
    "study": Recipe(
        {"desk": (1, 1), "office chair": (1, 1)},
        {
            "bookshelf": 3,
            "lamp": 2,
            "monitor": 2,
            "picture": 2,
            "armchair": 1.5,
            "plant": 1.5,
            "laptop": 1.5,
            "trash can": 1.5,
            "curtain": 1.5,
            "rug": 1,
            "cabinet": 1,
            "clock": 1,
            "printer": 1,
            "floor lamp": 1,
            "radiator": 1,
            "treadmill": 0.5,
        },
    ),
    "laundry-room": Recipe(
        {"washing machine": (1, 2)},
        {
            "laundry basket": 2,
            "ironing board": 2,
            "drying rack": 1.5,
            "sink": 1.5,
            "cabinet": 1.5,
            "storage shelf": 1.5,
            "wall shelf": 1,
            "box": 1,
            "shoe rack": 1,
            "trash can": 1,
            "towel": 1,
            "radiator": 1,
            "clock": 0.7,
        },
    ),
    # all
    "corridor": Recipe(
        {},
        {
            "picture": 2.5,
            "plant": 2,
            "fire extinguisher": 2,
            "bench": 1.5,
            "mirror": 1,
            "wall lamp": 1.5,
            "trash can": 1,
            "clock": 1,
            "coat rack": 1,
            "notice board": 1,
            "umbrella stand": 0.7,
            "shoe rack": 0.5,
            "cabinet": 1,
            "radiator": 1,
        },
    ),
}

Item = tuple[str, int]  # label, seed of size and look


def furnish(layout: Layout, seed: int) -> tuple[PlacedObject, ...]:
    """Furnish every room; instance ids count from 1."""
    rng = np.random.default_rng((seed, 4))
    groups: dict[str, list[Room]] = {}
    for room in layout.rooms:
        if not room.mirrored:
            groups.setdefault(room.twin or room.id, []).append(room)
    placed: dict[str, list[PlacedObject]] = {}
    for rooms in groups.values():
        placed |= {room.id: plan.objects for room, plan in zip(rooms, _furnish_group(rooms, layout, rng), strict=True)}
    by_id = {room.id: room for room in layout.rooms}
    for room in layout.rooms:
        if room.mirror_of:
            placed[room.id] = _mirrored(placed[room.mirror_of], by_id[room.mirror_of], room, layout)
    in_order = [placed_object for room in layout.rooms for placed_object in placed[room.id]]
    return tuple(replace(placed_object, instance_id=number) for number, placed_object in enumerate(in_order, 1))


def draw_item(kind: str, rng: np.random.Generator) -> Item:
    """An object that a room of this kind may hold beside what it has."""
    optional = RECIPES[kind].optional
    weights = np.array(list(optional.values()))
    return list(optional)[rng.choice(len(optional), p=weights / weights.sum())], int(rng.integers(1 << 31))


def _draw_items(room: Room, rng: np.random.Generator) -> list[Item]:
    """The labels of a room, drawn from its recipe, each with a seed."""
    recipe = RECIPES[room.kind]
    lamps = min(4, max(1, round(max(room.size_m) / _LAMP_SPACING_M)))
    labels = ["ceiling lamp"] * lamps
    for label, (least, most) in recipe.core.items():
        labels += [label] * int(rng.integers(least, most + 1))
    drawn = round(rng.normal(_MEAN_OBJECTS, _SPREAD_OBJECTS)) + lamps - 1  # a long corridor needs more than its lamps
    number = int(np.clip(drawn, LEAST_OBJECTS, MOST_OBJECTS))
    names, weights = list(recipe.optional), np.array(list(recipe.optional.values()))
    order = rng.choice(len(names), len(names), replace=False, p=weights / weights.sum())
    wanted = [names[i] for i in order]
    possible = set(labels) | set(wanted[: max(number - len(labels), 0)])
    for label in wanted:
        partners = CLASSES[label].partners
        if len(labels) < number and (not partners or possible & set(partners)):
            labels.append(label)
    return [(label, int(rng.integers(1 << 31))) for label in labels[:MOST_OBJECTS]]


def _furnish_group(rooms: list[Room], layout: Layout, rng: np.random.Generator) -> list[RoomPlan]:
    """Rooms with the same list of objects. What does not fit into one of them is left out of all."""
    items = _draw_items(rooms[0], rng)
    while True:
        plans: list[RoomPlan] = []
        failed: Counter[Item] = Counter()
        for room in rooms:
            plan, missing = _furnish_room(room, layout, items, rng)
            plans.append(plan)
            failed |= Counter(missing)
        if not failed and len(items) >= LEAST_OBJECTS:
            return plans
        items = list((Counter(items) - failed).elements())
        if len(items) < LEAST_OBJECTS:
            items.append(draw_item(rooms[0].kind, rng))


def _furnish_room(
    room: Room, layout: Layout, items: list[Item], rng: np.random.Generator
) -> tuple[RoomPlan, list[Item]]:
    """The best of some attempts to place the items: the plan and what found no place."""

    def attempt() -> tuple[RoomPlan, list[Item]]:
        plan = RoomPlan(room, layout)
        return plan, [item for item in _in_placing_order(items, rng) if plan.place(*item, rng) is None]

    best = attempt()
    for _ in range(_ATTEMPTS - 1):
        if not best[1]:
            break
        again = attempt()
        best = again if len(again[1]) < len(best[1]) else best
    return best


def _in_placing_order(items: list[Item], rng: np.random.Generator) -> list[Item]:
    """Large furniture first, then what goes with other objects, then what hangs."""

    def rank(item: Item) -> tuple[int, float]:
        kind = CLASSES[item[0]]
        group = 2 if kind.stand in ("top", "hung") else 1 if kind.partners else 0
        return group, -kind.high_m[0] * kind.high_m[1] * rng.uniform(0.5, 1.0)

    return sorted(items, key=rank)


def _mirrored(objects: list[PlacedObject], source: Room, target: Room, layout: Layout) -> list[PlacedObject]:
    """The furniture of a room reflected into the room that is its mirror image."""
    before, after = _openings(source, layout), _openings(target, layout)
    flip = min(
        ((-1, 1), (1, -1)), key=lambda axes: float(np.linalg.norm(before[:, None] * axes - after, axis=2).min(1).max())
    )
    reflected = []
    for placed in objects:
        x, y = (
            t + f * (p - s)
            for t, f, p, s in zip(target.centre_m, flip, (placed.x_m, placed.y_m), source.centre_m, strict=True)
        )
        yaw = np.arctan2(flip[1] * np.sin(placed.yaw_rad), flip[0] * np.cos(placed.yaw_rad))
        turned = replace(placed, x_m=round(x, 4), y_m=round(y, 4), yaw_rad=round(float(yaw), 6))
        reflected.append(replace(turned, room=target.id, mirrored=not placed.mirrored))
    return reflected


def _openings(room: Room, layout: Layout) -> np.ndarray:
    """(N, 2) middles of a room's doors and windows relative to its own."""
    points = [door.centre_m for door in layout.doors if room.id in door.rooms]
    points += [window.centre_m for window in layout.windows if window.room == room.id]
    return np.array(points) - room.centre_m
