"""Requests: methods, data and settings by name, and their configurations, resolved before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from salframe.evaluation.runs.changes import find_changes
from salframe.evaluation.runs.limits import NO_LIMITS, Limits
from salframe.evaluation.tables.text import list_methods
from salframe.framework.component import ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import (
    Overrides,
    configure,
    configure_default,
    otherwise,
    settings,
    short_name,
)
from salframe.framework.components.registry import registry
from salframe.framework.config import parse_override
from salframe.framework.errors import ConfigError, InputMissing, RequirementMissing, WeightsError
from salframe.framework.overrides import override_of
from salframe.framework.validation import MAX_INTEGER
from salframe.panoramas.opening import configure_dataset, provided


@dataclass(frozen=True)
class Variant:
    """A method with its settings.

    Args:
        method: A preset, a component or a YAML file.
        settings: Settings by dotted key. The key may start with the name of the method and a dot.
        name: Name of the method in settings; by default the name of the preset.
        label: Label of the method in tables; by default `name`.
    """

    method: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    label: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or short_name(self.method))
        object.__setattr__(self, "label", self.label or self.name)


@dataclass(frozen=True)
class Request:
    """A request to run methods on the data of a task, all by name.

    Args:
        methods: Presets, components or YAML files, or variants of them.
        data: A preset, a dataset, a YAML file or a folder with a manifest.json; None: the default dataset.
        data_dir: The `root` of the dataset.
        settings: Settings as "key.path=value".
        name: Name of the run folder; by default the name of the dataset.
        seed: Seed of confidence intervals and of random numbers of the task.
        engine: The engine that runs the methods; None: the default engine.
        runs: The folder of run folders.
        limits: Limits of time and memory of each piece of work. A piece that exceeds one has no answer.
    """

    methods: Sequence[str | Variant] = ()
    data: str | None = None
    data_dir: str | Path | None = None
    settings: tuple[str, ...] = ()
    name: str | None = None
    seed: int = 0
    engine: str | None = None
    runs: Path = Path("runs")
    limits: Limits = NO_LIMITS

    def __post_init__(self) -> None:
        if isinstance(self.methods, str):
            raise ConfigError(
                f"the argument methods is {self.methods!r}, expected a list of names: pass [{self.methods!r}]"
            )
        if not 0 <= self.seed <= MAX_INTEGER:
            raise ConfigError(f"received the seed {self.seed}, expected an integer from 0 to {MAX_INTEGER}")
        object.__setattr__(self, "methods", tuple(self.methods))
        object.__setattr__(self, "settings", tuple(self.settings))


@dataclass(frozen=True, eq=False)
class Resolved:
    """A request with every name replaced by a configuration.

    Attributes:
        methods: Configurations of the methods by label, in order.
        name: Name of the dataset.
        data: Configuration of the dataset.
        engine: Configuration of the engine.
        scopes: Settings whose key starts with a scope ("data", "engine", or a scope of the task), by scope.
        notes: Notes on methods that replace a requested one, and on the components that `auto` selected.
        replacements: Notes on methods that replace a requested one; they are also in `notes`.
        substitutions: For each label of a method that replaces a requested one, the replacement in words: "for loftr",
            or "loftr-compact for loftr" if the label does not name the method.
        requested_as: The requested label of each method, by its label in the run.
        changes: The settings of methods that differ from the preset or component of their name, "key=value" each, by
            label. Methods without such settings are missing.
    """

    methods: Mapping[str, ComponentConfig]
    name: str
    data: ComponentConfig
    engine: ComponentConfig
    scopes: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    requested_as: Mapping[str, str] = field(default_factory=dict)
    changes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    replacements: tuple[str, ...] = ()
    substitutions: Mapping[str, str] = field(default_factory=dict)


def resolve(request: Request, role: str = "localizer", scopes: Sequence[str] = ()) -> Resolved:
    """Return the configurations of a request.

    A method that cannot run on this machine is replaced by the preset that it names as its replacement. If that preset
    is requested too, the method is left out.

    Args:
        request: The request.
        role: Role of its methods.
        scopes: Prefixes, before the first dot, of further settings that the request may hold.

    Raises:
        SalframeError: A name or a setting is wrong.
    """
    if not request.methods:
        raise ConfigError("received no method, expected at least one")
    requested: dict[str, Variant] = {}
    for method in request.methods:
        variant = method if isinstance(method, Variant) else Variant(method)
        if requested.setdefault(variant.label, variant) != variant:
            both = f"{requested[variant.label].method} and {variant.method}"
            raise ConfigError(
                f"the methods {both} have the same label {variant.label!r}, expected different labels for the rows of "
                "the table: rename one of the two files, or change a label"
            )
    contents = {variant.name: settings(role, variant.method) for variant in requested.values()}
    pairs = map(parse_override, request.settings)
    overrides = Overrides(pairs, contents, role=role, scopes=("data", "engine", *scopes))
    data_name, data = configure_dataset(request.data, request.data_dir, overrides.scopes["data"])
    provides = cache(lambda: provided(data))
    methods: dict[str, ComponentConfig] = {}
    notes: list[str] = []
    taken: dict[str, list[str]] = {}
    requested_as: dict[str, str] = {}
    changes: dict[str, Sequence[str]] = {}
    substitutions: dict[str, str] = {}
    for label, variant in requested.items():
        choice = Choice(data_name, provides)
        settings_of_variant = {key: override_of(key, value, variant.name) for key, value in variant.settings.items()}
        over = [*settings_of_variant.values(), *overrides.methods[variant.name]]
        config = decide(role, variant.method, contents[variant.name], over, choice)
        other, instead, note = stand_in(role, variant.method, config, over, choice)
        notes += [note] if note and note not in notes else []
        named = variant.name == short_name(variant.method)  # named after the preset, not by the user
        runs = label.replace(variant.name, other, 1) if other is not None and named else label
        if runs == label or runs not in requested:
            methods[runs], requested_as[runs] = instead, label
            if other is not None:
                substitutions[runs] = f"{'' if named else f'{other} '}for {short_name(variant.method)}"
            runner, standard_choice = other or variant.method, Choice(data_name, provides)
            if over or runs != runner:
                changes[runs] = find_changes(role, runs, runner, settings_of_variant, instead, standard_choice)
            for line in choice.notes:
                taken.setdefault(line, []).append(runs)
    replacements = tuple(notes)
    notes += [f"{list_methods(takers, methods)}: {line}" for line, takers in taken.items()]
    engine = configure_default("engine", request.engine or default_of("engine"), overrides.scopes["engine"])
    return Resolved(
        methods,
        data_name,
        data,
        engine,
        overrides.scopes,
        tuple(notes),
        requested_as,
        {label: one for label, one in changes.items() if one},
        replacements,
        substitutions,
    )


def decide(
    role: str, name: str, content: Mapping[str, Any], overrides: Sequence[Mapping[str, Any]], choice: Choice
) -> ComponentConfig:
    """Return the configuration of a method. The components of its `auto` slots are chosen for the data.

    If no component can fill such a slot, the slot stays undecided, and the row of the method reports this. Raises
    InputMissing if the undecided slot has settings.
    """
    try:
        return configure(role, name, content, overrides, choice)
    except InputMissing as missing:
        try:
            return configure(role, name, content, overrides)
        except ConfigError:
            raise missing from None


def stand_in(
    role: str, method: str, config: ComponentConfig, overrides: Sequence[Mapping[str, Any]], choice: Choice
) -> tuple[str | None, ComponentConfig, str | None]:
    """Return the replacement of a method that cannot run on this machine.

    The replacement is the preset that the method's preset names under `otherwise`. It gets the requested settings of
    the method if it accepts them. If the replacement cannot run either, the method stays, and its row reports the
    reason.

    Returns:
        The name of the replacement or None, the configuration to run, and a note that explains the replacement or None.
    """
    name = short_name(method)
    missing = missing_requirement(config)
    other = otherwise(role, method) if missing else None
    if other is None:
        return None, config, None
    note = f"{other} is used instead of {name}: {missing}"
    content = settings(role, other)
    plain = decide(role, other, content, (), choice)
    if missing_requirement(plain):
        return None, config, None
    unchanged_note = f"{note}; {other} runs with its default settings, because it does not have the requested ones"
    try:
        instead = decide(role, other, content, overrides, choice)
    except (ConfigError, InputMissing) as error:
        return other, plain, f"{unchanged_note}: {error}"
    if missing_requirement(instead):
        return None, config, None
    try:
        registry().build(role, instead)
    except ConfigError as error:
        return other, plain, f"{unchanged_note}: {error}"
    except KeyboardInterrupt:
        raise
    except BaseException:  # the row of the method reports any other error
        return other, instead, note
    return other, instead, note


def missing_requirement(config: ComponentConfig) -> str | None:
    """Return why a configured component cannot run on this machine: a package or weights are missing. The reason has no
    hash.

    None if it can run. Also None if its check raises any other error, because the row of the method reports this error.
    """
    try:
        config.component.check(config)
    except (RequirementMissing, WeightsError) as error:
        return error.brief
    except Exception:
        return None
    return None
