"""What methods receive of the panoramas of a dataset, and whether the dataset has what they need."""

from __future__ import annotations

from typing import Any

from salframe.framework.component import Component, components_in
from salframe.framework.components.auto import needs_of, why_unfit
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing
from salframe.graphs.detector import Detector
from salframe.localization.describing import estimates_range, required_parts
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.range_model import RangeModel

ORDER = ("annotations", "rgb", "range")
"""Order in which the parts of panoramas are listed."""
ESTIMATED_RANGE = "estimated range"
"""Input of a method whose range model estimates the range that a dataset lacks."""


def parts_needed(method: Any, dataset: Dataset) -> frozenset[str]:
    """What a method, a localizer or another component with `needs`, needs of the panoramas of a data set."""
    return required_parts(method, dataset.provides) if isinstance(method, Localizer) else method.needs


def parts_given(method: Component, dataset: Dataset) -> tuple[str, ...]:
    """Which parts of a data set's panoramas a method is given: what it needs or uses, with the errors that a detector
    puts into it, and range where it is estimated."""
    used = method.uses & dataset.provides if isinstance(method, Localizer) else frozenset[str]()
    parts = sorted(parts_needed(method, dataset) | used, key=ORDER.index)
    for _, inner in components_in(method.config):
        if issubclass(inner.component, Detector):
            noise = inner.component.noise_in(inner, dataset.rendered)
            parts = [f"{part} + {noise} noise" if noise and part in inner.component.needs else part for part in parts]
    estimates = isinstance(method, Localizer) and estimates_range(method, dataset.provides)
    return (*parts, *([ESTIMATED_RANGE] if estimates else []))


def check_needs(method: Component, dataset: Dataset) -> None:
    """Raises InputMissing where a data set lacks what a method needs: whose need it is, and what would do without."""
    absent = parts_needed(method, dataset) - dataset.provides
    if not absent:
        return
    words = " and ".join(sorted(absent))
    models = registry().names(RangeModel.role) if getattr(method.config, "range", method) is None else []
    estimate = " or ".join(f"--set range.kind={name}" for name in models) if absent == {"range"} else ""
    for slot, inner in components_in(method.config):
        role = inner.component.role
        if absent & needs_of(inner):
            able = [n for n in registry().names(role) if why_unfit(registry().get(role, n), dataset.provides) is None]
            hint = " or ".join(f"--set {slot}.kind={name}" for name in able)
            advice = f"what can do without: {hint}" if able else f"no {role} at hand can do without"
            advice += f"; what can estimate it: {estimate}" if estimate else ""
            raise InputMissing(f"its {role} {inner.kind!r} needs {words}, which {dataset.name} does not have; {advice}")
    raise InputMissing(f"needs {words}, which {dataset.name} does not have")
