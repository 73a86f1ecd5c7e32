"""A conformance suite for components: `assert not check_component(MyDetector).failed` in your own tests says what
breaks a rule of the role, if anything does."""

from __future__ import annotations

from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any

from salframe.framework.component import Component, ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.registry import registry
from salframe.framework.validation import validate
from salframe.testing.asking import ConformanceError, DoesNotApply, expect
from salframe.testing.datasets import DatasetRules
from salframe.testing.declaration import check_config, check_declaration
from salframe.testing.detectors import DetectorRules
from salframe.testing.engines import EngineRules
from salframe.testing.identities import check_files
from salframe.testing.localizers import LocalizerRules
from salframe.testing.planners import PlannerRules
from salframe.testing.range_models import RangeModelRules
from salframe.testing.rooms import PARTS
from salframe.testing.rules import Conformance, Rule, RuleResult, Rules, RuleStatus, check_all, check_rule, skipped
from salframe.testing.scene_indexes import SceneIndexRules
from salframe.testing.scorers import ScorerRules
from salframe.testing.stages import MatcherRules, PositionerRules, SaliencyRules

__all__ = [
    "Conformance",
    "ConformanceError",
    "DoesNotApply",
    "RuleResult",
    "RuleStatus",
    "Rules",
    "check_component",
    "expect",
]

_RULES: dict[str, type[Rules[Any]]] = {
    "dataset": DatasetRules,
    "range-model": RangeModelRules,
    "detector": DetectorRules,
    "saliency": SaliencyRules,
    "scene-index": SceneIndexRules,
    "matcher": MatcherRules,
    "positioner": PositionerRules,
    "planner": PlannerRules,
    "scorer": ScorerRules,
    "localizer": LocalizerRules,
    "engine": EngineRules,
}
"""The rules of the core's own roles. They cannot name these in `conformance`, as a plugin's roles do: they stand in
layers below this one, which must not know it."""


def check_component(component: type[Component], config: ComponentConfig | None = None) -> Conformance:
    """Check a component class against the rules of its role, on furnished rooms that the suite makes itself; `config`:
    None for the defaults. A role that a plugin brings has the rules that its `conformance` names.

    Gives what came of every rule, so that a test says `assert not check_component(MyDetector).failed`. Raises
    RequirementMissing or WeightsMissing where the component cannot run here.
    """
    used: list[ComponentConfig] = []
    declared = check_all(
        [
            ("declaration", lambda: check_declaration(component)),
            ("settings", lambda: used.append(on_rooms(check_config(component, config)))),
        ]
    )
    files: Rule = ("files", lambda: check_files(used[0]))
    rules = _rules_of(component, lambda: component(used[0]))
    if broken := next((result for result in declared if result.status is RuleStatus.FAILED), None):
        checked = [skipped(rule, broken) for rule, _ in (files, *rules)]
    else:
        component.check(used[0])
        checked = [check_rule(*files), *check_all(rules)]
    name = f"{getattr(component, 'role', '?')} {getattr(component, 'name', component.__qualname__)}"
    return Conformance(name, (*declared, *checked))


def on_rooms(config: ComponentConfig) -> ComponentConfig:
    """The configuration with slots that say `auto` decided by the suite's own rooms, which have everything."""
    choice = Choice("the suite's rooms", lambda: PARTS)
    return validate(type(config), config.model_dump(mode="json"), config.kind, choice)


def _rules_of(component: type[Component], make: Callable[[], Any]) -> list[Rule]:
    """The rules of a component's role; none where nobody wrote any down."""
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
    return [("promises of its role", lambda: conformance(make))]
