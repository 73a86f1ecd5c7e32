"""Rules of a conformance check, and their results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from types import FunctionType
from typing import Generic, TypeVar

from salframe.testing.expectations import ConformanceError, DoesNotApply, attempt

ComponentT = TypeVar("ComponentT")
Rule = tuple[str, Callable[[], object]]
"""Name of a rule, and the function that checks it. The function raises ConformanceError if the rule is broken."""


class RuleStatus(StrEnum):
    """Status of a rule. `SKIPPED`: the rule does not apply, or it depends on a rule that failed."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class RuleResult:
    """Result of one rule.

    Attributes:
        rule: Name of the rule.
        status: Whether the rule passed, failed or was skipped.
        message: One line. For a failed rule: what was checked, received and expected. For a skipped rule: the reason.
            Empty for a rule that passed.
    """

    rule: str
    status: RuleStatus
    message: str = ""

    def __str__(self) -> str:
        return f"{self.status}: {self.rule}" + (f": {self.message}" if self.message else "")


@dataclass(frozen=True)
class Conformance:
    """Results of all rules that a component was checked against.

    In a test: `assert not check_component(MyDetector).failed`. The string form has one line per rule.

    Attributes:
        component: Role and name of the component.
        rules: Results in the order of the rules.
    """

    component: str
    rules: tuple[RuleResult, ...]

    @property
    def passed(self) -> tuple[RuleResult, ...]:
        """Rules that passed."""
        return self._of(RuleStatus.PASSED)

    @property
    def failed(self) -> tuple[RuleResult, ...]:
        """Rules that failed."""
        return self._of(RuleStatus.FAILED)

    @property
    def skipped(self) -> tuple[RuleResult, ...]:
        """Rules that do not apply, or that depend on a rule that failed."""
        return self._of(RuleStatus.SKIPPED)

    def _of(self, status: RuleStatus) -> tuple[RuleResult, ...]:
        return tuple(result for result in self.rules if result.status is status)

    def __str__(self) -> str:
        return "\n".join(f"{self.component}: {result}" for result in self.rules)


class Rules(Generic[ComponentT]):
    """Base class for the rules of a role.

    Each public method is a rule, and its name is the name of the rule. Rules are checked in the order of their
    definition. All rules depend on the first: if it fails, they are skipped.
    """

    def __init__(self, make: Callable[[], ComponentT]) -> None:
        self._make = make

    def make(self) -> ComponentT:
        """Return a new component, with the same configuration each time."""
        return attempt("creation of the component", self._make)

    def list(self) -> list[Rule]:
        """Return the rules in their order."""
        names = (name for name, member in vars(type(self)).items() if isinstance(member, FunctionType))
        return [(name.replace("_", " "), getattr(self, name)) for name in names if not name.startswith("_")]


def check_rule(rule: str, check: Callable[[], object]) -> RuleResult:
    """Check one rule, and return the result. `check` raises ConformanceError if the rule is broken."""
    try:
        check()
    except ConformanceError as error:
        return RuleResult(rule, RuleStatus.FAILED, str(error))
    except DoesNotApply as reason:
        return RuleResult(rule, RuleStatus.SKIPPED, str(reason))
    return RuleResult(rule, RuleStatus.PASSED)


def check_all(rules: Sequence[Rule]) -> list[RuleResult]:
    """Return the results of rules that all depend on the first."""
    results: list[RuleResult] = []
    for rule, check in rules:
        if results and results[0].status is RuleStatus.FAILED:
            results.append(skipped(rule, results[0]))
        else:
            results.append(check_rule(rule, check))
    return results


def skipped(rule: str, broken: RuleResult) -> RuleResult:
    """Return the result of a rule that cannot be checked because another failed."""
    return RuleResult(rule, RuleStatus.SKIPPED, f"depends on '{broken.rule}', which failed")
