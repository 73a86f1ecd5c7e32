"""Components, their settings, and roles: what every registered class has in common."""

from __future__ import annotations

import importlib.util
from abc import ABC
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import BaseModel, Field, model_validator

from salframe.framework.errors import RequirementMissing
from salframe.framework.validation import Settings

if TYPE_CHECKING:
    from salframe.framework.files.weights import NetworkWeights

ROLE = "role"
"""Key of a slot's `json_schema_extra`: the role of what it holds."""


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


class Component(ABC):
    """Anything that can be registered. A subclass of a role sets `name` and `version`, and may set the rest.

    `name` kebab-case, unique in its role; `version` changes whenever the output does (it is part of every identity);
    `requires` are importable top-level packages, `extra` the pip requirement that brings them; `weights` are all
    trained weights that some setting of it may use; the first line of the docstring is the summary; `Config` holds the
    settings.
    """

    role: ClassVar[str]
    name: ClassVar[str]
    version: ClassVar[str]
    requires: ClassVar[tuple[str, ...]] = ()
    extra: ClassVar[str] = ""
    weights: ClassVar[tuple[NetworkWeights, ...]] = ()
    Config: ClassVar[type[ComponentConfig]] = ComponentConfig

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "Config" not in cls.__dict__:
            body = {"__module__": cls.__module__, "__qualname__": f"{cls.__qualname__}.Config"}
            cls.Config = type("Config", (cls.Config,), body)
        cls.Config.component = cls

    def __init__(self, config: ComponentConfig | None = None) -> None:
        self.config: Any = self.Config() if config is None else config
        self.check(self.config)

    @classmethod
    def requires_in_use(cls, config: Any) -> tuple[str, ...]:
        """The packages that a component with this config imports."""
        return cls.requires

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """The weights that a component with this config loads: their hashes are part of its identity."""
        return cls.weights

    @classmethod
    def check(cls, config: Any) -> None:
        """Raises RequirementMissing or WeightsMissing where a component with this config, or one in its slots, could
        not run here; cheap, imports nothing heavy."""
        absent = [package for package in cls.requires_in_use(config) if importlib.util.find_spec(package) is None]
        if absent:
            hint = f": pip install '{cls.extra}'" if cls.extra else ""
            raise RequirementMissing(f"{cls.name} needs {', '.join(absent)}, not installed{hint}")
        for weights in cls.weights_in_use(config):
            weights.find()
        for _, inner in components_in(config):
            inner.component.check(inner)


class Role(Component):
    """What a plugin can fill. A class that derives from Role directly is a role; what derives from a role is a
    component.

    `role` is its name in configurations; `presets` the folder of a preset collection that holds presets for it, if any;
    `word` what messages call a component of it, the role's name unless set; `conformance` names what checks
    the role's promises: "module:function", called with a function that makes the component, or a class of
    salframe.testing.Rules, each of whose methods is a rule.
    """

    presets: ClassVar[str | None] = None
    word: ClassVar[str] = ""
    conformance: ClassVar[str] = ""


def is_role(item: object) -> bool:
    """Whether this is a role, not a component that fills one."""
    return isinstance(item, type) and Role in item.__bases__
