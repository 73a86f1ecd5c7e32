"""Names that stand where a caller gives none: one YAML file, configs/defaults.yaml."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

import yaml

from salframe.framework.errors import ConfigError


@cache
def defaults() -> dict[str, Any]:
    """All of them, by key."""
    return yaml.safe_load(files("salframe.configs").joinpath("defaults.yaml").read_text())


def default_of(key: str) -> Any:
    """The name, or the names, that stand for `key` where none is given. Raises ConfigError where nothing does."""
    if key not in defaults():
        raise ConfigError(f"no name stands for {key!r} where none is given, only for {', '.join(defaults())}")
    return defaults()[key]
