"""Nested settings that a user wrote by dotted key."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def nest(path: Iterable[str], value: Any) -> dict[str, Any]:
    """Return nested mappings that hold `value` under a path of keys."""
    for key in reversed(tuple(path)):
        value = {key: value}
    return value


class Override(dict[str, Any]):
    """Nested settings that a user wrote by dotted key, such as `data.seed=1`.

    Attributes:
        scope: The first part of the key that the user wrote, if it names what the setting belongs to, such as "data" or
            a method, otherwise "". It is not a key of the nested settings.
    """

    def __init__(self, path: Iterable[str], value: Any, scope: str = "") -> None:
        """Nest a value under a path of keys, without the scope."""
        super().__init__(nest(path, value))
        self.scope = scope

    def spell(self, keys: Sequence[str]) -> str | None:
        """Return the dotted key that the user wrote for nested keys. None if the settings do not contain them."""
        below: Any = self
        for key in keys:
            if not isinstance(below, Mapping):
                break
            if key not in below:
                return None
            below = below[key]
        return ".".join([self.scope, *keys] if self.scope else keys) if keys else None


def override_of(key: str, value: Any, scope: str) -> Override:
    """Return the setting of a dotted key, which may start with the scope and a dot."""
    path = key.removeprefix(f"{scope}.")
    return Override(path.split("."), value, "" if path == key else scope)
