"""State of the installation: components, packages, weights, and plugins that failed to load."""

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
from salframe.framework.errors import RequirementMissing, SalframeError, UnknownName, WeightsError, failure_of, unknown
from salframe.framework.files.cache import cache_home
from salframe.framework.files.hub import fetch_hub_model, find_hub_model, is_hub_name, list_hub_models
from salframe.framework.files.weights import ByteProgress, NetworkWeights


def environment() -> dict[str, Any]:
    """Return the versions of salframe and its requirements, the installed components, and the machine."""
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
    """Return all weights that registered components declare, sorted by name, then all downloaded models of the Hugging
    Face hub."""
    weights_by_name = {weights.name: weights for component, _ in plugins for weights in component.weights}
    return [*(weights_by_name[name] for name in sorted(weights_by_name)), *list_hub_models()]


def find_weights(name: str, plugins: Registry) -> NetworkWeights:
    """Return the weights of this name. The name hf:ORG/MODEL[@REVISION] stands for a downloaded model of the Hugging
    Face hub.

    Raises:
        UnknownName: No component declares weights of this name.
        WeightsError: The model of the hub was not downloaded.
    """
    if is_hub_name(name):
        return find_hub_model(name)
    weights_by_name = {weights.name: weights for weights in list_weights(plugins)}
    if name not in weights_by_name:
        raise UnknownName(unknown("weights", name, sorted(weights_by_name)))
    return weights_by_name[name]


def fetch_weights(name: str, progress: ByteProgress = lambda done, total: None) -> tuple[Path, ...]:
    """Download weights to the cache of salframe, unless they are installed, and verify them.

    Args:
        name: The name of the weights, or hf:ORG/MODEL[@REVISION] for a model of the Hugging Face hub.
        progress: Called with the number of received bytes and the total.

    Returns:
        The paths of the files.

    Raises:
        UnknownName: No component declares weights of this name.
        WeightsError: The download failed, or a file is invalid.
        RequirementMissing: huggingface_hub, which downloads models of the hub, is not installed.
    """
    if is_hub_name(name):
        return fetch_hub_model(name, progress).paths()
    return find_weights(name, registry()).fetch(progress)


def installed_version(package: str) -> str | None:
    """Return the version of a distribution, or None if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


@dataclass(frozen=True)
class ComponentStatus:
    """A component or a preset, and whether it can run.

    Attributes:
        role: The role of the component.
        name: The name of the component or preset.
        version: The version of the component.
        package: The package that provides it.
        summary: The first paragraph of the docstring, on one line.
        missing: The reason why the component cannot run with its settings on this machine. None if it can run.
        remedy: The command or setting that makes the component run. None if it can run, or if no remedy is known.
    """

    role: str
    name: str
    version: str
    package: str
    summary: str
    missing: str | None
    remedy: str | None = None

    @property
    def short(self) -> str:
        """The status in a few words."""
        if self.missing is None:
            return "ready"
        return f"needs: {self.remedy}" if self.remedy else "cannot run (see -v)"


def list_components() -> Iterator[ComponentStatus]:
    """Yield every registered component by role and name. Does not import the packages that components require."""
    for component, package in registry():
        yield _status(component.name, package, component, {"kind": component.name})


def list_names(role: str) -> Iterator[ComponentStatus]:
    """Yield every preset and component of a role, sorted by name."""
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
    remedy = None

    def check() -> None:
        nonlocal remedy
        try:
            component.check(configure(component.role, name, content))
        except (RequirementMissing, WeightsError) as error:
            remedy = error.remedy
            raise

    missing = failure_of(check)
    return ComponentStatus(component.role, name, component.version, package, summary_of(component), missing, remedy)


def summary_of(component: type[Component]) -> str:
    """Return the first paragraph of the docstring of a component, on one line."""
    return " ".join((component.__doc__ or "").strip().partition("\n\n")[0].split())


@dataclass(frozen=True)
class Diagnosis:
    """The state of an installation.

    Attributes:
        environment: Versions, components and machine, see `environment`.
        failures: Plugins that failed to load.
        cache: The cache folder.
        cache_bytes: The size of the cache folder in bytes.
        weights: Name of the weights -> reason why they are missing or invalid. None if they are valid.
    """

    environment: dict[str, Any]
    failures: tuple[Failure, ...]
    cache: Path
    cache_bytes: int
    weights: dict[str, str | None]

    @property
    def healthy(self) -> bool:
        """Whether every plugin loaded. Missing weights do not count."""
        return not self.failures


def diagnose() -> Diagnosis:
    """Return the state of the installation, without changing it."""
    weights = {entry.name: failure_of(entry.paths) for entry in list_weights(registry())}
    return Diagnosis(environment(), tuple(registry().failures), cache_home(), folder_bytes(cache_home()), weights)


def folder_bytes(folder: Path) -> int:
    """Return the total size of the files in a folder and its subfolders, in bytes.

    Files with several hard links count once. The size of a missing folder is 0.
    """
    files = (os.stat(os.path.join(root, name)) for root, _, names in os.walk(folder) for name in names)
    return sum({(file.st_dev, file.st_ino): file.st_size for file in files}.values())
