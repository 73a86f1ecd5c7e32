"""A conformance suite for components: `check_component(MyDetector)` in your own tests says what breaks a rule of the
role, if anything does."""

from __future__ import annotations

from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any

from salframe.framework.auto import Choice
from salframe.framework.component import Component, Role
from salframe.framework.config import ComponentConfig, validate
from salframe.framework.registry import registry
from salframe.testing.asking import ConformanceError
from salframe.testing.datasets import check_dataset
from salframe.testing.declaration import check_config, check_declaration
from salframe.testing.detectors import check_detector
from salframe.testing.engines import check_engine
from salframe.testing.identities import check_files
from salframe.testing.localizers import check_localizer
from salframe.testing.range_models import check_range_model
from salframe.testing.rooms import PARTS
from salframe.testing.scorers import check_scorer
from salframe.testing.stages import check_matcher, check_planner, check_positioner, check_saliency

__all__ = ["ConformanceError", "check_component"]

_CHECKS: dict[str, Callable[[Callable[[], Any]], None]] = {
    "dataset": check_dataset,
    "range-model": check_range_model,
    "detector": check_detector,
    "saliency": check_saliency,
    "matcher": check_matcher,
    "positioner": check_positioner,
    "planner": check_planner,
    "scorer": check_scorer,
    "localizer": check_localizer,
    "engine": check_engine,
}
"""The rules of the core's own roles. They cannot name these in `conformance`, as a plugin's roles do: they stand in
layers below this one, which must not know it."""


def check_component(component: type[Component], config: ComponentConfig | None = None) -> None:
    """Check a component class against the rules of its role, on furnished rooms that the suite makes itself; `config`:
    None for the defaults. A role that a plugin brings has the rules that its `conformance` names.

    Raises ConformanceError on the first rule that is broken, in one line: what was checked, what was received, what was
    expected. Raises RequirementMissing or WeightsMissing where the component cannot run here.
    """
    check_declaration(component)
    try:
        used = on_rooms(check_config(component, config))
        check_files(used)
        component.check(used)
        _check_of(registry().roles[component.role])(lambda: component(used))
    except ConformanceError as error:
        raise ConformanceError(f"{component.role} {component.name}: {error}") from error.__cause__


def on_rooms(config: ComponentConfig) -> ComponentConfig:
    """The configuration with slots that say `auto` decided by the suite's own rooms, which have everything."""
    choice = Choice("the suite's rooms", lambda: PARTS)
    return validate(type(config), config.model_dump(mode="json"), config.kind, choice)


def _check_of(role: type[Role]) -> Callable[[Callable[[], Any]], None]:
    """The function that checks the promises of a role; one that checks nothing where nobody wrote any down."""
    if role.role in _CHECKS:
        return _CHECKS[role.role]
    if not role.conformance:
        return lambda make: None
    return resolve_name(role.conformance)
