"""What is installed, what is missing, and what did not load."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from salframe.framework.component import Component
from salframe.framework.components.presets import configure, names, preset_names, settings
from salframe.framework.components.registry import Failure, Registry, registry
from salframe.framework.errors import SalframeError, UnknownName, failure_of, unknown
from salframe.framework.files.cache import cache_home
from salframe.framework.files.weights import ByteProgress, NetworkWeights


def environment() -> dict[str, Any]:
    """Versions of salframe and what it needs, the components at hand, and the machine."""
    requirements = [
        text for text in metadata.requires("salframe") or [] if not re.search(r"extra == .(test|docs)", text)
    ]
    packages = ["salframe", *(match.group() for text in requirements if (match := re.match(r"[\w.-]+", text)))]
    return {
        "python": platform.python_version(),
        "packages": {name: version for name in packages if (version := installed_version(name))},
        "plugins": [
            {"role": component.role, "name": component.name, "version": component.version, "package": package}
            for component, package in registry()
        ],
        "machine": {"platform": platform.platform(), "processor": platform.machine(), "cpus": os.cpu_count()},
    }


def list_weights(plugins: Registry) -> list[NetworkWeights]:
    """All weights that registered components declare, by name."""
    declared = {weights.name: weights for component, _ in plugins for weights in component.weights}
    return [declared[name] for name in sorted(declared)]


def find_weights(name: str, plugins: Registry) -> NetworkWeights:
    """The weights of this name. Raises UnknownName."""
    declared = {weights.name: weights for weights in list_weights(plugins)}
    if name not in declared:
        raise UnknownName(unknown("weights", name, sorted(declared)))
    return declared[name]


def fetch_weights(name: str, progress: ByteProgress = lambda done, total: None) -> tuple[Path, ...]:
    """Download weights into salframe's cache, unless they are at hand, and verify them; their paths. progress(done,
    total) counts bytes. Raises UnknownName, WeightsMissing where they cannot be had."""
    return find_weights(name, registry()).fetch(progress)


def installed_version(package: str) -> str | None:
    """The version of an installed distribution, None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


@dataclass(frozen=True)
class ComponentStatus:
    """A component, or a preset of one by the preset's name; `missing` says why it cannot run here as it is set, None
    where it can.
    """

    role: str
    name: str
    version: str
    package: str
    summary: str
    missing: str | None


def list_components() -> Iterator[ComponentStatus]:
    """Every registered component by role and name. Imports nothing that a component would import to run."""
    for component, package in registry():
        yield _status(component.name, package, component, {"kind": component.name})


def list_names(role: str) -> Iterator[ComponentStatus]:
    """Everything that names a component of a role, by name: presets, and components as they are."""
    packages = {component.name: package for component, package in registry() if component.role == role}
    packages |= preset_names(role)
    for name in names(role):
        try:
            content = settings(role, name)
            component = registry().get(role, content.get("kind", name))
        except SalframeError as error:
            yield ComponentStatus(role, name, "", packages[name], "", str(error))
        else:
            yield _status(name, packages[name], component, content)


def _status(name: str, package: str, component: type[Component], content: Mapping[str, Any]) -> ComponentStatus:
    missing = failure_of(lambda: component.check(configure(component.role, name, content)))
    return ComponentStatus(component.role, name, component.version, package, summary_of(component), missing)


def summary_of(component: type[Component]) -> str:
    """The first paragraph of a component's docstring, on one line."""
    return " ".join((component.__doc__ or "").strip().partition("\n\n")[0].split())


@dataclass(frozen=True)
class Diagnosis:
    """The state of an installation.

    environment: see `environment`; failures: plugins that did not load; weights: name -> what is missing, None where
    they are at hand.
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
    weights = {entry.name: failure_of(entry.paths) for entry in list_weights(registry())}
    return Diagnosis(environment(), tuple(registry().failures), cache_home(), folder_bytes(cache_home()), weights)


def folder_bytes(folder: Path) -> int:
    """Bytes of all files in a folder and the folders in it, each counted once that is found under several paths; 0
    where there is none."""
    found = (os.stat(os.path.join(root, name)) for root, _, names in os.walk(folder) for name in names)
    return sum({(file.st_dev, file.st_ino): file.st_size for file in found}.values())
