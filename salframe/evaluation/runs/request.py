"""What is asked: methods, data, settings. From names to configurations, before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

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
from salframe.framework.config import nest, parse_override
from salframe.framework.errors import ConfigError, InputMissing, RequirementMissing, WeightsMissing
from salframe.panoramas.opening import configure_dataset, provided


@dataclass(frozen=True)
class Variant:
    """A method with settings of its own, by dotted key. name: what settings call it, the preset's unless given; label:
    what tables call it, its name unless given."""

    method: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    label: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or short_name(self.method))
        object.__setattr__(self, "label", self.label or self.name)


@dataclass(frozen=True)
class Request:
    """What a user asks of a task, by name.

    methods: presets, components or YAML files, or variants of them; data: a preset, a data set, a YAML file or a folder
    with a manifest.json, the default one where it is None; data_dir sets its `root`; settings: "key.path=value" each;
    name: of the run folder, the data set's unless given; seed: of confidence intervals, and of whatever the task draws;
    engine: what runs the methods, the default one where it is None; runs: the folder of run folders; limits: of time
    and memory of each piece of work, which cost the piece.
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
            raise ConfigError(f"received the methods {self.methods!r}, expected a sequence of names")
        object.__setattr__(self, "methods", tuple(self.methods))
        object.__setattr__(self, "settings", tuple(self.settings))


@dataclass(frozen=True, eq=False)
class Resolved:
    """A request with every name replaced by a configuration.

    methods: by label, in order; name: the data set's; scopes: what was set of anything else, by its scope; notes: which
    method runs instead of one that was asked for, and why, and what `auto` became, a line each; asked_as: the label
    that was asked for, of each method that has another.
    """

    methods: Mapping[str, ComponentConfig]
    name: str
    data: ComponentConfig
    engine: ComponentConfig
    scopes: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    asked_as: Mapping[str, str] = field(default_factory=dict)


def resolve(request: Request, role: str = "localizer", scopes: Sequence[str] = ()) -> Resolved:
    """The configurations of a request whose methods are components of `role`; `scopes`: first words of more settings.

    Where a method cannot run here, the preset that its own names takes its place, unless that one was asked for too.
    Raises SalframeError on names and settings that are wrong.
    """
    if not request.methods:
        raise ConfigError("received no method, expected at least one")
    asked: dict[str, Variant] = {}
    for method in request.methods:
        variant = method if isinstance(method, Variant) else Variant(method)
        if asked.setdefault(variant.label, variant) != variant:
            both = f"{asked[variant.label].method} and {variant.method}"
            raise ConfigError(f"received the methods {both}, which tables would both call {variant.label}")
    contents = {variant.name: settings(role, variant.method) for variant in asked.values()}
    pairs = map(parse_override, request.settings)
    given = Overrides(pairs, contents, role=role, scopes=("data", "engine", *scopes))
    data_name, data = configure_dataset(request.data, request.data_dir, given.scopes["data"])
    provides = cache(lambda: provided(data))
    methods: dict[str, ComponentConfig] = {}
    notes: list[str] = []
    taken: dict[str, list[str]] = {}
    asked_as: dict[str, str] = {}
    for label, variant in asked.items():
        choice = Choice(data_name, provides)
        own = [nest(key.split("."), value) for key, value in variant.settings.items()]
        over = [*own, *given.methods[variant.name]]
        config = decide(role, variant.name, contents[variant.name], over, choice)
        other, instead, note = stand_in(role, variant.method, config, over, choice)
        notes += [note] if note and note not in notes else []
        named = variant.name == short_name(variant.method)  # after what runs, not by the user
        runs = label.replace(variant.name, other, 1) if other is not None and named else label
        if runs == label or runs not in asked:
            methods[runs], asked_as[runs] = instead, label
            for line in choice.notes:
                taken.setdefault(line, []).append(runs)
    notes += [f"{list_methods(takers, methods)}: {line}" for line, takers in taken.items()]
    engine = configure_default("engine", request.engine or default_of("engine"), given.scopes["engine"])
    return Resolved(methods, data_name, data, engine, given.scopes, tuple(notes), asked_as)


def decide(
    role: str, name: str, content: Mapping[str, Any], given: Sequence[Mapping[str, Any]], choice: Choice
) -> ComponentConfig:
    """The configuration of a method with its slots decided by the data; with an undecided slot where nothing can run in
    it, for then the method's own row will tell. Raises InputMissing where something is set of that slot."""
    try:
        return configure(role, name, content, given, choice)
    except InputMissing as nothing:
        try:
            return configure(role, name, content, given)
        except ConfigError:
            raise nothing from None


def stand_in(
    role: str, method: str, config: ComponentConfig, given: Sequence[Mapping[str, Any]], choice: Choice
) -> tuple[str | None, ComponentConfig, str | None]:
    """What runs for a method: the name of another one, its configuration, and why; None where the method itself runs.

    That is the preset which the method's own names under `otherwise`, where the method cannot run here and that one
    can. What was set of the method is set of it too, unless it cannot take that. Where neither can run, set so, the
    method stays, and with it the reason.
    """
    name = short_name(method)
    missing = why_not(config)
    other = otherwise(role, method) if missing else None
    if other is None:
        return None, config, None
    note = f"{other}, not {name}: {missing}"
    content = settings(role, other)
    plain = decide(role, other, content, (), choice)
    if why_not(plain):
        return None, config, None
    as_it_is = f"{note}; it runs as it is, for it cannot take what was set"
    try:
        instead = decide(role, other, content, given, choice)
    except (ConfigError, InputMissing) as error:
        return other, plain, f"{as_it_is}: {error}"
    if why_not(instead):
        return None, config, None
    try:
        registry().build(role, instead)
    except ConfigError as error:
        return other, plain, f"{as_it_is}: {error}"
    except KeyboardInterrupt:
        raise
    except BaseException:  # whatever else is wrong with it, its own row will tell
        return other, instead, note
    return other, instead, note


def why_not(config: ComponentConfig) -> str | None:
    """Why a configured component cannot run here, None where it can, or where its check breaks: its row will tell."""
    try:
        config.component.check(config)
    except (RequirementMissing, WeightsMissing) as error:
        return str(error)
    except Exception:
        return None
    return None
