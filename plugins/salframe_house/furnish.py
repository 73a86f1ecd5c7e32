"""Furnishing of a building: select the objects of each room from its recipe and place them."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from salframe_house.furniture import CLASSES
from salframe_house.layout import Layout, Room
from salframe_house.placement import PlacedObject, RoomPlan
from salframe_house.recipes import RECIPES

MIN_OBJECTS, MAX_OBJECTS = 5, 14
_MEAN_OBJECTS, _SPREAD_OBJECTS = 7.7, 1.4
_ATTEMPTS = 8
_LAMP_SPACING_M = 5.5


Item = tuple[str, int]  # label, seed of size and look


def furnish(layout: Layout, seed: int) -> tuple[PlacedObject, ...]:
    """Furnish every room. Instance ids start at 1."""
    rng = np.random.default_rng((seed, 4))
    groups: dict[str, list[Room]] = {}
    for room in layout.rooms:
        if not room.mirrored:
            groups.setdefault(room.twin or room.id, []).append(room)
    by_room: dict[str, list[PlacedObject]] = {}
    for rooms in groups.values():
        by_room |= {room.id: plan.objects for room, plan in zip(rooms, _furnish_group(rooms, layout, rng), strict=True)}
    rooms_by_id = {room.id: room for room in layout.rooms}
    for room in layout.rooms:
        if room.mirror_of:
            by_room[room.id] = _mirrored(by_room[room.mirror_of], rooms_by_id[room.mirror_of], room, layout)
    objects = [obj for room in layout.rooms for obj in by_room[room.id]]
    return tuple(replace(obj, instance_id=number) for number, obj in enumerate(objects, 1))


def draw_item(kind: str, rng: np.random.Generator) -> Item:
    """Select an optional object for a room of this kind at random."""
    optional = RECIPES[kind].optional
    weights = np.array(list(optional.values()))
    return list(optional)[rng.choice(len(optional), p=weights / weights.sum())], int(rng.integers(1 << 31))


def _draw_items(room: Room, rng: np.random.Generator) -> list[Item]:
    """Draw the labels of a room from its recipe, each with a seed."""
    recipe = RECIPES[room.kind]
    lamps = min(4, max(1, round(max(room.size_m) / _LAMP_SPACING_M)))
    labels = ["ceiling lamp"] * lamps
    for label, (min_count, max_count) in recipe.core.items():
        labels += [label] * int(rng.integers(min_count, max_count + 1))
    # Lamps beyond the first are extra, so that long corridors hold other objects.
    total = round(rng.normal(_MEAN_OBJECTS, _SPREAD_OBJECTS)) + lamps - 1
    number = int(np.clip(total, MIN_OBJECTS, MAX_OBJECTS))
    names, weights = list(recipe.optional), np.array(list(recipe.optional.values()))
    order = rng.choice(len(names), len(names), replace=False, p=weights / weights.sum())
    optional = [names[i] for i in order]
    possible = set(labels) | set(optional[: max(number - len(labels), 0)])
    for label in optional:
        partners = CLASSES[label].partners
        if len(labels) < number and (not partners or possible & set(partners)):
            labels.append(label)
    return [(label, int(rng.integers(1 << 31))) for label in labels[:MAX_OBJECTS]]


def _furnish_group(rooms: list[Room], layout: Layout, rng: np.random.Generator) -> list[RoomPlan]:
    """Furnish rooms that share one list of objects.

    An object that does not fit into one of the rooms is left out of all of them.
    """
    items = _draw_items(rooms[0], rng)
    while True:
        plans: list[RoomPlan] = []
        failures: Counter[Item] = Counter()
        for room in rooms:
            plan, leftovers = _furnish_room(room, layout, items, rng)
            plans.append(plan)
            failures |= Counter(leftovers)
        if not failures and len(items) >= MIN_OBJECTS:
            return plans
        items = list((Counter(items) - failures).elements())
        if len(items) < MIN_OBJECTS:
            items.append(draw_item(rooms[0].kind, rng))


def _furnish_room(
    room: Room, layout: Layout, items: list[Item], rng: np.random.Generator
) -> tuple[RoomPlan, list[Item]]:
    """Return the best of several attempts to place the items: the plan and the items that did not fit."""

    def attempt() -> tuple[RoomPlan, list[Item]]:
        plan = RoomPlan(room, layout)
        return plan, [item for item in _in_placing_order(items, rng) if plan.place(*item, rng) is None]

    best = attempt()
    for _ in range(_ATTEMPTS - 1):
        if not best[1]:
            break
        candidate = attempt()
        best = candidate if len(candidate[1]) < len(best[1]) else best
    return best


def _in_placing_order(items: list[Item], rng: np.random.Generator) -> list[Item]:
    """Sort items: large furniture first, then objects placed relative to others, then objects on tables or walls."""

    def rank(item: Item) -> tuple[int, float]:
        kind = CLASSES[item[0]]
        group = 2 if kind.stand in ("top", "hung") else 1 if kind.partners else 0
        return group, -kind.high_m[0] * kind.high_m[1] * rng.uniform(0.5, 1.0)

    return sorted(items, key=rank)


def _mirrored(objects: list[PlacedObject], source: Room, target: Room, layout: Layout) -> list[PlacedObject]:
    """Reflect the furniture of a room into the room that is its mirror image."""
    source_openings, target_openings = _openings(source, layout), _openings(target, layout)
    flip = min(
        ((-1, 1), (1, -1)),
        key=lambda axes: float(np.linalg.norm(source_openings[:, None] * axes - target_openings, axis=2).min(1).max()),
    )
    mirror_objects = []
    for obj in objects:
        x, y = (
            t + f * (p - s)
            for t, f, p, s in zip(target.centre_m, flip, (obj.x_m, obj.y_m), source.centre_m, strict=True)
        )
        yaw = np.arctan2(flip[1] * np.sin(obj.yaw_rad), flip[0] * np.cos(obj.yaw_rad))
        mirror_obj = replace(obj, x_m=round(x, 4), y_m=round(y, 4), yaw_rad=round(float(yaw), 6))
        mirror_objects.append(replace(mirror_obj, room=target.id, mirrored=not obj.mirrored))
    return mirror_objects


def _openings(room: Room, layout: Layout) -> np.ndarray:
    """Return the centres of the doors and windows of a room relative to the centre of the room, (N, 2)."""
    points = [door.centre_m for door in layout.doors if room.id in door.rooms]
    points += [window.centre_m for window in layout.windows if window.room == room.id]
    return np.array(points) - room.centre_m
