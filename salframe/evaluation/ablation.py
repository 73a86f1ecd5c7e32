"""Ablations: every combination of some settings as a method of its own, in one comparison."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from salframe.evaluation.compare import Comparison, Progress, run_methods
from salframe.framework.config import parse_override, read_yaml, validate
from salframe.framework.errors import ConfigError
from salframe.framework.presets import Overrides, configure, settings


class Ablation(BaseModel):
    """The content of an ablation file. Keys of `set` and `vary` are dotted, as `--set` takes them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: str | None = Field(None, description="the method to vary")
    methods: tuple[str, ...] = Field((), description="or several")
    data: str = Field("house-12", description="dataset to run on")
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
    """Read an ablation file, or a shipped one by its name. Raises ConfigError."""
    shipped = CONFIGS / "ablations" / f"{file}.yaml"
    return validate(Ablation, read_yaml(shipped if shipped.exists() and not file.exists() else file), f"{file}:")


def ablate(
    file: Path,
    *,
    data: str | None = None,
    data_dir: Path | None = None,
    overrides: Sequence[str] = (),
    name: str | None = None,
    runs: Path = Path("runs"),
    engine: str = "processes",
    seed: int = 0,
    progress: Progress | None = None,
) -> Comparison:
    """Compare every combination of the values under `vary:` in a file, each labelled `method[key=value,...]`.

    `data` overrules the file's, `overrides` ("key.path=value") its `set:`; the rest as in `compare`. Raises ConfigError
    on wrong keys.
    """
    plan = read_ablation(file)
    contents = {method: settings("localizer", method) for method in plan.varied}
    given = Overrides([*_pairs(plan.set), *map(parse_override, overrides)], contents)
    configs = {}
    for method in plan.varied:
        for values in itertools.product(*plan.vary.values()):
            choice = dict(zip(plan.vary, values, strict=True))
            varied = Overrides(_pairs(choice), {method: contents[method]})
            if varied.data or varied.engine:
                raise ConfigError(
                    f"{file}: vary holds {', '.join(choice)}, expected settings of methods: a run has one dataset and one engine"
                )
            label = f"{method}[{','.join(f'{key}={_spell(value)}' for key, value in choice.items())}]"
            configs[label] = configure(
                "localizer", method, contents[method], [*given.methods[method], *varied.methods[method]]
            )
    return run_methods(configs, data or plan.data, data_dir, given, name or file.stem, runs, engine, seed, progress)


def _pairs(dotted: dict[str, Any]) -> list[tuple[tuple[str, ...], Any]]:
    return [(tuple(key.split(".")), value) for key, value in dotted.items()]


def _spell(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
