"""Settings as written by users: YAML with `base:`, and `key.path=value` overrides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from salframe.framework.errors import ConfigError, shorten
from salframe.framework.files.bounded import parse_yaml, read_bytes, why

MAX_BASES = 16
"""Maximum number of files that are each the base of the next."""


def read_yaml(path: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """A YAML mapping; an optional `base:` names another file, relative to this one, whose keys it overrides.

    `above`: the files that have this one as their base. Raises ConfigError.
    """
    try:
        if path.resolve() in above:
            raise ConfigError(f"{path} is its own base")
        if len(above) > MAX_BASES:
            raise ConfigError(f"{above[0]} has more than {MAX_BASES} bases above one another")
        content = read_bytes(path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read {path}: {why(error)}") from None
    try:
        content = parse_yaml(content)
    except ValueError as error:
        raise ConfigError(f"{path} is not YAML: {error}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path} holds {type(content).__name__}, expected a mapping")
    base = content.pop("base", None)
    if base is None:
        return content
    if not isinstance(base, str):
        raise ConfigError(f"{path}: base is {base!r}, expected the name of a file")
    return merge(read_yaml(path.parent / base, (*above, path.resolve())), content)


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over` laid on top, mapping by mapping. Another `kind` drops the old one's settings."""
    if "kind" in over and over["kind"] != base.get("kind", over["kind"]):
        return dict(over)
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, str) and isinstance(value, Mapping):
            old = {"kind": old}
        if isinstance(old, Mapping) and isinstance(value, str):
            value = {"kind": value}
        merged[key] = merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return merged


def parse_override(text: str) -> tuple[tuple[str, ...], Any]:
    """`key.path=value` as the path and the value read as YAML."""
    path, equals, value = text.partition("=")
    if not equals or not all(path.split(".")):
        raise ConfigError(f"received --set {shorten(text)!r}, expected key.path=value")
    try:
        return tuple(path.split(".")), parse_yaml(value)
    except ValueError as error:
        raise ConfigError(f"--set {shorten(text)!r}: the value is not YAML: {error}") from None


def nest(path: Iterable[str], value: Any) -> dict[str, Any]:
    """The mapping that holds `value` under a dotted path."""
    for key in reversed(tuple(path)):
        value = {key: value}
    return value
