"""The lines of a page: methods of several runs side by side, those pooled that differ in the data's seed alone."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from salframe.evaluation.report.view import RunView
from salframe.evaluation.runs.method_row import MethodRow
from salframe.framework.components.settings import spell_value

SEED = "seed"
"""The setting of data that tells runs apart which are shown as one."""


class Entry(NamedTuple):
    """A method of a run: the run's position among those shown, and the method's among those of the run."""

    run: int
    method: int


@dataclass(frozen=True, eq=False)
class Arm:
    """A method under its settings on data but for their seed: its short name, its label in the runs, the values of the
    settings in which the arms differ by their dotted keys, its row, over all seeds, and where it was run."""

    name: str
    label: str
    base: str
    varied: Mapping[str, str]
    row: MethodRow
    entries: tuple[Entry, ...]


def find_entries(views: Sequence[RunView[Any, Any]]) -> list[tuple[Entry, ...]]:
    """Where each method was run under the same settings on data that differ in their seed alone, in order. What two
    runs did alike on the same data counts once."""
    found: dict[str, dict[str, Entry]] = {}
    for number, view in enumerate(views):
        request = view.result.request
        data = {key: value for key, value in view.data.items() if key != SEED}
        for position, (label, settings) in enumerate(request["methods"].items()):
            known_by = json.dumps([request["task"], data, label, settings], sort_keys=True)
            seed = json.dumps(view.data.get(SEED))
            found.setdefault(known_by, {}).setdefault(seed, Entry(number, position))
    return [tuple(alike.values()) for alike in found.values()]


def name_arms(
    views: Sequence[RunView[Any, Any]], entries: Sequence[tuple[Entry, ...]], rows: Sequence[MethodRow]
) -> list[Arm]:
    """The arms of some runs, of `find_entries` and the row of each."""
    labels = [views[one[0].run].records[one[0].method].label for one in entries]
    bases = [label.partition("[")[0] for label in labels]
    settings = [_settings_of(views[one[0].run], label) for one, label in zip(entries, labels, strict=True)]
    keys = find_varied(settings, bases)
    named = [{key: spell_value(own[key]) for key in keys if key in own} for own in settings]
    names = _short_names(bases, named)
    return [Arm(*parts) for parts in zip(names, labels, bases, named, rows, entries, strict=True)]


def find_varied(settings: Sequence[Mapping[str, Any]], bases: Sequence[str]) -> list[str]:
    """The keys in which arms differ that go by one name; below a slot that holds different components, those alone in
    which arms with the same component differ."""
    keys = list(dict.fromkeys(key for own in settings for key in own))
    return [key for key in keys if any(_differ(key, group) for group in _same(settings, bases, key))]


def _same(settings: Sequence[Mapping[str, Any]], bases: Sequence[str], key: str) -> Iterator[list[Mapping[str, Any]]]:
    """Arms in groups whose names are the same, and the components above a key."""
    parts = key.split(".")
    above = [".".join([*parts[:depth], "kind"]) for depth in range(len(parts))]
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for own, base in zip(settings, bases, strict=True):
        kinds = [own.get(one) for one in above if one != key]
        groups.setdefault(json.dumps([base, kinds]), []).append(own)
    yield from groups.values()


def _differ(key: str, group: Sequence[Mapping[str, Any]]) -> bool:
    return len({json.dumps(own.get(key), sort_keys=True) for own in group}) > 1


def _settings_of(view: RunView[Any, Any], label: str) -> dict[str, Any]:
    """The settings of a method and of its data but for the seed, by dotted keys."""
    data = {key: value for key, value in view.data.items() if key != SEED}
    return {**flatten(view.result.request["methods"][label]), **flatten(data, "data.")}


def flatten(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by dotted keys."""
    found: dict[str, Any] = {}
    for key, value in settings.items():
        if isinstance(value, Mapping) and value:
            found |= flatten(value, f"{prefix}{key}.")
        else:
            found[prefix + key] = value
    return found


def short_key(key: str, keys: Sequence[str]) -> str:
    """As much of a dotted key's end as tells it from the others; a slot goes by its own name."""
    plain = {one: one.removesuffix(".kind").split(".") for one in keys}
    parts = plain[key]
    for length in range(1, len(parts)):
        if sum(other[-length:] == parts[-length:] for other in plain.values()) == 1:
            return ".".join(parts[-length:])
    return ".".join(parts)


def _short_names(bases: Sequence[str], varied: Sequence[Mapping[str, str]]) -> list[str]:
    """What the arms are called where room is short, all different: the first that goes by a name by that name, the
    others by what tells them from it."""
    keys = list(dict.fromkeys(key for own in varied for key in own))
    several = len(set(bases)) > 1
    names: list[str] = []
    for base, own in zip(bases, varied, strict=True):
        first = varied[bases.index(base)]
        told = [f"{short_key(key, keys)}={own[key]}" for key in own if own[key] != first.get(key)]
        names.append(" ".join([base, *told] if several or not told else told))
    return [f"{name} ({number})" if names.count(name) > 1 else name for number, name in enumerate(names, 1)]
