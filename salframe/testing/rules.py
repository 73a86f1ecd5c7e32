"""What a conformance check gives: the rules that were checked, and what came of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from types import FunctionType
from typing import Generic, TypeVar

from salframe.testing.asking import ConformanceError, DoesNotApply, attempt

Made = TypeVar("Made")
Rule = tuple[str, Callable[[], object]]
"""The name of a rule and what checks it, which raises ConformanceError where it is broken."""


class RuleStatus(StrEnum):
    """What came of a rule. `SKIPPED`: it does not apply, or one that it builds on is broken."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class RuleResult:
    """A rule by its name, what came of it, and in one line why it failed (what was checked, what was received, what was
    expected) or was skipped; nothing where it passed."""

    rule: str
    status: RuleStatus
    message: str = ""

    def __str__(self) -> str:
        return f"{self.status}: {self.rule}" + (f": {self.message}" if self.message else "")


@dataclass(frozen=True)
class Conformance:
    """The rules that a component was checked against, in their order. In a test: `assert not
    check_component(MyDetector).failed`. As text, a line a rule."""

    component: str
    rules: tuple[RuleResult, ...]

    @property
    def passed(self) -> tuple[RuleResult, ...]:
        """The rules that it keeps."""
        return self._of(RuleStatus.PASSED)

    @property
    def failed(self) -> tuple[RuleResult, ...]:
        """The rules that it breaks."""
        return self._of(RuleStatus.FAILED)

    @property
    def skipped(self) -> tuple[RuleResult, ...]:
        """The rules that do not apply to it, or that build on one which it breaks."""
        return self._of(RuleStatus.SKIPPED)

    def _of(self, status: RuleStatus) -> tuple[RuleResult, ...]:
        return tuple(result for result in self.rules if result.status is status)

    def __str__(self) -> str:
        return "\n".join(f"{self.component}: {result}" for result in self.rules)


class Rules(Generic[Made]):
    """The rules of a role: each public method is one, by its name. They are checked in their order; all build on the
    first."""

    def __init__(self, make: Callable[[], Made]) -> None:
        self._make = make

    def make(self) -> Made:
        """A new component, each time the same."""
        return attempt("making it", self._make)

    def list(self) -> list[Rule]:
        """The rules, in their order."""
        names = (name for name, member in vars(type(self)).items() if isinstance(member, FunctionType))
        return [(name.replace("_", " "), getattr(self, name)) for name in names if not name.startswith("_")]


def check_rule(rule: str, check: Callable[[], object]) -> RuleResult:
    """What came of one rule."""
    try:
        check()
    except ConformanceError as error:
        return RuleResult(rule, RuleStatus.FAILED, str(error))
    except DoesNotApply as reason:
        return RuleResult(rule, RuleStatus.SKIPPED, str(reason))
    return RuleResult(rule, RuleStatus.PASSED)


def check_all(rules: Sequence[Rule]) -> list[RuleResult]:
    """What came of rules that all build on the first."""
    results: list[RuleResult] = []
    for rule, check in rules:
        if results and results[0].status is RuleStatus.FAILED:
            results.append(skipped(rule, results[0]))
        else:
            results.append(check_rule(rule, check))
    return results


def skipped(rule: str, broken: RuleResult) -> RuleResult:
    """A rule that cannot be checked, as another is broken."""
    return RuleResult(rule, RuleStatus.SKIPPED, f"builds on '{broken.rule}', which failed")
