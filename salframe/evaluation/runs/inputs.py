"""The input of methods: the parts of panoramas that they need, and whether a dataset provides them."""

from __future__ import annotations

from typing import Any

from salframe.framework.component import Component, components_in, nested_components
from salframe.framework.components.auto import name_parts, needs_of, unfit_reason
from salframe.framework.components.registry import registry
from salframe.framework.errors import FRAME_ERRORS, InputMissing
from salframe.graphs.annotated import has_points
from salframe.graphs.detector import Detector
from salframe.localization.describing import estimates_range, required_parts
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.range_model import RangeModel

ORDER = ("annotations", "rgb", "range")
"""Names of the parts of panoramas (annotated objects, colour, range), in the order in which they are listed."""
ESTIMATED_RANGE = "estimated range"
"""Input of a method whose range model estimates the range that a dataset lacks."""
TRIANGULATED = "range: triangulated"
"""Input of a method that triangulates the objects of reference frames without range."""


def parts_needed(method: Any, dataset: Dataset) -> frozenset[str]:
    """Return the parts of panoramas that a method needs. The method is a localizer or a component with `needs`."""
    return required_parts(method, dataset.provides) if isinstance(method, Localizer) else method.needs


def input_parts(method: Component, dataset: Dataset) -> tuple[str, ...]:
    """Return the parts of a data set's panoramas that a method receives as input.

    These are the parts that it needs or uses, and the noise that a detector adds. If its range model estimates the
    range, ESTIMATED_RANGE is added. If it triangulates the objects of reference frames, TRIANGULATED is added.
    """
    used = method.uses & dataset.provides if isinstance(method, Localizer) else frozenset[str]()
    parts = sorted(parts_needed(method, dataset) | used, key=ORDER.index)
    for inner in nested_components(method.config):
        if issubclass(inner.component, Detector):
            noise = inner.component.noise_in(inner, dataset.rendered)
            parts = [f"{part} + {noise} noise" if noise and part in inner.component.needs else part for part in parts]
    estimates = isinstance(method, Localizer) and estimates_range(method, dataset.provides)
    derived = [ESTIMATED_RANGE] if estimates else [TRIANGULATED] if triangulates_range(method, dataset) else []
    return (*parts, *derived)


def triangulates_range(method: Component, dataset: Dataset) -> bool:
    """Return whether a method triangulates the objects of the reference frames, because they have no range."""
    if not isinstance(method, Localizer) or type(method).complete is Localizer.complete:
        return False
    if "range" in dataset.provides or estimates_range(method, dataset.provides):
        return False
    frame = next((frame for fold in dataset.folds() for frame in fold.references), None)
    try:
        return frame is not None and not has_points(frame.load())
    except FRAME_ERRORS:
        return False


def check_needs(method: Component, dataset: Dataset) -> None:
    """Raise InputMissing if a data set lacks a part of panoramas that a method needs.

    The message names the component that needs the part, and the components that work without it.
    """
    absent = parts_needed(method, dataset) - dataset.provides
    if not absent:
        return
    words = name_parts(absent)
    models = registry().names(RangeModel.role) if getattr(method.config, "range", method) is None else []
    estimate = " or ".join(f"--set range.kind={name}" for name in models) if absent == {"range"} else ""
    for slot, inner in components_in(method.config):
        role = inner.component.role
        if absent & needs_of(inner):
            able = [
                n for n in registry().names(role) if unfit_reason(registry().get(role, n), dataset.provides) is None
            ]
            hint = " or ".join(f"--set {slot}.kind={name}" for name in able)
            remedies = [f"use another {role} ({hint})"] if able else []
            remedies += [f"estimate the range ({estimate})"] if estimate else []
            advice = ", or ".join(remedies) or f"no installed {role} works without {words}"
            raise InputMissing(
                f"the {role} {inner.kind!r} of the method needs {words}, which the dataset "
                f"{dataset.name} does not have: {advice}"
            )
    raise InputMissing(
        f"the method needs {words}, which the dataset {dataset.name} does not have: use another method or dataset"
    )
