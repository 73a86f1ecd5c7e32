"""The word `auto` in a slot: the component in it is left to the data, and to what can run on this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from salframe.framework.component import Component, ComponentConfig, components_in
from salframe.framework.components.defaults import AUTO, auto_order
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing, PluginFailed, RequirementMissing, UnknownName, failure_of


class Choice:
    """Decides slots that say `auto`: given to `validate`, which then fills them."""

    def __init__(self, data: str, provides: Callable[[], frozenset[str]]) -> None:
        """`data`: what messages call the data; provides(): which parts its panoramas have, asked where a slot says
        `auto`."""
        self._data, self._provides = data, provides
        self._taken: dict[str, str] = {}

    @property
    def notes(self) -> list[str]:
        """What `auto` became so far, a line for each role."""
        return list(self._taken.values())

    def take(self, role: str, added: frozenset[str] = frozenset()) -> type[Component]:
        """The first component in the role's order that can run here on the data, whose panoramas get the parts `added`.

        Raises InputMissing that says why each cannot.
        """
        component, remark = first_fit(role, self._provides() | added)
        if component is None:
            raise InputMissing(f"no {role} of {AUTO!r} can run on {self._data}: {remark}")
        self._taken[role] = f"{AUTO} took the {role} {component.name}" + (f", which {remark}" if remark else "")
        return component


def first_fit(role: str, provides: frozenset[str] | None) -> tuple[type[Component] | None, str]:
    """The first component in a role's order that can run on panoramas with these parts (None: whatever it needs), with
    what to say of it; None with the reasons where none can. Names that nobody brings are passed over."""
    reasons = []
    for name, remark in auto_order(role).items():
        try:
            component = registry().get(role, name)
        except UnknownName:
            continue
        except PluginFailed as error:
            reasons.append(f"{name}: {error}")
            continue
        reason = why_unfit(component, provides)
        if reason is None:
            return component, remark
        reasons.append(f"{name}: {reason}")
    return None, "; ".join(reasons) or "none is installed"


def why_unfit(component: type[Component], provides: frozenset[str] | None) -> str | None:
    """Why a component cannot run, as it is, on panoramas with these parts (None: whatever it needs), None where it
    can."""
    reason = failure_of(lambda: component.check(component.Config()))
    if reason is not None or provides is None:
        return reason
    absent = needs_of(component.Config()) - provides
    return f"needs {' and '.join(sorted(absent))}, which the data does not have" if absent else None


def needs_of(config: ComponentConfig) -> frozenset[str]:
    """Which parts panoramas must have for a configured component: those that its class names in `needs`, and the needs
    of the components in its slots."""
    needs = getattr(config.component, "needs", None)
    own = needs if isinstance(needs, frozenset) else frozenset()
    return own.union(*(needs_of(inner) for _, inner in components_in(config)))


def parts_added(values: Iterable[Any]) -> frozenset[str]:
    """Which parts panoramas get from the components among the values of settings: those that their class names in
    `gives`."""
    components = (value.component for value in values if isinstance(value, ComponentConfig))
    return frozenset().union(*(getattr(component, "gives", ()) for component in components))


class Undecided(Component):
    """What a slot holds that says `auto`, where no data is known; it cannot be built."""

    name = AUTO
    version = "1"

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        """Raises RequirementMissing where nothing that it may become could run here, whatever the data."""
        component, reasons = first_fit(cls.role, None)
        if component is None:
            raise RequirementMissing(f"no {cls.role} of {AUTO!r} can run here: {reasons}")


@cache
def undecided(role: str) -> type[Component]:
    """`Undecided` of this role."""
    return type(Undecided.__name__, (Undecided,), {"role": role, "__doc__": Undecided.__doc__})
