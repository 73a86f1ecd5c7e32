"""Names that stand where a caller gives none: one YAML file, configs/defaults.yaml."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from salframe.framework.errors import ConfigError
from salframe.framework.files.bounded import parse_yaml

DEFAULTS = "defaults.yaml"
"""The file of default names among the presets."""
AUTO = "auto"
"""What a slot says that leaves its component to the data."""


@cache
def defaults() -> dict[str, Any]:
    """All of them, by key."""
    content: dict[str, Any] = parse_yaml((preset_folder() / DEFAULTS).read_bytes())
    return content


def preset_folder() -> Path:
    """Return the folder of salframe's own presets: in the installed package, or beside salframe/ in a clone."""
    package = Path(__file__).parents[2]
    installed = package / "configs"
    return installed if (installed / DEFAULTS).is_file() else package.parent / "configs"


def default_of(key: str) -> Any:
    """The name, or the names, that stand for `key` where none is given. Raises ConfigError where nothing does."""
    if key not in defaults():
        raise ConfigError(f"no name stands for {key!r} where none is given, only for {', '.join(defaults())}")
    return defaults()[key]


def auto_order(role: str) -> dict[str, str]:
    """The names of components that `auto` may become in a slot of this role, in the order in which they are tried, each
    with what to say of it; none for a role that has no `auto`."""
    order = [{entry: ""} if isinstance(entry, str) else entry for entry in default_of(AUTO).get(role, ())]
    return {name: remark for entry in order for name, remark in entry.items()}
