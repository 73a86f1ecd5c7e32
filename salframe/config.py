"""Configuration: frozen pydantic models, slots filled by plugins, YAML with `base:`, and `key.path=value` overrides."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, SerializeAsAny, ValidationError, model_validator

from salframe.errors import ConfigError, SalframeError

if TYPE_CHECKING:
    from salframe.roles import Component


class ComponentConfig(BaseModel):
    """Base of every component's `Config`. Units stand in the field names; `kind` is the component's name and is filled in."""

    model_config = ConfigDict(frozen=True, extra="forbid")
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


def slot(role: str, default: str) -> Any:
    """The type of a config field that holds a component of `role`: `detector: slot("detector", "annotations")`.

    It accepts a name, a mapping (its `kind` may be left out: then it is `default`), or a component's Config, asks the registry and
    validates with that component's own Config.
    """

    def resolve(value: Any) -> ComponentConfig:
        from salframe.registry import registry

        if isinstance(value, ComponentConfig):
            return value
        if isinstance(value, str):
            value = {"kind": value}
        if not isinstance(value, Mapping):
            raise ValueError(f"received {value!r}, expected the name of a {role} or a mapping with its settings")
        return validate(registry().get(role, value.get("kind", default)).Config, value, role)

    return Annotated[SerializeAsAny[ComponentConfig], BeforeValidator(resolve), Field(default={"kind": default}, validate_default=True)]


def validate(model: type[BaseModel], settings: Mapping[str, Any], where: str) -> Any:
    """An instance of `model`, or a ConfigError that names the key, what was received and what was expected.

    `where` the settings stand: the dotted key that holds them, or a file's name and a colon.
    """
    try:
        return model.model_validate(settings)
    except ValidationError as error:
        prefix = f"{where} " if where.endswith(":") else f"{where}."
        problems = []
        for problem in error.errors():
            key = prefix + ".".join(map(str, problem["loc"])) if problem["loc"] else where.rstrip(":")
            if problem["type"] == "extra_forbidden":
                known = ", ".join(name for name in model.model_fields if name != "kind")
                problems.append(f"unknown key {key}" + (f" (known: {known})" if len(problem["loc"]) == 1 else ""))
            elif problem["type"] == "missing":
                problems.append(f"{key} is missing")
            elif isinstance(cause := problem.get("ctx", {}).get("error"), Exception):
                problems.append(str(cause) if isinstance(cause, SalframeError) else f"{key}: {cause}")
            else:
                problems.append(f"{key}: received {problem['input']!r}, expected {problem['msg'].removeprefix('Input should be ')}")
        raise ConfigError("; ".join(problems)) from None


def read_yaml(path: Path) -> dict[str, Any]:
    """A YAML mapping; an optional `base:` names another file, relative to this one, whose keys it overrides."""
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path} holds {type(content).__name__}, expected a mapping")
    base = content.pop("base", None)
    return content if base is None else merge(read_yaml(path.parent / base), content)


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over` laid on top, mapping by mapping. Another `kind` drops the settings of the old one."""
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
        raise ConfigError(f"received --set {text!r}, expected key.path=value")
    try:
        return tuple(path.split(".")), yaml.safe_load(value)
    except yaml.YAMLError:
        raise ConfigError(f"--set {text!r}: the value is not YAML") from None


def nest(path: Iterable[str], value: Any) -> dict[str, Any]:
    """The mapping that holds `value` under a dotted path."""
    for key in reversed(tuple(path)):
        value = {key: value}
    return value


def identity(config: ComponentConfig) -> dict[str, Any]:
    """What caches know a configured component by: role, name, version, settings, those of its slots included, and hashes of the files it reads."""
    from salframe.weights import file_sha256

    fields = {name: getattr(config, name) for name in type(config).model_fields if name != "kind"}
    settings = {
        name: identity(value) if isinstance(value, ComponentConfig) else config.model_dump(mode="json", include={name})[name]
        for name, value in fields.items()
    }
    component = config.component
    files = [file_sha256(path) for path in component.files(config)]
    known_by = {"role": component.role, "name": component.name, "version": component.version, "settings": settings}
    return {**known_by, "files": files} if files else known_by


def digest(value: Any) -> str:
    """Sha256 (hex) of a JSON-serialisable value, the same for the same content."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
