"""What every registered class has in common."""

from __future__ import annotations

import importlib.util
from abc import ABC
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from salframe.config import ComponentConfig
from salframe.errors import RequirementMissing

if TYPE_CHECKING:
    from salframe.weights import Weights


class Component(ABC):
    """Anything that can be registered. A subclass of a role sets `name` and `version`, and may set the rest.

    `name` kebab-case, unique in its role; `version` changes whenever the output does (it is part of every cache key); `requires` are
    importable packages, `extra` the pip requirement that brings them; the first line of the docstring is the summary; `Config` holds the settings.
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
            cls.Config = type("Config", (cls.Config,), {"__module__": cls.__module__, "__qualname__": f"{cls.__qualname__}.Config"})
        cls.Config.component = cls

    def __init__(self, config: ComponentConfig | None = None) -> None:
        self.config: Any = self.Config() if config is None else config
        self.check(self.config)

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        """Raises RequirementMissing or WeightsMissing where a component with this config could not run here; cheap, imports nothing heavy."""
        absent = [package for package in cls.requires if importlib.util.find_spec(package) is None]
        if absent:
            hint = f": pip install '{cls.extra}'" if cls.extra else ""
            raise RequirementMissing(f"{cls.name} needs {', '.join(absent)}, not installed{hint}")

    @classmethod
    def files(cls, config: ComponentConfig) -> tuple[Path, ...]:
        """The user's own files that the output of a component with this config depends on: their content is part of every cache key."""
        return ()
