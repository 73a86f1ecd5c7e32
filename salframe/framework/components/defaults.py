"""Default names of methods, datasets and components, read from configs/defaults.yaml."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from salframe.framework.errors import ConfigError
from salframe.framework.files.bounded import parse_yaml

DEFAULTS = "defaults.yaml"
"""Name of the file of default names in the preset folder."""
AUTO = "auto"
"""Value of a slot (a setting that holds a component) whose component is chosen automatically for the data, see
`Choice`."""


@cache
def defaults() -> dict[str, Any]:
    """Return the content of configs/defaults.yaml."""
    content: dict[str, Any] = parse_yaml((preset_folder() / DEFAULTS).read_bytes())
    return content


def preset_folder() -> Path:
    """Return the preset folder of salframe: in the installed package, or next to salframe/ in a clone."""
    package = Path(__file__).parents[2]
    installed = package / "configs"
    return installed if (installed / DEFAULTS).is_file() else package.parent / "configs"


def default_of(key: str) -> Any:
    """Return the value of `key` in configs/defaults.yaml, such as the default methods for the key `methods`. Raises
    ConfigError if there is none."""
    if key not in defaults():
        raise ConfigError(f"received the key {key!r}, expected a key of configs/defaults.yaml: {', '.join(defaults())}")
    return defaults()[key]


def auto_order(role: str) -> dict[str, str]:
    """Return the names of the components that `auto` tries for a role, in order, each with a remark for the user.

    The result is empty for a role without `auto`.
    """
    order = [{entry: ""} if isinstance(entry, str) else entry for entry in default_of(AUTO).get(role, ())]
    return {name: remark for entry in order for name, remark in entry.items()}
