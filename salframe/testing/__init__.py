"""Conformance suite for components.

Put `assert not check_component(MyDetector).failed` into the tests of a plugin. Each failed rule names what was checked,
what was received and what was expected.
"""

from __future__ import annotations

from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any

from salframe.framework.component import Component, ComponentConfig
from salframe.framework.components.registry import registry
from salframe.testing.configurations import on_rooms
from salframe.testing.datasets import DatasetRules
from salframe.testing.declaration import check_config, check_declaration
from salframe.testing.detectors import DetectorRules
from salframe.testing.engines import EngineRules
from salframe.testing.evidence import EvidenceRules
from salframe.testing.expectations import ConformanceError, DoesNotApply, expect
from salframe.testing.identities import check_files
from salframe.testing.importers import ImporterRules, check_recording
from salframe.testing.localizers import LocalizerRules
from salframe.testing.planners import PlannerRules
from salframe.testing.range_models import RangeModelRules
from salframe.testing.rules import Conformance, Rule, RuleResult, Rules, RuleStatus, check_all, check_rule, skipped
from salframe.testing.scene_indexes import SceneIndexRules
from salframe.testing.scorers import ScorerRules
from salframe.testing.stages import MatcherRules, PositionerRules, SaliencyRules
from salframe.testing.trackers import TrackerRules

__all__ = [
    "Conformance",
    "ConformanceError",
    "DoesNotApply",
    "RuleResult",
    "RuleStatus",
    "Rules",
    "check_component",
    "check_recording",
    "expect",
]

_RULES: dict[str, type[Rules[Any]]] = {
    "dataset": DatasetRules,
    "importer": ImporterRules,
    "range-model": RangeModelRules,
    "detector": DetectorRules,
    "saliency": SaliencyRules,
    "scene-index": SceneIndexRules,
    "matcher": MatcherRules,
    "positioner": PositionerRules,
    "evidence": EvidenceRules,
    "planner": PlannerRules,
    "scorer": ScorerRules,
    "localizer": LocalizerRules,
    "tracker": TrackerRules,
    "engine": EngineRules,
}
"""Rules of the roles of salframe itself. A role of a plugin names its rules in `conformance`. The roles of salframe do
not, because they are in lower layers, which must not import this package."""


def check_component(component: type[Component], config: ComponentConfig | None = None) -> Conformance:
    """Check a component class against the rules of its role.

    The suite generates furnished rooms as input. If a plugin defines a role, the attribute `conformance` of the role
    names its rules. In a test: `assert not check_component(MyDetector).failed`.

    Args:
        component: The component class.
        config: Configuration of the component; None for the defaults.

    Returns:
        The result of every rule.

    Raises:
        RequirementMissing: A package that the component requires is not installed.
        WeightsError: The weights of the component are not installed.
    """
    configs: list[ComponentConfig] = []
    declared = check_all(
        [
            ("declaration", lambda: check_declaration(component)),
            ("settings", lambda: configs.append(on_rooms(check_config(component, config)))),
        ]
    )
    files: Rule = ("files", lambda: check_files(configs[0]))
    rules = _rules_of(component, lambda: component(configs[0]))
    if broken := next((result for result in declared if result.status is RuleStatus.FAILED), None):
        checked = [skipped(rule, broken) for rule, _ in (files, *rules)]
    else:
        component.check(configs[0])
        checked = [check_rule(*files), *check_all(rules)]
    name = f"{getattr(component, 'role', '?')} {getattr(component, 'name', component.__qualname__)}"
    return Conformance(name, (*declared, *checked))


def _rules_of(component: type[Component], make: Callable[[], Any]) -> list[Rule]:
    """Return the rules of a component's role, an empty list if the role defines none."""
    role = registry().roles.get(getattr(component, "role", ""))
    if role is None:
        return []
    if role.role in _RULES:
        return _RULES[role.role](make).list()
    if not role.conformance:
        return []
    conformance = resolve_name(role.conformance)
    if isinstance(conformance, type) and issubclass(conformance, Rules):
        return conformance(make).list()
    return [("rules of the role", lambda: conformance(make))]
