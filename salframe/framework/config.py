"""Settings written by users: YAML files with `base:`, and `key.path=value` overrides."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from salframe.framework.errors import ConfigError, content_type, shorten
from salframe.framework.files.bounded import parse_yaml, read_bytes, why

MAX_BASES = 16
"""Maximum length of a chain of base files."""


def read_yaml(path: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Read a YAML mapping.

    The optional key `base` names a base file, relative to this file. The keys of this file override those of the base.

    Args:
        path: The file.
        above: Files that led to this file through their key `base`, for the recursion. Callers leave it empty.

    Raises:
        ConfigError: A file cannot be read, is not a YAML mapping, or the chain of bases is circular or too long.
    """
    try:
        if path.resolve() in above:
            raise ConfigError(
                f"the file {path} inherits from itself through the key `base`: remove `base` from one of the files"
            )
        if len(above) > MAX_BASES:
            raise ConfigError(
                f"the file {above[0]} inherits from more than {MAX_BASES} files through the key `base`, expected at "
                f"most {MAX_BASES}"
            )
        content = read_bytes(path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read the file {path}: {why(error)}") from None
    try:
        content = parse_yaml(content)
    except ValueError as error:
        raise ConfigError(f"the file {path} is not valid YAML: {error}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"the file {path} contains {content_type(content)}, expected a mapping (key: value)")
    base = content.pop("base", None)
    if base is None:
        return content
    if not isinstance(base, str):
        raise ConfigError(f"{path}: the key `base` is {base!r}, expected the name of a file")
    return merge(read_yaml(path.parent / base, (*above, path.resolve())), content)


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return `base` updated recursively with `over`. If `over` has another `kind` (name of a component) than `base`,
    the settings in `base` are discarded."""
    if "kind" in over and over["kind"] != base.get("kind", over["kind"]):
        return dict(over)
    result = dict(base)
    for key, value in over.items():
        old = result.get(key)
        if isinstance(old, str) and isinstance(value, Mapping):
            old = {"kind": old}
        if isinstance(old, Mapping) and isinstance(value, str):
            value = {"kind": value}
        result[key] = merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return result


def parse_override(text: str) -> tuple[tuple[str, ...], Any]:
    """Parse `key.path=value`. Return the path, split at its dots, and the value, parsed as YAML. Raises ConfigError."""
    path, equals, value = text.partition("=")
    if not equals or not all(path.split(".")):
        raise ConfigError(f"received --set {shorten(text)!r}, expected KEY=VALUE, such as detector.min_score=0.5")
    try:
        return tuple(path.split(".")), parse_yaml(value)
    except ValueError as error:
        raise ConfigError(f"received --set {shorten(text)!r}, whose value is not valid YAML: {error}") from None
