"""Arms of a report. An arm is a method with its settings. The arms of several runs are compared side by side. Runs that
differ only in the seed of the data are pooled."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from salframe.evaluation.report.view import RunView
from salframe.evaluation.runs.changes import base_of, hidden_in, with_changes
from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.run_folder import SUBSTITUTIONS
from salframe.framework.components.settings import flatten, spell_value

SEED = "seed"
"""Dotted key of the data setting in which the runs of one arm (a method with its settings) may differ."""


class Entry(NamedTuple):
    """A method of a run: the index of the run in the report, and the index of the method in the run."""

    run: int
    method: int


@dataclass(frozen=True, eq=False)
class Arm:
    """A method on a data set, pooled over the seeds of the data.

    Attributes:
        name: Short name, unique in the report.
        label: Label in the runs.
        base: The label without its varied settings, followed by other settings that differ from the method's preset.
        varied: Values of the settings in which the arms differ, by dotted key.
        row: Row of the method over all seeds.
        entries: The pooled runs, each with the index of the method in the run.
    """

    name: str
    label: str
    base: str
    varied: Mapping[str, str]
    row: MethodRow
    entries: tuple[Entry, ...]


def find_entries(views: Sequence[RunView[Any, Any]]) -> list[tuple[Entry, ...]]:
    """Return the entries of each arm (a method with its settings), in the order in which the arms first occur in the
    runs.

    An entry is the index of a run and the index of the method in this run. The entries of an arm are runs of one method
    with equal settings, on data that differ only in the seed. If several of these runs have the same seed, only the
    first one counts.
    """
    entries: dict[str, dict[str, Entry]] = {}
    for number, view in enumerate(views):
        request = view.result.request
        data = {key: value for key, value in view.data.items() if key != SEED}
        for position, (label, settings) in enumerate(request["methods"].items()):
            key = json.dumps([request["task"], data, label, settings], sort_keys=True)
            seed = json.dumps(view.data.get(SEED))
            entries.setdefault(key, {}).setdefault(seed, Entry(number, position))
    return [tuple(alike.values()) for alike in entries.values()]


def name_arms(
    views: Sequence[RunView[Any, Any]], entries: Sequence[tuple[Entry, ...]], rows: Sequence[MethodRow]
) -> list[Arm]:
    """Return the arms of a report. An arm is a method with its settings, pooled over the runs that differ only in the
    seed of the data. Its short name is unique in the report.

    Args:
        views: The runs of the report.
        entries: The runs of each arm, as `find_entries` returns them.
        rows: The row of each arm in the results table.
    """
    labels = [views[arm_entries[0].run].records[arm_entries[0].method].label for arm_entries in entries]
    bases = [base_of(label) for label in labels]
    settings = [
        _settings_of(views[arm_entries[0].run], label) for arm_entries, label in zip(entries, labels, strict=True)
    ]
    keys = find_varied(settings, bases)
    named = [{key: spell_value(arm_settings[key]) for key in keys if key in arm_settings} for arm_settings in settings]
    requests = [views[arm_entries[0].run].result.request for arm_entries in entries]
    titles = [
        with_changes(
            base, hidden_in(request.get("changes", {}).get(label, ()), shown), request.get(SUBSTITUTIONS, {}).get(label)
        )
        for base, request, label, shown in zip(bases, requests, labels, named, strict=True)
    ]
    names = _short_names(titles, named)
    return [Arm(*parts) for parts in zip(names, labels, titles, named, rows, entries, strict=True)]


def find_varied(settings: Sequence[Mapping[str, Any]], bases: Sequence[str]) -> list[str]:
    """Return the dotted keys of the settings in which the arms of one method differ. An arm is a method with its
    settings.

    A slot is a setting that selects a component. If the arms have different components in a slot, a key below the slot
    is returned only if arms with the same component differ in it.

    Args:
        settings: The settings of each arm by dotted key.
        bases: The name of the method of each arm, without settings.
    """
    keys = list(dict.fromkeys(key for arm_settings in settings for key in arm_settings))
    return [key for key in keys if any(_differ(key, group) for group in _same(settings, bases, key))]


def _same(settings: Sequence[Mapping[str, Any]], bases: Sequence[str], key: str) -> Iterator[list[Mapping[str, Any]]]:
    """Yield groups of arms with the same base and the same components in the slots above a dotted key."""
    parts = key.split(".")
    above = [".".join([*parts[:depth], "kind"]) for depth in range(len(parts))]
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for arm_settings, base in zip(settings, bases, strict=True):
        kinds = [arm_settings.get(kind_key) for kind_key in above if kind_key != key]
        groups.setdefault(json.dumps([base, kinds]), []).append(arm_settings)
    yield from groups.values()


def _differ(key: str, group: Sequence[Mapping[str, Any]]) -> bool:
    return len({json.dumps(arm_settings.get(key), sort_keys=True) for arm_settings in group}) > 1


def _settings_of(view: RunView[Any, Any], label: str) -> dict[str, Any]:
    """Return the settings of a method and of its data without the seed, by dotted key."""
    data = {key: value for key, value in view.data.items() if key != SEED}
    return {**flatten(view.result.request["methods"][label]), **flatten(data, "data.")}


def short_key(key: str, keys: Sequence[str]) -> str:
    """Return the shortest end of a dotted key that is unique among the keys. An end ".kind" is removed first, so that a
    component is named by its setting."""
    plain = {one: one.removesuffix(".kind").split(".") for one in keys}
    parts = plain[key]
    for length in range(1, len(parts)):
        if sum(other[-length:] == parts[-length:] for other in plain.values()) == 1:
            return ".".join(parts[-length:])
    return ".".join(parts)


def _short_names(bases: Sequence[str], varied: Sequence[Mapping[str, str]]) -> list[str]:
    """Return short unique names of arms (methods with their settings). `bases` are the names of the methods without
    settings. The first arm of a method is named after it. The names of other arms show the settings in which they
    differ from it."""
    keys = list(dict.fromkeys(key for values in varied for key in values))
    several = len(set(bases)) > 1
    names: list[str] = []
    for base, values in zip(bases, varied, strict=True):
        first = varied[bases.index(base)]
        differences = [f"{short_key(key, keys)}={values[key]}" for key in values if values[key] != first.get(key)]
        names.append(" ".join([base, *differences] if several or not differences else differences))
    return [f"{name} ({number})" if names.count(name) > 1 else name for number, name in enumerate(names, 1)]
