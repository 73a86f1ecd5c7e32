"""Ablations: every combination of some settings as a method of its own, in one comparison."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from salframe.evaluation.localization import LocalizationRow, LocalizationTask
from salframe.evaluation.request import Request, decide, resolve
from salframe.evaluation.result import Result
from salframe.evaluation.runner import run_task
from salframe.framework.auto import Choice
from salframe.framework.config import ComponentConfig, Settings, read_yaml, validate
from salframe.framework.errors import ConfigError
from salframe.framework.presets import Overrides
from salframe.framework.registry import registry
from salframe.panoramas.opening import Progress, provided


class Ablation(Settings):
    """The content of an ablation file. Keys of `set` and `vary` are dotted, as `--set` takes them."""

    method: str | None = Field(None, description="the method to vary")
    methods: tuple[str, ...] = Field((), description="or several")
    data: str | None = Field(None, description="dataset to run on; null: the default one")
    set: dict[str, Any] = Field({}, description="settings that all have")
    vary: dict[str, tuple[Any, ...]] = Field(description="values of each key; every combination is run")

    @model_validator(mode="after")
    def _check(self) -> Ablation:
        if (self.method is None) == (not self.methods):
            raise ValueError("expected either method or methods")
        empty = [key for key, values in self.vary.items() if not values]
        if empty or not self.vary:
            raise ValueError(f"vary{'.' if empty else ''}{', '.join(empty)} holds no value, expected at least one")
        return self

    @property
    def varied(self) -> tuple[str, ...]:
        """The methods to vary."""
        return self.methods or (str(self.method),)


def read_ablation(file: Path) -> Ablation:
    """Read an ablation file, or one that a plugin ships by its name. Raises ConfigError."""
    shipped = None if file.exists() else registry().find_preset("ablations", str(file))
    return validate(Ablation, read_yaml(shipped or file), f"{file}:")


def ablate(file: str | Path, request: Request, *, progress: Progress | None = None) -> Result[LocalizationRow]:
    """Compare every combination of the values under `vary:` in a file, each labelled `method[key=value,...]`.

    `file`: a YAML file, or the name of a shipped ablation. The request names no method, for the file does; its data and
    settings overrule the file's. Raises ConfigError on wrong keys.
    """
    file = Path(file)
    plan = read_ablation(file)
    fixed = [f"{key}={json.dumps(value)}" for key, value in plan.set.items()]
    asked = replace(
        request,
        methods=plan.varied,
        data=request.data or plan.data,
        settings=(*fixed, *request.settings),
        name=request.name or file.stem,
    )
    resolved = resolve(asked)
    variants: dict[str, ComponentConfig] = {}
    notes = list(resolved.notes)
    for label, config in resolved.methods.items():
        for values in itertools.product(*plan.vary.values()):
            choice = dict(zip(plan.vary, values, strict=True))
            name = _label(label, choice)
            if name in variants:
                raise ConfigError(f"{file}: vary gives {name} twice, expected different values")
            auto = Choice(resolved.name, partial(provided, resolved.data))
            variants[name] = _vary(file, label, config, choice, auto)
            notes += [f"{name}: {note}" for note in auto.notes]
    resolved = replace(resolved, methods=variants, notes=tuple(notes))
    return run_task(LocalizationTask(), asked, resolved, progress=progress)


def _vary(file: Path, label: str, config: ComponentConfig, choice: Mapping[str, Any], auto: Choice) -> ComponentConfig:
    """The configuration with these values of dotted keys."""
    content = config.model_dump(mode="json")
    pairs = [(tuple(key.split(".")), value) for key, value in choice.items()]
    given = Overrides(pairs, {label: content}, role="localizer", scopes=("data", "engine"))
    if any(given.scopes.values()):
        expected = "settings of methods: a run has one dataset and one engine"
        raise ConfigError(f"{file}: vary holds {', '.join(choice)}, expected {expected}")
    return decide("localizer", label, content, given.methods[label], auto)


def _label(method: str, choice: Mapping[str, Any]) -> str:
    values = (f"{key}={value if isinstance(value, str) else json.dumps(value)}" for key, value in choice.items())
    return f"{method}[{','.join(values)}]"
