"""Configuration: frozen pydantic models, YAML with `base:`, and `key.path=value` overrides."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from salframe.framework.errors import ConfigError, SalframeError, describe_error, shorten
from salframe.framework.files.bounded import parse_yaml, read_bytes, why

if TYPE_CHECKING:
    from salframe.framework.component import Component
    from salframe.framework.components.auto import Choice

ROLE = "role"
"""Key of a slot's `json_schema_extra`: the role of what it holds."""
PROBLEMS = 3
"""So many faults of a file are told; the others are counted."""
MOST_BASES = 16
"""So many files may be each the base of the next."""


class Settings(BaseModel):
    """Base of every model of settings: frozen, no key that is not known, no number that is not finite. Units stand in
    the field names."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ComponentConfig(Settings):
    """Base of every component's `Config`. `kind` is the component's name and is filled in."""

    component: ClassVar[type[Component]]
    kind: str = ""

    @model_validator(mode="before")
    @classmethod
    def _fill_kind(cls, value: Any) -> Any:
        if isinstance(value, Mapping):
            value = {"kind": cls.component.name, **value}
            if value["kind"] != cls.component.name:
                raise ValueError(f"kind is {value['kind']!r}, expected {cls.component.name!r}")
        return value


def match_only(default: Any, **field: Any) -> Any:
    """A pydantic Field for a setting that matters to matching only: descriptions of panoramas do not depend on it."""
    return Field(default, json_schema_extra={"match_only": True}, **field)


def added(default: Any, *, match_only: bool = False, **field: Any) -> Any:
    """A pydantic Field for a setting that came later, whose default is how it was before: at its default it is no part
    of the identity, so that what was computed before is still known. `match_only` as in the function of that name."""
    return Field(default, json_schema_extra={"added": True, **({"match_only": True} if match_only else {})}, **field)


def components_in(config: Any) -> Iterator[tuple[str, ComponentConfig]]:
    """The slots of a configuration and the configurations of the components in them, not those nested deeper; of a
    field that holds several, `name[0]` and so on."""
    for name in type(config).model_fields if isinstance(config, BaseModel) else ():
        value = getattr(config, name)
        if isinstance(value, ComponentConfig):
            yield name, value
        elif holds_components(value):
            yield from ((f"{name}[{number}]", one) for number, one in enumerate(value))


def holds_components(value: Any) -> bool:
    """Whether the value of a setting is several components' configurations."""
    return isinstance(value, tuple) and bool(value) and all(isinstance(one, ComponentConfig) for one in value)


def validate(model: type[BaseModel], settings: Mapping[str, Any], where: str, choice: Choice | None = None) -> Any:
    """An instance of `model`, or a ConfigError that names the key, what was received and what was expected.

    `where` the settings stand: the dotted key that holds them, or a file's name and a colon; `choice`: what decides
    slots that say `auto`, which stay undecided without.
    """
    try:
        return model.model_validate(settings, context=choice)
    except ValidationError as error:
        raise ConfigError(describe_faults(error, where, model)) from None
    except OSError as error:  # of a path among the settings that no file system takes
        raise ConfigError(f"{where.rstrip(':')}: {describe_error(error)}") from None


def describe_faults(error: ValidationError, where: str, model: type[BaseModel] | None = None) -> str:
    """What pydantic found wrong with what stands `where`, in one line: the first PROBLEMS faults, others counted."""
    problems = list(dict.fromkeys(_problem(model, problem, where) for problem in error.errors()))
    more = f"; and {len(problems) - PROBLEMS} more such faults" if len(problems) > PROBLEMS else ""
    return "; ".join(problems[:PROBLEMS]) + more


def _problem(model: type[BaseModel] | None, problem: Any, where: str) -> str:
    prefix = f"{where} " if where.endswith(":") else f"{where}."
    key = prefix + ".".join(map(str, problem["loc"])) if problem["loc"] else where.rstrip(":")
    if problem["type"] == "extra_forbidden":
        known = ", ".join(name for name in model.model_fields if name != "kind") if model else ""
        return f"unknown key {key}" + (f" (known: {known})" if known and len(problem["loc"]) == 1 else "")
    if problem["type"] == "missing":
        return f"{key} is missing"
    if isinstance(cause := problem.get("ctx", {}).get("error"), Exception):
        return str(cause) if isinstance(cause, SalframeError) else f"{key}: {cause}"
    return (
        f"{key}: received {shorten(repr(problem['input']))}, expected {problem['msg'].removeprefix('Input should be ')}"
    )


def read_yaml(path: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """A YAML mapping; an optional `base:` names another file, relative to this one, whose keys it overrides.

    `above`: the files that have this one as their base. Raises ConfigError.
    """
    try:
        if path.resolve() in above:
            raise ConfigError(f"{path} is its own base")
        if len(above) > MOST_BASES:
            raise ConfigError(f"{above[0]} has more than {MOST_BASES} bases above one another")
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
