"""What every registered class has in common, and what makes a role."""

from __future__ import annotations

import importlib.util
from abc import ABC
from typing import TYPE_CHECKING, Any, ClassVar

from salframe.framework.component import ComponentConfig, components_in
from salframe.framework.errors import RequirementMissing

if TYPE_CHECKING:
    from salframe.framework.files.weights import Weights


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
    weights: ClassVar[tuple[Weights, ...]] = ()
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
    def weights_in_use(cls, config: Any) -> tuple[Weights, ...]:
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
