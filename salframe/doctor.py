"""What is installed, what is missing, and what did not load."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.errors import SalframeError
from salframe.registry import Failure, registry
from salframe.runs import environment
from salframe.storage import cache_home
from salframe.weights import list_weights


@dataclass(frozen=True)
class ComponentStatus:
    """A registered component; `missing` says why it cannot run here with its default settings, None where it can."""

    role: str
    name: str
    version: str
    package: str
    summary: str
    missing: str | None


def list_components() -> Iterator[ComponentStatus]:
    """Every registered component by role and name. Imports nothing that a component would import to run."""
    for component, package in registry():
        missing = None
        try:
            component.check(component.Config())
        except SalframeError as error:
            missing = str(error)
        summary = (component.__doc__ or "").strip().partition("\n")[0]
        yield ComponentStatus(component.role, component.name, component.version, package, summary, missing)


@dataclass(frozen=True)
class Diagnosis:
    """The state of an installation.

    environment: see runs.environment; failures: plugins that did not load; weights: name -> what is missing, None where they are at hand.
    """

    environment: dict[str, Any]
    failures: tuple[Failure, ...]
    cache: Path
    cache_bytes: int
    weights: dict[str, str | None]

    @property
    def healthy(self) -> bool:
        """Whether every plugin loaded. Weights that are not at hand are no fault."""
        return not self.failures


def diagnose() -> Diagnosis:
    """Look at the installation. Changes nothing."""
    weights: dict[str, str | None] = {}
    for entry in list_weights(registry()):
        try:
            entry.paths()
            weights[entry.name] = None
        except SalframeError as error:
            weights[entry.name] = str(error)
    return Diagnosis(environment(), tuple(registry().failures), cache_home(), folder_bytes(cache_home()), weights)


def folder_bytes(folder: Path) -> int:
    """Bytes of all files in a folder and the folders in it; 0 where there is none."""
    return sum(os.stat(os.path.join(root, name)).st_size for root, _, names in os.walk(folder) for name in names)
