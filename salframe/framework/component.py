"""Components, their settings, and roles: the base classes of everything that a plugin registers."""

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
"""Key in the `json_schema_extra` of a slot (a field that holds a component). Its value is the role of the component."""


class ComponentConfig(Settings):
    """Base class of the `Config` of every component.

    Attributes:
        kind: The name of the component. It is set automatically.
    """

    component: ClassVar[type[Component]]
    kind: str = ""

    @model_validator(mode="before")
    @classmethod
    def _fill_kind(cls, value: Any) -> Any:
        if isinstance(value, Mapping):
            value = {"kind": cls.component.name, **value}
            if value["kind"] != cls.component.name:
                raise ValueError(
                    f"the key `kind` (name of the component) is {value['kind']!r}, expected {cls.component.name!r}"
                )
        return value

    def keys_of(self, setting: str) -> Mapping[str, str]:
        """Return the allowed keys of a setting that is a mapping, with a help text for each key.

        Subclasses override this method if other settings determine the keys of a mapping. By default, the result is
        empty.
        """
        return {}


def match_only(default: Any, **field: Any) -> Any:
    """Return a pydantic Field for a setting that affects only matching, not descriptions (features) of panoramas."""
    return Field(default, json_schema_extra={"match_only": True}, **field)


def added(default: Any, *, match_only: bool = False, **field: Any) -> Any:
    """Return a pydantic Field for a setting that was added to a component after its first release.

    The default must reproduce the behaviour before the setting existed. Results that were cached before then remain
    valid, because such a setting is not part of the cache key while it has its default. For `match_only`, see the
    function of that name.
    """
    return Field(default, json_schema_extra={"added": True, **({"match_only": True} if match_only else {})}, **field)


def components_in(config: Any) -> Iterator[tuple[str, ComponentConfig]]:
    """Yield (field name, configuration) for each component directly in a slot (a field that holds a component) of a
    configuration.

    Components in the slots of these components are not included. A field with several components yields the names
    `name[0]`, `name[1]` and so on.
    """
    for name in type(config).model_fields if isinstance(config, BaseModel) else ():
        value = getattr(config, name)
        if isinstance(value, ComponentConfig):
            yield name, value
        elif holds_components(value):
            yield from ((f"{name}[{number}]", item) for number, item in enumerate(value))


def nested_components(config: Any) -> Iterator[ComponentConfig]:
    """Yield the configurations of all components in the slots (fields that hold a component) of a configuration, at any
    depth."""
    for _, inner in components_in(config):
        yield inner
        yield from nested_components(inner)


def holds_components(value: Any) -> bool:
    """Return whether the value of a setting is a tuple of component configurations."""
    return isinstance(value, tuple) and bool(value) and all(isinstance(item, ComponentConfig) for item in value)


class Component(ABC):
    """Base class of everything that can be registered.

    A subclass of a role must set `name` and `version`. The first line of its docstring is the summary in listings.

    Attributes:
        name: Kebab-case name, unique within the role.
        version: Version of the component, part of the cache key. Change it whenever the output changes.
        requires: Names of the top-level packages that the component imports.
        extra: The pip requirement that installs the packages in `requires`.
        weights: All trained weights that the component may use under any setting.
        Config: The model of the settings.
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
        """Return the packages that a component with this config imports."""
        return cls.requires

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the weights that a component with this config loads. The cache key contains their hashes."""
        return cls.weights

    @classmethod
    def check(cls, config: Any) -> None:
        """Check that a component with this config, and the components in its slots, can run on this machine.

        The check is fast and does not import the required packages.

        Raises:
            RequirementMissing: A package is not installed.
            WeightsError: A file of weights is missing.
        """
        absent = [package for package in cls.requires_in_use(config) if importlib.util.find_spec(package) is None]
        if absent:
            hint = f": pip install '{cls.extra}'" if cls.extra else ""
            packages = "package" if len(absent) == 1 else "packages"
            verb = "which is" if len(absent) == 1 else "which are"
            remedy = f"pip install '{cls.extra}'" if cls.extra else f"pip install {' '.join(absent)}"
            raise RequirementMissing(
                f"{cls.name} needs the Python {packages} {' and '.join(absent)}, {verb} not installed{hint}", remedy
            )
        for weights in cls.weights_in_use(config):
            weights.find()
        for _, inner in components_in(config):
            inner.component.check(inner)


class Role(Component):
    """Base class of roles. A role is an interface that the components of plugins implement.

    A direct subclass of Role is a role. A subclass of a role is a component.

    Attributes:
        role: The name of the role in configurations.
        presets: Name of the folder with the presets of this role, such as "methods". Each plugin can have a collection
            of presets with this folder. None: the role has no presets.
        word: The word for a component of this role in messages. If it is empty, messages use the name of the role.
        conformance: The conformance test of the role, as "module:function" or "module:class". The function is called
            with a factory that creates the component. The class is a subclass of salframe.testing.Rules, and each of
            its methods tests one rule.
    """

    presets: ClassVar[str | None] = None
    word: ClassVar[str] = ""
    conformance: ClassVar[str] = ""


def is_role(item: object) -> bool:
    """Return whether `item` is a role and not a component."""
    return isinstance(item, type) and Role in item.__bases__
